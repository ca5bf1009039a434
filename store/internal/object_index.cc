#include "store/internal/object_index.h"

#include <algorithm>

#include "store/internal/index_codec.h"

namespace mtdb {
namespace {

// 512 rows with all their children; a row of some 80 bytes may have thousands of them.
constexpr uint64_t kMaxIndexValueBytes = 256 << 20;

Status CheckIndex(const ClusterIndex& index, const std::string& where) {
  for (uint32_t i = 0; i < index.cluster_count(); ++i) {
    const ClusterId id{i};
    const uint8_t round = index.cluster(id).round;
    const PayloadLocation& location = index.location(id);
    const bool begins = location.offset == 0;
    if (i == 0) {
      if (!begins || location.value != 0) return Corrupt(where + ": the first value is missing");
    } else {
      const ClusterId before{i - 1};
      const PayloadLocation& previous = index.location(before);
      if (index.cluster(before).round > round) {
        return Corrupt(where + ": cluster " + std::to_string(i) + ": rounds must ascend");
      }
      if (index.cluster(before).round == round &&
          index.cluster(before).hilbert > index.cluster(id).hilbert) {
        return Corrupt(where + ": cluster " + std::to_string(i) + ": hilbert codes must ascend");
      }
      if (location.value != previous.value + (begins ? 1 : 0) ||
          (!begins && location.offset != previous.offset + previous.length)) {
        return Corrupt(where + ": cluster " + std::to_string(i) +
                       ": expected its payload right after the one before");
      }
    }
    for (const ClusterId child : index.children(id)) {
      if (index.cluster(child).round >= round) {
        return Corrupt(where + ": cluster " + std::to_string(i) + ": child " +
                       std::to_string(child.value) + " is of round " +
                       std::to_string(index.cluster(child).round) + ", expected below " +
                       std::to_string(round));
      }
    }
  }
  for (uint32_t i = 0; i < index.root_piece_count(); ++i) {
    const PayloadLocation& location = index.location(RootPieceId{i});
    const bool begins = location.offset == 0;
    const PayloadLocation previous =
        i == 0 ? PayloadLocation{kNone32, 0, 0, 0} : index.location(RootPieceId{i - 1});
    if (location.value != previous.value + (begins ? 1 : 0) || (i == 0 && !begins) ||
        (!begins && location.offset != previous.offset + previous.length)) {
      return Corrupt(where + ": root piece " + std::to_string(i) +
                     ": expected its payload right after the one before");
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
  for (const IndexKind kind : {IndexKind::kClusters, IndexKind::kRootPieces}) {
    const uint32_t rows = kind == IndexKind::kClusters ? record.clusters : record.root_pieces;
    for (uint32_t first = 0; first < rows;) {
      const uint32_t count = std::min(kIndexRowsPerValue, rows - first);
      const Bytes key = IndexKey(record.id, kind, first);
      const std::string place = where + ": rows from " + std::to_string(first) +
                                (kind == IndexKind::kClusters ? " (clusters)" : " (root pieces)");
      MTDB_ASSIGN_OR_RETURN(const Bytes body, source(key, place));
      MTDB_RETURN_IF_ERROR(DecodeIndexRows(body, kind, count, place, &index));
      chain = ChainIndexValue(chain, body);
      if (value_read) value_read(kind, first, body);
      first += count;
    }
  }
  if (chain != record.index_checksum) {
    return Corrupt(where + ": checksum: expected " + std::to_string(record.index_checksum) +
                   " of its record, found " + std::to_string(chain) +
                   "; run verify, restore the file from a copy");
  }
  MTDB_RETURN_IF_ERROR(CheckIndex(index, where));
  // Vertices are numbered on from there.
  uint64_t most = 0;
  for (uint32_t i = 0; i < index.root_piece_count(); ++i) {
    most += index.root_piece(RootPieceId{i}).vertices;
  }
  if (record.root_vertices > most) {
    return Corrupt(where + ": the record says " + std::to_string(record.root_vertices) +
                   " root vertices, but the root pieces have " + std::to_string(most));
  }
  index.Finish(record.root_vertices);
  return index;
}

ValueKeys::ValueKeys(ObjectId id, const ClusterIndex& index) : id_(id) {
  uint32_t sequence = 0;
  for (uint32_t i = 0; i < index.cluster_count(); ++i) {
    if (index.location(ClusterId{i}).offset != 0) continue;
    const ClusterEntry& entry = index.cluster(ClusterId{i});
    sequence = values_.empty() || values_.back().round != entry.round ? 0 : sequence + 1;
    values_.push_back({entry.hilbert, sequence, entry.round});
  }
  const uint32_t pieces = index.root_piece_count();
  if (pieces > 0) root_values_ = index.location(RootPieceId{pieces - 1}).value + 1;
}

}  // namespace mtdb
