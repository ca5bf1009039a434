#include "store/internal/object_reader.h"

#include <algorithm>
#include <type_traits>

#include "store/internal/catalog.h"

namespace mtdb {
namespace {

constexpr int kTries = 200;
constexpr size_t kResolvedValues = 1 << 16;

template <typename Id>
constexpr bool kIsCluster = std::is_same_v<Id, ClusterId>;

}  // namespace

Result<Bytes> ReadPayload(const PageReader& pages, const ValueRef& value,
                          const PayloadLocation& location, uint64_t seed,
                          const std::string& where) {
  const std::string place =
      where + ", offset " + std::to_string(value.file_offset + location.offset) + " of the file: ";
  if (location.offset > value.size || location.length > value.size - location.offset) {
    return Corrupt(place + "expected " + std::to_string(location.length) + " bytes at byte " +
                   std::to_string(location.offset) + " of a value, found a value of " +
                   std::to_string(value.size));
  }
  Bytes payload(location.length);
  MTDB_RETURN_IF_ERROR(pages.ReadValue(value, location.offset, payload));
  const uint64_t checksum = Hash64(payload, seed);
  if (checksum != location.checksum) {
    return Corrupt(place + "checksum: expected " + std::to_string(location.checksum) + ", found " +
                   std::to_string(checksum) + "; restore the file from a copy");
  }
  return payload;
}

Result<std::shared_ptr<ClusterSource>> ObjectReader::Open(std::shared_ptr<Environment> environment,
                                                          const std::string& name) {
  const std::string& path = environment->path();
  for (int i = 0; i < kTries; ++i) {
    MTDB_ASSIGN_OR_RETURN(auto record, FindObject(*environment, name));
    if (!record) return NotFound(path + ": no object " + name + "; see list");
    auto index = LoadIndex(path, *record, [&](const Bytes& key, const std::string& place) {
      return environment->ReadProven(
          [&](const Snapshot& snapshot) { return ReadIndexValue(snapshot, key, place); });
    });
    if (index.ok()) {
      return std::shared_ptr<ClusterSource>(
          new ObjectReader(std::move(environment), *std::move(record), *std::move(index)));
    }
    // Replaced since it was found?
    MTDB_ASSIGN_OR_RETURN(const auto now, FindObject(*environment, name));
    if (now && IsSameObject(*now, *record)) return index.status();
  }
  return Status(StatusCode::kBusy,
                path + ": object " + name + " is replaced again and again; try again");
}

ObjectReader::ObjectReader(std::shared_ptr<Environment> environment, ObjectRecord record,
                           ClusterIndex index)
    : environment_(std::move(environment)),
      record_(std::move(record)),
      index_(std::move(index)),
      keys_(record_.id, index_),
      place_(ObjectPlace(environment_->path(), record_)) {}

Status ObjectReader::Explain(const Status& failure) const {
  MTDB_ASSIGN_OR_RETURN(const auto now, FindObject(*environment_, record_.name));
  if (now && IsSameObject(*now, record_)) return failure;
  return NotFound("object " + record_.name + " was removed from " + environment_->path() +
                  " after it was opened; open it again");
}

template <typename Id>
Result<ValueRef> ObjectReader::FindValue(const Snapshot& snapshot, uint32_t value) {
  Resolved& resolved = kIsCluster<Id> ? cluster_values_ : root_values_;
  {
    const std::lock_guard lock(mutex_);
    if (resolved.state != snapshot.state().serial || resolved.values.size() > kResolvedValues) {
      // An older snapshot's reader may undo a newer one's work here, never mix with it.
      resolved.state = snapshot.state().serial;
      resolved.values.clear();
    }
    const auto it = resolved.values.find(value);
    if (it != resolved.values.end()) return it->second;
  }
  const Table table = kIsCluster<Id> ? Table::kClusters : Table::kRoot;
  const Bytes key = kIsCluster<Id> ? keys_.ClusterValueKey(value) : keys_.RootValueKey(value);
  MTDB_ASSIGN_OR_RETURN(const auto found, snapshot.Find(table, key));
  if (!found) {
    return Corrupt(place_ + ": " + kTableNames[static_cast<size_t>(table)] + " value " +
                   std::to_string(value) + ": missing; run verify");
  }
  const std::lock_guard lock(mutex_);
  if (resolved.state == snapshot.state().serial) resolved.values.emplace(value, *found);
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
    seed = ClusterSeed(id, entry.round, entry.hilbert);
    where += ": cluster ";
  } else {
    seed = RootSeed(id);
    where += ": root piece ";
  }
  where += std::to_string(id.value);
  return ReadPayload(snapshot.pages(), value, location, seed, where);
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
  if (order.empty()) return Status::Ok();
  MTDB_ASSIGN_OR_RETURN(Snapshot snapshot, environment_->Newest());
  for (const Id id : order) {
    MTDB_ASSIGN_OR_RETURN(Bytes payload, ReadProven(id, &snapshot));
    MTDB_RETURN_IF_ERROR(receive(id, std::move(payload)));
  }
  return Status::Ok();
}

// What the checksum proves is right, whatever has become of the snapshot. Anything else is looked
// at in a newer one, if writers have used its pages again, and once without the pages that were
// read before.
template <typename Id>
Result<Bytes> ObjectReader::ReadProven(Id id, Snapshot* snapshot) {
  bool fresh = false;
  for (int i = 0; i < kTries; ++i) {
    auto payload = ReadOne(*snapshot, id);
    if (payload.ok()) return payload;
    MTDB_ASSIGN_OR_RETURN(const bool held, environment_->Holds(*snapshot));
    if (held && fresh) return Explain(payload.status());
    fresh = held;
    MTDB_ASSIGN_OR_RETURN(*snapshot, environment_->Newest(fresh));
  }
  return Status(StatusCode::kBusy, place_ + ": writers are too fast for this reader; try again");
}

Status ObjectReader::ReadClusters(std::span<const ClusterId> ids, const ClusterReceiver& receive) {
  return ReadAll(ids, receive);
}

Status ObjectReader::ReadRootPieces(std::span<const RootPieceId> ids, const RootReceiver& receive) {
  return ReadAll(ids, receive);
}

}  // namespace mtdb
