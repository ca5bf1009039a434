#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "store/base/out_of_memory.h"
#include "store/database.h"
#include "store/packed_file.h"

namespace mtdb {
namespace {

constexpr uint32_t kUnitsAtOnce = 64;

Status CopyUnits(ClusterSource& source, ObjectWriter& writer) {
  const ClusterIndex& index = source.index();
  for (UnitId first = 0; first < index.unit_count(); first += kUnitsAtOnce) {
    std::vector<UnitId> units(std::min(kUnitsAtOnce, index.unit_count() - first));
    std::iota(units.begin(), units.end(), first);
    std::vector<Bytes> payloads(units.size());
    MTDB_RETURN_IF_ERROR(ReadUnits(source, units, [&](UnitId unit, Bytes payload) {
      payloads[unit - first] = std::move(payload);
      return Status::Ok();
    }));
    for (const UnitId u : units) {
      MTDB_RETURN_IF_ERROR(
          writer.Add(index.unit(u), index.children(u), payloads[u - first]).status());
    }
  }
  return Status::Ok();
}

}  // namespace

Result<ObjectRecord> CopyObject(ClusterSource& source, Database& store, bool replace) {
  return CatchOutOfMemory([&]() -> Result<ObjectRecord> {
    const ObjectRecord& record = source.record();
    MTDB_ASSIGN_OR_RETURN(const auto writer, store.Create(record.name, replace));
    MTDB_RETURN_IF_ERROR(CopyUnits(source, *writer));
    return writer->Publish(record, [&](const ObjectRecord& copy) -> Status {
      if (copy.digest_low == record.digest_low && copy.digest_high == record.digest_high) {
        return Status::Ok();
      }
      return Corrupt("object " + record.name + ": its copy has the digest " + copy.digest_hex() +
                     ", not " + record.digest_hex() + "; verify where it came from");
    });
  });
}

}  // namespace mtdb
