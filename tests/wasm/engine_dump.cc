// SPDX-License-Identifier: Apache-2.0
// engine_dump STORE FILE: the first object of a store for engine_digest: record, index and
// payloads, without zstd, which is not there for WebAssembly.
#include <cstdio>

#include "store/cluster_source.h"
#include "store/database.h"
#include "store/records/index_codec.h"
#include "tests/codecs/decode_check/expand_payload.h"
#include "tests/codecs/decode_check/payload_file.h"

namespace mtdb {

using namespace internal;

namespace {

Status Dump(const char* store, const char* file) {
  MTDB_ASSIGN_OR_RETURN(const auto database, Database::Open(store));
  MTDB_ASSIGN_OR_RETURN(const auto objects, database->List());
  MTDB_ASSIGN_OR_RETURN(const auto source, database->OpenObject(objects.at(0).name));
  const ClusterIndex& index = source->index();
  ClusterIndex expanded;
  ByteWriter payloads;
  for (UnitId unit = 0; unit < index.unit_count(); ++unit) {
    MTDB_RETURN_IF_ERROR(ReadUnits(*source, {&unit, 1}, [&](UnitId, const Bytes& payload) {
      const Bytes plain = ExpandPayload(payload);
      expanded.Add(index.unit(unit), {unit, 0, static_cast<uint32_t>(plain.size()), 0},
                   index.children(unit));
      PutBlob(payloads, plain);
      return Status::Ok();
    }));
  }
  ByteWriter out;
  PutBlob(out, EncodeObjectRecord(source->record()));
  PutBlob(out, EncodeIndexRows(expanded, 0, expanded.unit_count()));
  out.PutBytes(payloads.bytes());
  std::FILE* const f = std::fopen(file, "wb");
  if (f == nullptr) return IoError(std::string(file) + ": cannot be written");
  const size_t written = std::fwrite(out.bytes().data(), 1, out.size(), f);
  if (std::fclose(f) != 0 || written != out.size()) return IoError(std::string(file) + ": full");
  return Status::Ok();
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const mtdb::Status status = mtdb::Dump(argv[1], argv[2]);
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.message().c_str());
  return status.ok() ? 0 : 1;
}
