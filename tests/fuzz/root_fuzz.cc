// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: the payload of a root piece.
#include <cstddef>
#include <cstdint>

#include "codecs/cluster/root_codec.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const mtdb::AttributeLayout kLayouts[] = {
      {}, {{{"quality", mtdb::ScalarType::kFloat32}, {"red", mtdb::ScalarType::kUint8}}}};
  if (size == 0) return 0;
  const auto payload = mtdb::ByteSpan(reinterpret_cast<const std::byte*>(data), size).subspan(1);
  const auto piece = mtdb::DecodeRootPiece(payload, kLayouts[data[0] % 2], 1000, "fuzz");
  if (piece.ok() && piece->listed() > size) __builtin_trap();
  return 0;
}
