// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/object_reader.h"

#include <algorithm>
#include <functional>
#include <optional>

#include "store/base/hash.h"
#include "store/base/out_of_memory.h"
#include "store/lmdb/catalog.h"
#include "store/records/no_such_object.h"
#include "store/records/page_parts.h"

namespace mtdb::internal {
namespace {

constexpr int kTries = 200;
constexpr size_t kResolvedValues = 1 << 16;

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

Result<Bytes> ReadTexturePart(const Snapshot& snapshot, const ObjectRecord& record, uint32_t file,
                              uint32_t part, const std::string& where) {
  const std::string place =
      where + ": " + TextureFileLabel(record, file) + ": part " + std::to_string(part);
  const Bytes key = TextureKey(record.id, file, part);
  MTDB_ASSIGN_OR_RETURN(const auto value, snapshot.Find(Table::kTextures, key));
  if (!value) return Corrupt(place + " is missing; run verify, restore the file from a copy");
  const uint64_t left = record.texture->file(file).bytes - uint64_t{part} * kPagePartBytes;
  const uint64_t expected = std::min<uint64_t>(left, kPagePartBytes);
  if (value->size != kChecksumBytes + expected) {
    return Corrupt(place + ", offset " + std::to_string(value->file_offset) +
                   " of the file: expected " + std::to_string(kChecksumBytes + expected) +
                   " bytes, found " + std::to_string(value->size));
  }
  MTDB_ASSIGN_OR_RETURN(Bytes bytes, snapshot.pages().ReadWhole(*value, value->size));
  MTDB_RETURN_IF_ERROR(
      OpenValue(Table::kTextures, key, bytes,
                place + ", offset " + std::to_string(value->file_offset) + " of the file")
          .status());
  bytes.erase(bytes.begin(), bytes.begin() + kChecksumBytes);
  return bytes;
}

Result<std::shared_ptr<ClusterSource>> ObjectReader::Open(std::shared_ptr<Environment> environment,
                                                          const std::string& name) {
  const std::string& path = environment->path();
  for (int i = 0; i < kTries; ++i) {
    MTDB_ASSIGN_OR_RETURN(auto record, FindObject(*environment, name));
    if (!record) {
      MTDB_ASSIGN_OR_RETURN(const CatalogListing all,
                            ListCatalog(*environment, [](const Status&) {}));
      return NoSuchObject(path, name, all.objects, std::identity());
    }
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

Result<std::shared_ptr<ClusterSource>> ObjectReader::OpenPinned(
    std::shared_ptr<Environment> environment, ObjectRecord record, const Snapshot& snapshot) {
  MTDB_ASSIGN_OR_RETURN(
      ClusterIndex index,
      LoadIndex(environment->path(), record, [&](const Bytes& key, const std::string& place) {
        return ReadIndexValue(snapshot, key, place);
      }));
  std::shared_ptr<ObjectReader> reader(
      new ObjectReader(std::move(environment), std::move(record), std::move(index)));
  reader->pinned_ = snapshot;
  return std::shared_ptr<ClusterSource>(std::move(reader));
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

Result<ValueRef> ObjectReader::FindValue(const Snapshot& snapshot, uint32_t value) {
  {
    const std::lock_guard lock(mutex_);
    if (resolved_.state != snapshot.state().serial || resolved_.values.size() > kResolvedValues) {
      // An older snapshot's reader may undo a newer one's work here, never mix with it.
      resolved_.state = snapshot.state().serial;
      resolved_.values.clear();
    }
    const auto it = resolved_.values.find(value);
    if (it != resolved_.values.end()) return it->second;
  }
  MTDB_ASSIGN_OR_RETURN(const auto found, snapshot.Find(Table::kUnits, keys_[value]));
  if (!found) {
    return Corrupt(place_ + ": value " + std::to_string(value) +
                   " of its units: missing; run verify");
  }
  const std::lock_guard lock(mutex_);
  if (resolved_.state == snapshot.state().serial) resolved_.values.emplace(value, *found);
  return *found;
}

Result<Bytes> ObjectReader::ReadOne(const Snapshot& snapshot, UnitId unit) {
  const PayloadLocation& location = index_.location(unit);
  MTDB_ASSIGN_OR_RETURN(const ValueRef value, FindValue(snapshot, location.value));
  const UnitEntry& entry = index_.unit(unit);
  return ReadPayload(snapshot.pages(), value, location, UnitSeed(unit, entry.round, entry.hilbert),
                     place_ + ": " + UnitLabel(record_, unit));
}

// What the checksum proves is right, whatever has become of the snapshot. Anything else is looked
// at in a newer one, if writers have used its pages again, and once without the pages that were
// read before.
Result<Bytes> ObjectReader::ReadProven(const ReadProof& read, Snapshot* snapshot) {
  bool fresh = false;
  for (int i = 0; i < kTries; ++i) {
    auto proven = read(*snapshot);
    if (proven.ok()) return proven;
    MTDB_ASSIGN_OR_RETURN(const bool held, environment_->Holds(*snapshot));
    if (held && fresh) return Explain(proven.status());
    fresh = held;
    MTDB_ASSIGN_OR_RETURN(*snapshot, environment_->Newest(fresh));
  }
  return Status(StatusCode::kBusy, place_ + ": writers are too fast for this reader; try again");
}

void ObjectReader::Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) {
  std::optional<Result<Snapshot>> snapshot;  // the newest, or why there is none
  // In the order of their places in the file.
  std::vector<UnitId> order(units.begin(), units.end());
  std::ranges::sort(order);
  for (const UnitId unit : order) {
    receiver->Receive(unit, CatchOutOfMemory([&]() -> Result<Bytes> {
                        if (unit >= index_.unit_count()) {
                          return InvalidArgument(place_ + ": no unit " + std::to_string(unit) +
                                                 ", it has " + std::to_string(index_.unit_count()));
                        }
                        if (pinned_) return ReadOne(*pinned_, unit);
                        if (!snapshot) snapshot.emplace(environment_->Newest());
                        if (!snapshot->ok()) return snapshot->status();
                        return ReadProven([&](const Snapshot& s) { return ReadOne(s, unit); },
                                          &**snapshot);
                      }));
  }
}

Result<Bytes> ObjectReader::ReadTextureFile(uint32_t file, uint64_t offset, uint64_t bytes) {
  return CatchOutOfMemory([&]() -> Result<Bytes> {
    MTDB_RETURN_IF_ERROR(CheckFileRange(record_, file, offset, bytes, place_));
    if (bytes == 0) return Bytes();
    MTDB_ASSIGN_OR_RETURN(Bytes read, ReadParts(file, offset, bytes));
    if (bytes < record_.texture->file(file).bytes) return read;
    const Status status = CheckFileChecksum(record_, file, Hash64(read), place_);
    // The parts are whole, but of another object: another store was copied over the file.
    if (!status.ok()) return pinned_ ? status : Explain(status);
    return read;
  });
}

Result<Bytes> ObjectReader::ReadParts(uint32_t file, uint64_t offset, uint64_t bytes) {
  std::optional<Snapshot> newest;
  if (!pinned_) {
    MTDB_ASSIGN_OR_RETURN(newest, environment_->Newest());
  }
  // A record may claim more than there is.
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, environment_->file().Size());
  Bytes read;
  read.reserve(std::min(bytes, file_bytes));
  const uint64_t end = offset + bytes;
  for (auto part = static_cast<uint32_t>(offset / kPagePartBytes); read.size() < bytes; ++part) {
    const auto read_part = [&](const Snapshot& snapshot) {
      return ReadTexturePart(snapshot, record_, file, part, place_);
    };
    MTDB_ASSIGN_OR_RETURN(const Bytes found,
                          pinned_ ? read_part(*pinned_) : ReadProven(read_part, &*newest));
    const uint64_t begin = uint64_t{part} * kPagePartBytes;
    const uint64_t from = std::max(offset, begin) - begin;
    const uint64_t to = std::min<uint64_t>(end - begin, found.size());
    read.insert(read.end(), found.begin() + static_cast<ptrdiff_t>(from),
                found.begin() + static_cast<ptrdiff_t>(to));
  }
  return read;
}

}  // namespace mtdb::internal
