// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/catalog.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <unistd.h>

#include "store/lmdb/builder_lock.h"
#include "store/lmdb/test_hooks.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kMaxRecordBytes = 64 << 20;
constexpr size_t kEntriesAtOnce = 64;
constexpr uint64_t kKeysPerRemoval = 4096;
constexpr uint64_t kBytesPerRemoval = 256 << 20;

std::string EntryPlace(const std::string& path, ByteSpan key) {
  const std::string at = path + ": catalog: ";
  if (key.empty()) return at + "empty key";
  const auto kind = static_cast<CatalogKind>(key[0]);
  if (kind == CatalogKind::kObject) {
    return at + "object " + std::string(AsString(key.subspan(1)));
  }
  ByteReader r(key.subspan(1));
  const auto id = r.GetBigEndian<uint64_t>();
  if (kind == CatalogKind::kBuilding) return at + "building object " + std::to_string(id);
  if (kind == CatalogKind::kGarbage) return at + "removed object " + std::to_string(id);
  return at + "superblock";
}

Result<ObjectRecord> DecodeObjectEntry(ByteSpan key, ByteSpan value, const std::string& where) {
  MTDB_ASSIGN_OR_RETURN(const ByteSpan body, OpenValue(Table::kCatalog, key, value, where));
  MTDB_ASSIGN_OR_RETURN(ObjectRecord record, DecodeObjectRecord(body, where));
  if (record.name != AsString(key.subspan(1))) {
    return Corrupt(where + ": expected a record of that name, found " + record.name);
  }
  return record;
}

Status AddEntry(const std::string& path, ByteSpan key, ByteSpan value, uint64_t next_object_id,
                CatalogListing* listing) {
  const std::string where = EntryPlace(path, key);
  if (key.empty()) return Corrupt(where);
  const auto kind = static_cast<CatalogKind>(key[0]);
  ObjectId id;
  switch (kind) {
    case CatalogKind::kSuperblock:
      if (key.size() != 1) return Corrupt(where + ": expected a key of 1 byte");
      return Status::Ok();  // checked when the snapshot was taken
    case CatalogKind::kBuilding:
    case CatalogKind::kGarbage: {
      if (key.size() != 9) return Corrupt(where + ": expected a key of 9 bytes");
      ByteReader r(key.subspan(1));
      id = ObjectId{r.GetBigEndian<uint64_t>()};
      MTDB_ASSIGN_OR_RETURN(const ByteSpan body, OpenValue(Table::kCatalog, key, value, where));
      MTDB_ASSIGN_OR_RETURN(PendingEntry entry, DecodePendingEntry(body, where));
      auto& list = kind == CatalogKind::kBuilding ? listing->building : listing->garbage;
      list.emplace_back(id, std::move(entry));
      break;
    }
    case CatalogKind::kObject: {
      MTDB_ASSIGN_OR_RETURN(ObjectRecord record, DecodeObjectEntry(key, value, where));
      id = record.id;
      listing->objects.push_back(std::move(record));
      break;
    }
    default:
      return Corrupt(where + ": entry kind " + std::to_string(static_cast<int>(kind)) +
                     " is unknown");
  }
  if (id.value == 0 || id.value >= next_object_id) {
    return Corrupt(where + ": expected an object id from 1 to " +
                   std::to_string(next_object_id - 1) + ", found " + std::to_string(id.value));
  }
  return Status::Ok();
}

// Entries from the key `*from` on, at most `limit` of them; `*from` is then the next key, or
// nothing at the end.
Status ListPart(const Snapshot& snapshot, std::optional<Bytes>* from, size_t limit,
                CatalogListing* listing, const EntryFailure& fail) {
  PageReader& pages = snapshot.pages();
  const Bytes first = from->value_or(Bytes());
  from->reset();
  return snapshot.Scan(
      Table::kCatalog, first, [&](ByteSpan key, const ValueRef& value) -> Result<bool> {
        if (limit == 0) {
          from->emplace(key.begin(), key.end());
          return false;
        }
        --limit;
        const auto bytes = pages.ReadWhole(value, kMaxRecordBytes);
        const Status status = bytes.ok() ? AddEntry(pages.file().path(), key, *bytes,
                                                    snapshot.superblock().next_object_id, listing)
                                         : bytes.status();
        if (!status.ok()) fail(status);
        return true;
      });
}

}  // namespace

Status ListCatalog(const Snapshot& snapshot, CatalogListing* listing, const EntryFailure& fail) {
  std::optional<Bytes> from;
  return ListPart(snapshot, &from, std::numeric_limits<size_t>::max(), listing, fail);
}

// Part by part, so that it comes to an end however fast writers are.
Result<CatalogListing> ListCatalog(Environment& environment, const EntryFailure& fail) {
  CatalogListing all;
  std::optional<Bytes> from;
  do {
    CatalogListing part;
    std::vector<Status> failures;
    std::optional<Bytes> next;
    MTDB_RETURN_IF_ERROR(environment.Read([&](const Snapshot& snapshot) {
      part = {};
      failures.clear();
      next = from;
      return ListPart(snapshot, &next, kEntriesAtOnce, &part,
                      [&](const Status& status) { failures.push_back(status); });
    }));
    std::ranges::move(part.objects, std::back_inserter(all.objects));
    std::ranges::move(part.building, std::back_inserter(all.building));
    std::ranges::move(part.garbage, std::back_inserter(all.garbage));
    for (const Status& status : failures) fail(status);
    from = std::move(next);
  } while (from);
  return all;
}

Result<std::optional<ObjectRecord>> FindObject(Environment& environment, const std::string& name) {
  return environment.Read([&](const Snapshot& snapshot) { return FindObject(snapshot, name); });
}

Result<std::optional<ObjectRecord>> FindObject(const Snapshot& snapshot, const std::string& name) {
  PageReader& pages = snapshot.pages();
  const Bytes key = ObjectKey(name);
  MTDB_ASSIGN_OR_RETURN(const auto value, snapshot.Find(Table::kCatalog, key));
  if (!value) return std::optional<ObjectRecord>();
  MTDB_ASSIGN_OR_RETURN(const Bytes bytes, pages.ReadWhole(*value, kMaxRecordBytes));
  MTDB_ASSIGN_OR_RETURN(ObjectRecord record,
                        DecodeObjectEntry(key, bytes, EntryPlace(pages.file().path(), key)));
  return std::optional<ObjectRecord>(std::move(record));
}

Result<std::optional<ObjectRecord>> FindObject(WriteTransaction& write, const std::string& path,
                                               const std::string& name) {
  const Bytes key = ObjectKey(name);
  MTDB_ASSIGN_OR_RETURN(const auto value, write.Get(Table::kCatalog, key));
  if (!value) return std::optional<ObjectRecord>();
  MTDB_ASSIGN_OR_RETURN(ObjectRecord record, DecodeObjectEntry(key, *value, EntryPlace(path, key)));
  return std::optional<ObjectRecord>(std::move(record));
}

Status MakeGarbage(WriteTransaction& write, const ObjectRecord& record) {
  const PendingEntry entry{record.name, static_cast<uint32_t>(::getpid())};
  MTDB_RETURN_IF_ERROR(
      write.PutSealed(Table::kCatalog, GarbageKey(record.id), EncodePendingEntry(entry)));
  return write.Delete(Table::kCatalog, ObjectKey(record.name));
}

Status RemoveRemains(Environment& environment, ObjectId id) {
  bool there = false;
  MTDB_RETURN_IF_ERROR(environment.Write([&](WriteTransaction& write) -> Status {
    for (const Bytes& key : {BuildingKey(id), GarbageKey(id)}) {
      MTDB_ASSIGN_OR_RETURN(const auto entry, write.Get(Table::kCatalog, key));
      there = there || entry.has_value();
    }
    return Status::Ok();
  }));
  if (!there) return Status::Ok();
  const Bytes prefix = ObjectPrefix(id);
  for (const Table table : kObjectTables) {
    bool done = false;
    while (!done) {
      MTDB_RETURN_IF_ERROR(environment.Write([&](WriteTransaction& write) -> Status {
        MTDB_ASSIGN_OR_RETURN(done,
                              write.DeletePrefix(table, prefix, kKeysPerRemoval, kBytesPerRemoval));
        return Status::Ok();
      }));
      ReachTestPoint("values removed");
    }
  }
  return environment.Write([&](WriteTransaction& write) -> Status {
    for (const Bytes& key : {BuildingKey(id), GarbageKey(id)}) {
      const Status status = write.Delete(Table::kCatalog, key);
      if (!status.ok() && status.code() != StatusCode::kNotFound) return status;
    }
    return Status::Ok();
  });
}

Status RemoveDead(Environment& environment) {
  // A damaged entry is its own object's trouble: `verify` and `list` tell of it.
  MTDB_ASSIGN_OR_RETURN(const CatalogListing listing,
                        ListCatalog(environment, [](const Status&) {}));
  std::vector<ObjectId> candidates;
  for (const auto& [id, entry] : listing.building) candidates.push_back(id);
  for (const auto& [id, entry] : listing.garbage) candidates.push_back(id);
  for (const ObjectId id : candidates) {
    MTDB_ASSIGN_OR_RETURN(const auto lock, BuilderLock::TryAcquire(environment.real_path(), id));
    if (!lock) continue;
    MTDB_RETURN_IF_ERROR(RemoveRemains(environment, id));
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
