// SPDX-License-Identifier: Apache-2.0
#include "store/copy.h"

#include <algorithm>
#include <cstdlib>
#include <sys/stat.h>

#include "store/base/out_of_memory.h"
#include "store/lmdb/name_claim.h"
#include "store/lmdb/partial_store.h"
#include "store/lmdb/test_hooks.h"
#include "store/texture_pages.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr size_t kUnitsAtOnce = 64;

uint64_t BytesToCopy(const ObjectRecord& record) {
  return record.payload_bytes + TextureBytes(record);
}

Status CopyUnits(ClusterSource& source, ObjectWriter& writer, const CopyProgress& progress) {
  const ClusterIndex& index = source.index();
  const uint64_t total = BytesToCopy(source.record());
  uint64_t done = 0;
  std::vector<UnitId> batch;
  for (UnitId first = 0; first < index.unit_count(); first += static_cast<UnitId>(batch.size())) {
    batch.clear();
    while (batch.size() < kUnitsAtOnce && first + batch.size() < index.unit_count()) {
      batch.push_back(first + static_cast<UnitId>(batch.size()));
    }
    std::vector<Bytes> payloads(batch.size());
    MTDB_RETURN_IF_ERROR(ReadUnits(source, batch, [&](UnitId unit, Bytes payload) {
      payloads[unit - first] = std::move(payload);
      return Status::Ok();
    }));
    for (const UnitId unit : batch) {
      const Bytes& payload = payloads[unit - first];
      MTDB_RETURN_IF_ERROR(writer.Add(index.unit(unit), index.children(unit), payload).status());
      done += payload.size();
    }
    if (progress) MTDB_RETURN_IF_ERROR(progress(done, total));
  }
  return Status::Ok();
}

Status CopyTexture(ClusterSource& source, ObjectWriter& writer, const CopyProgress& progress) {
  const ObjectRecord& record = source.record();
  if (!record.texture) return Status::Ok();
  uint64_t done = record.payload_bytes;
  for (uint32_t file = 0; file < record.texture->files(); ++file) {
    const auto add = [&](ByteSpan part) {
      MTDB_RETURN_IF_ERROR(writer.AddTextureFile(file, part));
      done += part.size();
      return progress ? progress(done, BytesToCopy(record)) : Status::Ok();
    };
    MTDB_RETURN_IF_ERROR(ReadTextureFile(source, file, add));
  }
  return Status::Ok();
}

// The progress of one object among all.
CopyProgress Shifted(const CopyProgress& progress, uint64_t before, uint64_t total) {
  if (!progress) return {};
  return [=](uint64_t done, uint64_t) { return progress(before + done, total); };
}

// Into the store at `path`, which is made when it is not there, and closed.
Status Fill(const ObjectSources& objects, const std::string& path, bool replace,
            const CopyProgress& progress) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> target,
                        Database::Open(path, {.writable = true}));
  uint64_t total = 0, before = 0;
  for (const auto& object : objects) total += BytesToCopy(object->record());
  for (const auto& object : objects) {
    MTDB_RETURN_IF_ERROR(CopyObject(*object, *target, object->record().name, replace,
                                    Shifted(progress, before, total))
                             .status());
    before += BytesToCopy(object->record());
  }
  return Status::Ok();
}

Result<std::string> RealPath(const std::string& path) {
  const std::unique_ptr<char, decltype(&std::free)> real(::realpath(path.c_str(), nullptr),
                                                         &std::free);
  if (real == nullptr) return NotFound(path + ": no such file; check the store's path");
  return std::string(real.get());
}

Result<CompactReport> Compact(const std::string& path, const CopyProgress& progress) {
  MTDB_ASSIGN_OR_RETURN(const std::string real, RealPath(path));
  // A file that is no store is said to be none before anything is made beside it.
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> opened, Database::Open(real));
  if (opened->is_packed()) return Unsupported(path + ": a packed file has no free space");
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<NameClaim> alone, NameClaim::AcquireAlone(real));
  struct stat info {};
  if (::fstat(alone->file().descriptor(), &info) == 0 && info.st_nlink > 1) {
    return Unsupported(path + ": the file has " + std::to_string(info.st_nlink) +
                       " names (hard links), and the others would keep the old file; remove them, "
                       "or copy the store");
  }
  CompactReport report;
  MTDB_ASSIGN_OR_RETURN(report.bytes_before, alone->file().Size());
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<PartialStore> partial, PartialStore::Create(real));
  MTDB_RETURN_IF_ERROR(partial->AdoptPermissions(alone->file()));
  {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database, Database::Open(real));
    MTDB_ASSIGN_OR_RETURN(std::vector<ObjectRecord> records, database->List());
    // As they came into the store. Nothing is pinned: nobody writes, and a pin would wait for us.
    std::ranges::sort(records, {}, [](const ObjectRecord& r) { return r.id.value; });
    ObjectSources objects;
    for (const ObjectRecord& r : records) {
      MTDB_ASSIGN_OR_RETURN(objects.emplace_back(), database->OpenObject(r.name));
    }
    MTDB_RETURN_IF_ERROR(Fill(objects, partial->partial_path(), false, progress));
  }
  ReachTestPoint("partial written");
  MTDB_ASSIGN_OR_RETURN(const auto written,
                        StoreFile::Open(partial->partial_path(), StoreFile::Access::kRead));
  MTDB_ASSIGN_OR_RETURN(report.bytes_after, written->Size());
  if (report.bytes_after >= report.bytes_before) {  // there was nothing to gain
    report.bytes_after = report.bytes_before;
    return report;
  }
  MTDB_RETURN_IF_ERROR(partial->Commit(true));
  ReachTestPoint("partial renamed");
  return report;
}

}  // namespace

Result<ObjectRecord> CopyObject(ClusterSource& source, Database& target, const std::string& name,
                                bool replace, const CopyProgress& progress) {
  return CatchOutOfMemory([&]() -> Result<ObjectRecord> {
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ObjectWriter> writer, target.Create(name, replace));
    MTDB_RETURN_IF_ERROR(CopyUnits(source, *writer, progress));
    MTDB_RETURN_IF_ERROR(CopyTexture(source, *writer, progress));
    const ObjectRecord& from = source.record();
    return writer->Publish(from, [&](const ObjectRecord& copy) {
      if (copy.digest_low == from.digest_low && copy.digest_high == from.digest_high) {
        return Status::Ok();
      }
      return Corrupt("object " + from.name + ": its digest is " + copy.digest_hex() +
                     ", but its record says " + from.digest_hex() +
                     "; run verify on its store, and restore it from a copy");
    });
  });
}

Status CopyToNewStore(const ObjectSources& objects, const std::string& path,
                      const CopyProgress& progress) {
  return CatchOutOfMemory([&]() -> Status {
    struct stat info {};
    if (::lstat(path.c_str(), &info) == 0) {
      return {StatusCode::kAlreadyExists, path + ": is there already"};
    }
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<PartialStore> partial, PartialStore::Create(path));
    MTDB_RETURN_IF_ERROR(Fill(objects, partial->partial_path(), false, progress));
    ReachTestPoint("partial written");
    return partial->Commit(false);
  });
}

Result<CompactReport> CompactStore(const std::string& path, const CopyProgress& progress) {
  return CatchOutOfMemory([&] { return Compact(path, progress); });
}

Status CopyToStore(const ObjectSources& objects, const std::string& path, bool replace,
                   const CopyProgress& progress) {
  struct stat info {};
  if (::lstat(path.c_str(), &info) != 0) return CopyToNewStore(objects, path, progress);
  return CatchOutOfMemory([&] { return Fill(objects, path, replace, progress); });
}

}  // namespace mtdb
