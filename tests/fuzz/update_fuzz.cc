// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: an update stream as a client would meet it. The first byte chooses what comes
// before, or nothing; the rest is the body of a record (without: the stream itself), whose length
// and checksum are made right, so that the decoder is reached.
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/fuzz/update_fuzz_targets.h"
#include "tests/support/client_mesh_check.h"

using mtdb::testing::kUpdateFuzzTargets;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const std::vector<mtdb::Bytes> kPrefixes = [] {
    std::vector<mtdb::Bytes> prefixes;
    for (size_t i = 0; i < kUpdateFuzzTargets; ++i) {
      prefixes.push_back(mtdb::testing::UpdateFuzzTarget(i).prefix);
    }
    return prefixes;
  }();
  if (size == 0) return 0;
  const size_t choice = data[0] % (kUpdateFuzzTargets + 1);
  const auto body = mtdb::ByteSpan(reinterpret_cast<const std::byte*>(data), size).subspan(1);
  mtdb::UpdateDecoder decoder({.triangles = 100000, .vertices = 100000});
  if (choice == kUpdateFuzzTargets) {
    static_cast<void>(decoder.Feed(body));
  } else {
    if (!decoder.Feed(kPrefixes[choice]).ok()) __builtin_trap();
    // Twice, so that a good record is met in the wrong place.
    const mtdb::Bytes record = mtdb::testing::UpdateRecord(body);
    if (decoder.Feed(record).ok()) static_cast<void>(decoder.Feed(record));
  }
  if (!mtdb::testing::ClientMeshFault(decoder.mesh()).empty()) __builtin_trap();
  return 0;
}
