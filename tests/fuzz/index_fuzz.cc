// libFuzzer target: the body of a value of the cluster index. The first byte chooses the kind, the
// second is the number of rows.
#include <cstddef>
#include <cstdint>

#include "store/internal/index_codec.h"

namespace {

mtdb::ClusterIndex IndexBefore(mtdb::IndexKind kind) {
  mtdb::ClusterIndex index;
  if (kind == mtdb::IndexKind::kClusters) return index;
  for (uint32_t c = 0; c < 8; ++c) {
    mtdb::ClusterEntry entry;
    entry.round = 1;
    entry.nodes = 1;
    index.AddCluster(entry, {c, 0, 1}, {});
  }
  return index;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 2) return 0;
  const auto kind = static_cast<mtdb::IndexKind>(data[0] % 2);
  const uint32_t rows = data[1];
  const auto body = mtdb::ByteSpan(reinterpret_cast<const std::byte*>(data), size).subspan(2);
  mtdb::ClusterIndex index = IndexBefore(kind);
  if (!mtdb::DecodeIndexRows(body, kind, rows, "fuzz", &index).ok()) return 0;
  // What was read is written so that it is read again.
  const mtdb::Bytes bytes = mtdb::EncodeIndexRows(index, kind, 0, rows);
  mtdb::ClusterIndex again = IndexBefore(kind);
  if (rows > 0 && (!mtdb::DecodeIndexRows(bytes, kind, rows, "fuzz", &again).ok() ||
                   mtdb::EncodeIndexRows(again, kind, 0, rows) != bytes)) {
    __builtin_trap();
  }
  index.Finish(7);
  for (uint32_t c = 0; c < index.cluster_count(); ++c) {
    for (const mtdb::ClusterId p : index.parents(mtdb::ClusterId(c))) {
      if (p.value <= c || p.value >= index.cluster_count()) __builtin_trap();
    }
  }
  return 0;
}
