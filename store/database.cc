// SPDX-License-Identifier: Apache-2.0
#include "store/database.h"

#include <algorithm>
#include <sys/stat.h>

#include "store/base/out_of_memory.h"
#include "store/internal/builder_lock.h"
#include "store/internal/catalog.h"
#include "store/internal/environment.h"
#include "store/internal/meta_page.h"
#include "store/internal/object_reader.h"
#include "store/internal/object_writer.h"
#include "store/internal/open_ranges.h"
#include "store/internal/packed_reader.h"
#include "store/internal/test_hooks.h"
#include "store/object_name.h"

namespace mtdb {

using namespace internal;

namespace {

// Five at most: "bunny, skull, ...".
std::string FirstNames(const std::vector<ObjectRecord>& all) {
  std::string names;
  for (size_t i = 0; i < all.size() && i < 5; ++i) names += (i > 0 ? ", " : "") + all[i].name;
  return names + (all.size() > 5 ? ", ..." : "");
}

Status NoSuchObject(const Database& database, const std::string& name) {
  std::string there = "see list";
  if (const auto all = database.List(); all.ok()) {
    there = all->empty() ? "it holds none" : "it holds " + FirstNames(*all);
  }
  return NotFound(database.path() + ": no object " + name + "; " + there);
}

}  // namespace

Database::Database(std::shared_ptr<Environment> environment, OpenOptions options)
    : environment_(std::move(environment)), options_(std::move(options)) {}

Database::Database(std::shared_ptr<PackedFile> packed, OpenOptions options)
    : packed_(std::move(packed)), options_(std::move(options)) {}

Database::~Database() = default;

Result<std::shared_ptr<Database>> Database::Open(const std::string& path,
                                                 const OpenOptions& options) {
  return CatchOutOfMemory([&]() -> Result<std::shared_ptr<Database>> {
    MTDB_ASSIGN_OR_RETURN(std::shared_ptr<RangeReader> ranges, OpenPackedRanges(path, options));
    if (ranges != nullptr) {
      if (options.writable) {
        return InvalidArgument(ranges->name() +
                               ": a packed file is never changed; unpack it into a store " +
                               "(mtdb unpack)");
      }
      MTDB_ASSIGN_OR_RETURN(auto packed, PackedFile::Open(std::move(ranges)));
      return std::shared_ptr<Database>(new Database(std::move(packed), options));
    }
    MTDB_ASSIGN_OR_RETURN(auto environment, Environment::Open(path, options));
    return std::shared_ptr<Database>(new Database(std::move(environment), options));
  });
}

bool Database::IsUrl(const std::string& path) { return internal::IsUrl(path); }

bool Database::NothingStored(const std::string& path) {
  const auto file = StoreFile::Open(path, StoreFile::Access::kRead);
  return file.ok() && NeverCommitted(**file);
}

const std::string& Database::path() const {
  return packed_ != nullptr ? packed_->ranges().name() : environment_->path();
}

Result<uint64_t> Database::FileBytes() const {
  if (packed_ != nullptr) return packed_->ranges().size();
  return environment_->file().Size();
}

Status Database::CheckWritable() const {
  if (packed_ == nullptr) return Status::Ok();
  return InvalidArgument(path() + ": a packed file is never changed");
}

Result<std::vector<ObjectRecord>> Database::List() const {
  return CatchOutOfMemory([&]() -> Result<std::vector<ObjectRecord>> {
    if (packed_ != nullptr) {
      std::vector<ObjectRecord> records;
      for (const PackedObject& object : packed_->objects()) records.push_back(object.record);
      std::ranges::sort(records, {}, &ObjectRecord::name);
      return records;
    }
    Status first = Status::Ok();
    MTDB_ASSIGN_OR_RETURN(CatalogListing listing,
                          ListCatalog(*environment_, [&](const Status& status) {
                            if (first.ok()) first = status;
                          }));
    MTDB_RETURN_IF_ERROR(first);
    return std::move(listing.objects);
  });
}

Result<ObjectRecord> Database::Find(const std::string& name) const {
  return CatchOutOfMemory([&]() -> Result<ObjectRecord> {
    if (name.empty()) {
      MTDB_ASSIGN_OR_RETURN(std::vector<ObjectRecord> all, List());
      if (all.size() == 1) return std::move(all.front());
      if (all.empty()) return NotFound(path() + ": the store holds no object");
      return InvalidArgument(path() + ": holds " + std::to_string(all.size()) + " objects (" +
                             FirstNames(all) + "); choose one by its name (--name)");
    }
    MTDB_RETURN_IF_ERROR(CheckObjectName(name));
    if (packed_ != nullptr) {
      const auto object = packed_->Find(name);
      if (!object.ok()) return NoSuchObject(*this, name);
      return (*object)->record;
    }
    MTDB_ASSIGN_OR_RETURN(auto record, FindObject(*environment_, name));
    if (!record) return NoSuchObject(*this, name);
    return *std::move(record);
  });
}

Result<std::shared_ptr<ClusterSource>> Database::OpenObject(const std::string& name,
                                                            bool whole_index) const {
  return CatchOutOfMemory([&]() -> Result<std::shared_ptr<ClusterSource>> {
    MTDB_ASSIGN_OR_RETURN(const ObjectRecord record, Find(name));
    if (packed_ != nullptr) {
      MTDB_ASSIGN_OR_RETURN(const PackedObject* const object, packed_->Find(record.name));
      const bool whole = whole_index || packed_->ranges().answers_at_once();
      return PackedSource::Open(packed_, *object, whole);
    }
    return ObjectReader::Open(environment_, record.name);
  });
}

Result<std::vector<std::shared_ptr<ClusterSource>>> Database::OpenAll() const {
  using Sources = std::vector<std::shared_ptr<ClusterSource>>;
  return CatchOutOfMemory([&]() -> Result<Sources> {
    if (packed_ != nullptr) {
      Sources sources;
      for (const PackedObject& object : packed_->objects()) {
        MTDB_ASSIGN_OR_RETURN(sources.emplace_back(), OpenObject(object.record.name, true));
      }
      std::ranges::sort(sources, {}, [](const auto& s) { return s->record().name; });
      return sources;
    }
    MTDB_ASSIGN_OR_RETURN(const Snapshot snapshot, environment_->NewestPinned());
    Sources sources;
    if (!snapshot.pinned()) {
      MTDB_ASSIGN_OR_RETURN(const std::vector<ObjectRecord> records, List());
      for (const ObjectRecord& r : records) {
        MTDB_ASSIGN_OR_RETURN(sources.emplace_back(), ObjectReader::Open(environment_, r.name));
      }
      return sources;
    }
    Status first = Status::Ok();
    CatalogListing listing;
    MTDB_RETURN_IF_ERROR(ListCatalog(snapshot, &listing, [&](const Status& status) {
      if (first.ok()) first = status;
    }));
    MTDB_RETURN_IF_ERROR(first);
    for (ObjectRecord& r : listing.objects) {
      MTDB_ASSIGN_OR_RETURN(sources.emplace_back(),
                            ObjectReader::OpenPinned(environment_, std::move(r), snapshot));
    }
    return sources;
  });
}

Result<uint64_t> Database::FreeBytes() const {
  return CatchOutOfMemory([&]() -> Result<uint64_t> {
    if (packed_ != nullptr) return uint64_t{0};
    return environment_->Read([](const Snapshot& snapshot) { return snapshot.CountFreeBytes(); });
  });
}

bool Database::IsOutdated() const {
  if (packed_ != nullptr) return packed_->ranges().IsOutdated();
  struct stat info {};
  const StoreFile& file = environment_->file();
  return ::stat(path().c_str(), &info) != 0 || info.st_dev != file.device() ||
         info.st_ino != file.inode();
}

Result<std::unique_ptr<ObjectWriter>> Database::Create(const std::string& name, bool replace) {
  return CatchOutOfMemory([&]() -> Result<std::unique_ptr<ObjectWriter>> {
    MTDB_RETURN_IF_ERROR(CheckWritable());
    return StoreObjectWriter::Create(environment_, name, replace);
  });
}

Status Database::Rename(const std::string& name, const std::string& new_name) {
  return CatchOutOfMemory([&]() -> Status {
    MTDB_RETURN_IF_ERROR(CheckObjectName(name));
    MTDB_RETURN_IF_ERROR(CheckObjectName(new_name));
    MTDB_RETURN_IF_ERROR(CheckWritable());
    if (!environment_->writable()) {
      return InvalidArgument(path() + ": opened for reading; open it writable");
    }
    return environment_->Write([&](WriteTransaction& write) -> Status {
      MTDB_ASSIGN_OR_RETURN(auto record, FindObject(write, path(), name));
      if (!record) return NoSuchObject(*this, name);
      if (name == new_name) return Status::Ok();
      MTDB_ASSIGN_OR_RETURN(const auto other, FindObject(write, path(), new_name));
      if (other) {
        return {StatusCode::kAlreadyExists,
                path() + ": object " + new_name + " is there; choose another name, or remove it"};
      }
      record->name = new_name;
      MTDB_RETURN_IF_ERROR(write.Delete(Table::kCatalog, ObjectKey(name)));
      MTDB_RETURN_IF_ERROR(
          write.PutSealed(Table::kCatalog, ObjectKey(new_name), EncodeObjectRecord(*record)));
      ReachTestPoint("catalog put");
      return Status::Ok();
    });
  });
}

Status Database::Remove(const std::string& name) {
  return CatchOutOfMemory([&]() -> Status {
    MTDB_RETURN_IF_ERROR(CheckObjectName(name));
    MTDB_RETURN_IF_ERROR(CheckWritable());
    if (!environment_->writable()) {
      return InvalidArgument(path() + ": opened for reading; open it writable");
    }
    ObjectId id;
    std::optional<BuilderLock> lock;  // keeps another Create from doing the same work
    MTDB_RETURN_IF_ERROR(environment_->Write([&](WriteTransaction& write) -> Status {
      MTDB_ASSIGN_OR_RETURN(const auto record, FindObject(write, path(), name));
      if (!record) return NoSuchObject(*this, name);
      id = record->id;
      lock.reset();
      MTDB_ASSIGN_OR_RETURN(lock, BuilderLock::TryAcquire(environment_->real_path(), id));
      return MakeGarbage(write, *record);
    }));
    ReachTestPoint("removed");
    return RemoveRemains(*environment_, id);
  });
}

}  // namespace mtdb
