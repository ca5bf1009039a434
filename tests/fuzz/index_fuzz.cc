// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: the body of a value of the cluster index. The first byte chooses the rows
// before it, none or clusters; the second is the number of rows.
#include <cstddef>
#include <cstdint>

#include "store/records/index_codec.h"

namespace {

mtdb::ClusterIndex IndexBefore(uint32_t clusters) {
  mtdb::ClusterIndex index;
  for (uint32_t c = 0; c < clusters; ++c) {
    mtdb::UnitEntry entry;
    entry.round = 1;
    entry.nodes = 1;
    index.Add(entry, {c, 0, 1}, {});
  }
  return index;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 2) return 0;
  const uint32_t before = 8 * (data[0] % 2);
  const uint32_t rows = data[1];
  const auto body = mtdb::ByteSpan(reinterpret_cast<const std::byte*>(data), size).subspan(2);
  mtdb::ClusterIndex index = IndexBefore(before);
  if (!mtdb::internal::DecodeIndexRows(body, rows, "fuzz", &index).ok()) return 0;
  // What was read is written so that it is read again.
  const mtdb::Bytes bytes = mtdb::internal::EncodeIndexRows(index, before, rows);
  mtdb::ClusterIndex again = IndexBefore(before);
  if (rows > 0 && (!mtdb::internal::DecodeIndexRows(bytes, rows, "fuzz", &again).ok() ||
                   mtdb::internal::EncodeIndexRows(again, before, rows) != bytes)) {
    __builtin_trap();
  }
  index.Finish(7);
  for (mtdb::UnitId u = 0; u < index.unit_count(); ++u) {
    for (const mtdb::UnitId p : index.parents(u)) {
      if (p <= u || p >= index.unit_count()) __builtin_trap();
    }
  }
  return 0;
}
