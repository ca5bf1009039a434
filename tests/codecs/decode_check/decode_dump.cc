// SPDX-License-Identifier: Apache-2.0
// decode_dump STORE FILE: the payloads of all objects, for decode_digest. See payload_file.h.
#include <cstdio>

#include "query/cache/cluster_cache.h"
#include "query/surface.h"
#include "store/base/attribute_layout.h"
#include "store/database.h"
#include "tests/codecs/decode_check/expand_payload.h"
#include "tests/codecs/decode_check/payload_file.h"

namespace mtdb {

using namespace internal;

namespace {

void DumpObject(const Surface& surface, ByteWriter& out) {
  const ClusterIndex& index = surface.index();
  PutAttributeLayout(surface.record().attributes, &out);
  const size_t row = surface.record().attributes.row_bytes();
  LoadStats stats;
  for (UnitId unit = index.unit_count(); unit-- > 0;) {
    const LoadedUnitPtr loaded = surface.cache().Get(unit, &stats).value();
    const bool root = unit >= index.cluster_count();
    const Status status =
        ReadUnits(*surface.source(), {&unit, 1}, [&](UnitId, const Bytes& payload) {
          out.Put(root ? kRootPayload : kClusterPayload);
          out.PutVarint(root ? surface.record().root_vertices : loaded->nodes());
          PutBlob(out, ExpandPayload(payload));
          return Status::Ok();
        });
    MTDB_CHECK(status.ok(), status.message().c_str());
    if (root) continue;
    PutInPatch(out, loaded->cluster.in_patch(row));
  }
  out.Put(kNothing);
}

int Main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: decode_dump STORE FILE\n");
    return 2;
  }
  const auto database = Database::Open(argv[1]).value();
  const auto objects = database->List().value();
  ByteWriter out;
  out.PutVarint(objects.size());
  for (const ObjectRecord& object : objects) {
    DumpObject(*Surface::Open(database->OpenObject(object.name).value(), {}).value(), out);
  }
  std::FILE* const file = std::fopen(argv[2], "wb");
  MTDB_CHECK(file != nullptr, argv[2]);
  const ByteSpan bytes = out.bytes();
  const bool written = std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
  return std::fclose(file) == 0 && written ? 0 : 1;
}

}  // namespace

}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
