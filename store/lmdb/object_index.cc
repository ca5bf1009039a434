// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/object_index.h"

#include <algorithm>

#include "store/records/index_codec.h"

namespace mtdb::internal {
namespace {

// 512 rows with all their children; a row of some 80 bytes may have thousands of them.
constexpr uint64_t kMaxIndexValueBytes = 256 << 20;

Status CheckIndex(const ClusterIndex& index, const std::string& where) {
  for (UnitId i = 0; i < index.unit_count(); ++i) {
    const UnitEntry& entry = index.unit(i);
    const PayloadLocation& location = index.location(i);
    const bool begins = location.offset == 0;
    if (i == 0) {
      if (!begins || location.value != 0) return Corrupt(where + ": the first value is missing");
    } else {
      const UnitEntry& before = index.unit(i - 1);
      const PayloadLocation& previous = index.location(i - 1);
      if (before.round > entry.round) {
        return Corrupt(where + ": unit " + std::to_string(i) + ": rounds must ascend");
      }
      if (before.round == entry.round && before.hilbert > entry.hilbert) {
        return Corrupt(where + ": unit " + std::to_string(i) + ": hilbert codes must ascend");
      }
      if (location.value != previous.value + (begins ? 1 : 0) ||
          (!begins && location.offset != previous.offset + previous.length)) {
        return Corrupt(where + ": unit " + std::to_string(i) +
                       ": expected its payload right after the one before");
      }
    }
    for (const UnitId child : index.children(i)) {
      if (index.unit(child).round >= entry.round) {
        return Corrupt(where + ": unit " + std::to_string(i) + ": child " + std::to_string(child) +
                       " is of round " + std::to_string(index.unit(child).round) +
                       ", expected below " + std::to_string(entry.round));
      }
    }
  }
  return Status::Ok();
}

}  // namespace

std::string ObjectPlace(const std::string& path, const ObjectRecord& record) {
  return path + ": object " + std::to_string(record.id.value) + " (" + record.name + ")";
}

Result<Bytes> ReadIndexValue(const Snapshot& snapshot, const Bytes& key, const std::string& place) {
  MTDB_ASSIGN_OR_RETURN(const auto value, snapshot.Find(Table::kIndex, key));
  if (!value) return Corrupt(place + ": missing");
  MTDB_ASSIGN_OR_RETURN(Bytes bytes, snapshot.pages().ReadWhole(*value, kMaxIndexValueBytes));
  MTDB_ASSIGN_OR_RETURN(const ByteSpan body, OpenValue(Table::kIndex, key, bytes, place));
  bytes.erase(bytes.begin(), bytes.end() - static_cast<ptrdiff_t>(body.size()));
  return bytes;
}

Result<ClusterIndex> LoadIndex(const std::string& store, const ObjectRecord& record,
                               const IndexValueSource& source,
                               const IndexValueReceiver& value_read) {
  const std::string where = ObjectPlace(store, record) + ": index";
  ClusterIndex index;
  uint64_t chain = 0;
  const uint64_t units = uint64_t{record.clusters} + record.root_pieces;
  if (units >= kNone32)
    return Corrupt(where + ": its record says " + std::to_string(units) + " units");
  const auto rows = static_cast<uint32_t>(units);
  for (uint32_t first = 0; first < rows;) {
    const uint32_t count = std::min(kIndexRowsPerValue, rows - first);
    const std::string place = where + ": rows from " + std::to_string(first);
    MTDB_ASSIGN_OR_RETURN(const Bytes body, source(IndexKey(record.id, first), place));
    MTDB_RETURN_IF_ERROR(DecodeIndexRows(body, count, place, &index));
    chain = ChainIndexValue(chain, body);
    if (value_read) value_read(first, body);
    first += count;
  }
  if (chain != record.index_checksum) {
    return Corrupt(where + ": checksum: expected " + std::to_string(record.index_checksum) +
                   " of its record, found " + std::to_string(chain) +
                   "; run verify, restore the file from a copy");
  }
  MTDB_RETURN_IF_ERROR(CheckIndex(index, where));
  if (index.cluster_count() != record.clusters) {
    return Corrupt(where + ": the record says " + std::to_string(record.clusters) +
                   " clusters, but the index has " + std::to_string(index.cluster_count()));
  }
  // Vertices are numbered on from there.
  uint64_t most = 0;
  for (UnitId i = record.clusters; i < rows; ++i) most += index.unit(i).external_vertices;
  if (record.root_vertices > most) {
    return Corrupt(where + ": the record says " + std::to_string(record.root_vertices) +
                   " root vertices, but the root pieces have " + std::to_string(most));
  }
  index.Finish(record.root_vertices);
  return index;
}

ValueKeys::ValueKeys(ObjectId id, const ClusterIndex& index) : id_(id) {
  uint32_t sequence = 0;
  for (UnitId i = 0; i < index.unit_count(); ++i) {
    if (index.location(i).offset != 0) continue;
    const UnitEntry& entry = index.unit(i);
    sequence = values_.empty() || values_.back().round != entry.round ? 0 : sequence + 1;
    values_.push_back({entry.hilbert, sequence, entry.round});
  }
}

}  // namespace mtdb::internal
