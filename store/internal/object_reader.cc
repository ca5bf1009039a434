#include "store/internal/object_reader.h"

#include <algorithm>
#include <type_traits>

#include "store/internal/catalog.h"

namespace mtdb {
namespace {

// Payloads that are read under one snapshot, before they are handed on without one.
constexpr uint64_t kBytesPerSnapshot = 4 << 20;
constexpr size_t kResolvedValues = 1 << 16;

template <typename Id>
constexpr bool kIsCluster = std::is_same_v<Id, ClusterId>;

}  // namespace

Result<Bytes> ReadBlob(const PageReader& pages, const ValueRef& value,
                       const PayloadLocation& location, uint64_t seed, const std::string& where) {
  const uint64_t bytes = kChecksumBytes + uint64_t{location.length};
  const std::string place =
      where + ", offset " + std::to_string(value.file_offset + location.offset) + " of the file: ";
  if (location.offset > value.size || bytes > value.size - location.offset) {
    return Corrupt(place + "expected " + std::to_string(bytes) + " bytes at byte " +
                   std::to_string(location.offset) + " of a value, found a value of " +
                   std::to_string(value.size));
  }
  uint64_t checksum = 0;
  Bytes payload;
  if (value.page == nullptr) {
    // One read for both; the payload then moves down over its checksum.
    payload.resize(bytes);
    MTDB_RETURN_IF_ERROR(pages.ReadValue(value, location.offset, payload));
    ByteReader r(payload);
    checksum = r.Get<uint64_t>();
    payload.erase(payload.begin(), payload.begin() + kChecksumBytes);
  } else {
    std::array<std::byte, kChecksumBytes> head;
    MTDB_RETURN_IF_ERROR(pages.ReadValue(value, location.offset, head));
    ByteReader r(head);
    checksum = r.Get<uint64_t>();
    payload.resize(location.length);
    MTDB_RETURN_IF_ERROR(pages.ReadValue(value, location.offset + kChecksumBytes, payload));
  }
  const uint64_t expected = Hash64(payload, seed);
  if (checksum != expected) {
    return Corrupt(place + "checksum: expected " + std::to_string(expected) + ", found " +
                   std::to_string(checksum) + "; restore the file from a copy");
  }
  return payload;
}

Result<std::shared_ptr<ClusterSource>> ObjectReader::Open(std::shared_ptr<Environment> environment,
                                                          const std::string& name) {
  MTDB_ASSIGN_OR_RETURN(const Snapshot snapshot, environment->BeginRead());
  MTDB_ASSIGN_OR_RETURN(auto record, FindObject(snapshot, name));
  if (!record) return NotFound(environment->path() + ": no object " + name + "; see list");
  MTDB_ASSIGN_OR_RETURN(ClusterIndex index, LoadIndex(snapshot, *record));
  return std::shared_ptr<ClusterSource>(
      new ObjectReader(std::move(environment), *std::move(record), std::move(index)));
}

ObjectReader::ObjectReader(std::shared_ptr<Environment> environment, ObjectRecord record,
                           ClusterIndex index)
    : environment_(std::move(environment)),
      record_(std::move(record)),
      index_(std::move(index)),
      keys_(record_.id, index_),
      place_(ObjectPlace(environment_->path(), record_)) {}

Status ObjectReader::Missing(const Snapshot& snapshot, const std::string& what) const {
  MTDB_ASSIGN_OR_RETURN(const auto now, FindObject(snapshot, record_.name));
  if (now && now->id == record_.id) return Corrupt(place_ + ": " + what + ": missing; run verify");
  return NotFound("object " + record_.name + " was removed from " + environment_->path() +
                  " after it was opened; open it again");
}

template <typename Id>
Result<ValueRef> ObjectReader::FindValue(const Snapshot& snapshot, uint32_t value) {
  Resolved& resolved = kIsCluster<Id> ? cluster_values_ : root_values_;
  {
    const std::lock_guard lock(mutex_);
    if (resolved.txnid != snapshot.txnid() || resolved.values.size() > kResolvedValues) {
      // An older snapshot's reader may undo a newer one's work here, never mix with it.
      resolved.txnid = snapshot.txnid();
      resolved.values.clear();
    }
    const auto it = resolved.values.find(value);
    if (it != resolved.values.end()) return it->second;
  }
  const Table table = kIsCluster<Id> ? Table::kClusters : Table::kRoot;
  const Bytes key = kIsCluster<Id> ? keys_.ClusterValueKey(value) : keys_.RootValueKey(value);
  MTDB_ASSIGN_OR_RETURN(const auto found, snapshot.Find(table, key));
  if (!found) {
    return Missing(snapshot, std::string(kTableNames[static_cast<size_t>(table)]) + " value " +
                                 std::to_string(value));
  }
  const std::lock_guard lock(mutex_);
  if (resolved.txnid == snapshot.txnid()) resolved.values.emplace(value, *found);
  return *found;
}

template <typename Id>
Result<Bytes> ObjectReader::ReadOne(const Snapshot& snapshot, Id id) {
  const PayloadLocation& location = index_.location(id);
  MTDB_ASSIGN_OR_RETURN(const ValueRef value, FindValue<Id>(snapshot, location.value));
  uint64_t seed = 0;
  std::string where = place_;
  if constexpr (kIsCluster<Id>) {
    const ClusterEntry& entry = index_.cluster(id);
    seed = ClusterSeed(record_.id, id, entry.round, entry.hilbert);
    where += ": cluster ";
  } else {
    seed = RootSeed(record_.id, id);
    where += ": root piece ";
  }
  where += std::to_string(id.value);
  return ReadBlob(snapshot.pages(), value, location, seed, where);
}

template <typename Id, typename Receiver>
Status ObjectReader::ReadAll(std::span<const Id> ids, const Receiver& receive) {
  const uint32_t count = kIsCluster<Id> ? index_.cluster_count() : index_.root_piece_count();
  for (const Id id : ids) {
    if (id.value >= count) {
      return InvalidArgument(place_ + ": no " + (kIsCluster<Id> ? "cluster " : "root piece ") +
                             std::to_string(id.value) + ", it has " + std::to_string(count));
    }
  }
  std::vector<Id> order(ids.begin(), ids.end());
  std::ranges::sort(order);
  for (size_t next = 0; next < order.size();) {
    std::vector<std::pair<Id, Bytes>> payloads;
    {
      // No snapshot is held while the receiver works.
      MTDB_ASSIGN_OR_RETURN(const Snapshot snapshot, environment_->BeginRead());
      uint64_t bytes = 0;
      for (; next < order.size() && bytes < kBytesPerSnapshot; ++next) {
        MTDB_ASSIGN_OR_RETURN(Bytes payload, ReadOne(snapshot, order[next]));
        bytes += payload.size();
        payloads.emplace_back(order[next], std::move(payload));
      }
    }
    for (auto& [id, payload] : payloads) MTDB_RETURN_IF_ERROR(receive(id, std::move(payload)));
  }
  return Status::Ok();
}

Status ObjectReader::ReadClusters(std::span<const ClusterId> ids, const ClusterReceiver& receive) {
  return ReadAll(ids, receive);
}

Status ObjectReader::ReadRootPieces(std::span<const RootPieceId> ids, const RootReceiver& receive) {
  return ReadAll(ids, receive);
}

}  // namespace mtdb
