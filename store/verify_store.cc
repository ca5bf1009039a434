// SPDX-License-Identifier: Apache-2.0
#include "store/verify_store.h"

#include <algorithm>
#include <map>
#include <set>

#include "store/base/running_hash.h"
#include "store/lmdb/catalog.h"
#include "store/lmdb/environment.h"
#include "store/lmdb/object_index.h"
#include "store/lmdb/object_reader.h"
#include "store/packed/open_ranges.h"
#include "store/packed/verify_packed.h"
#include "store/pages/page_walker.h"
#include "store/pages/store_check.h"
#include "store/records/no_such_object.h"
#include "store/records/object_digest.h"
#include "store/records/page_parts.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr size_t kMaxFailures = 200;
constexpr int kTries = 5;

class StoreVerifier {
 public:
  StoreVerifier(const Snapshot& snapshot, CheckReport* report, std::function<bool()> stopped)
      : snapshot_(snapshot),
        path_(snapshot.pages().file().path()),
        report_(report),
        stopped_(std::move(stopped)) {}

  void Run(const std::string& object) {
    CheckCatalog();
    CheckPages();
    CheckOwners();
    size_t checked = 0;
    for (const ObjectRecord& record : listing_.objects) {
      if (Stopped()) return;
      if (!object.empty() && record.name != object) continue;
      ++checked;
      CheckObject(record);
    }
    if (object.empty() || checked > 0) return;
    Fail(NoSuchObject(path_, object, listing_.objects, std::identity()).message());
  }

 private:
  bool Stopped() const { return stopped_ && stopped_(); }
  void Fail(std::string message) {
    if (report_->failures.size() < kMaxFailures) report_->failures.push_back(std::move(message));
  }
  void Fail(const Status& status) { Fail(status.message()); }
  void Checked(std::string what) { report_->checks.push_back(std::move(what)); }

  void CheckCatalog() {
    const Status status =
        ListCatalog(snapshot_, &listing_, [&](const Status& failure) { Fail(failure); });
    if (!status.ok()) Fail(status);
    for (const ObjectRecord& o : listing_.objects) {
      AddOwner(o.id);
      published_.insert(o.id);
    }
    for (const auto& [id, entry] : listing_.building) AddOwner(id);
    for (const auto& [id, entry] : listing_.garbage) AddOwner(id);
    Checked("catalog: " + std::to_string(listing_.objects.size()) + " objects, " +
            std::to_string(listing_.building.size()) + " being built, " +
            std::to_string(listing_.garbage.size()) + " being removed");
  }

  void AddOwner(ObjectId id) {
    if (!owners_.insert(id).second) {
      Fail(path_ + ": catalog: object id " + std::to_string(id.value) + " is there twice");
    }
  }

  void CheckPages() {
    WalkOptions options;
    options.stopped = stopped_;
    options.may_be_stale = [&](Table table, ByteSpan key) {
      if (table == Table::kCatalog) return true;
      ByteReader r(key);
      const ObjectId id{r.GetBigEndian<uint64_t>()};
      // A removal that is under way, or was cut short, leaves them while its entry is there.
      return r.failed() || !published_.contains(id);
    };
    WalkReport walk = WalkPages(snapshot_.pages(), options);
    for (std::string& failure : walk.failures) Fail(std::move(failure));
    Checked("pages: " + std::to_string(walk.tree_pages) + " of trees, " +
            std::to_string(walk.overflow_pages) + " of values, " + std::to_string(walk.free_pages) +
            " free, 2 meta");
  }

  // Every key belongs to an object of the catalog.
  void CheckOwners() {
    for (const Table table : kObjectTables) {
      std::set<ObjectId> strangers;
      const Status status =
          snapshot_.Scan(table, {}, [&](ByteSpan key, const ValueRef&) -> Result<bool> {
            if (Stopped()) return false;
            ByteReader r(key);
            const ObjectId id{r.GetBigEndian<uint64_t>()};
            ++values_[{table, id}];
            if (r.failed() || !owners_.contains(id)) strangers.insert(id);
            return true;
          });
      const std::string place = path_ + ": " + kTableNames[static_cast<size_t>(table)] + ": ";
      if (!status.ok()) Fail(status);
      for (const ObjectId id : strangers) {
        Fail(place + "values of object " + std::to_string(id.value) +
             ", which is not in the catalog");
      }
    }
    Checked("values belong to objects of the catalog");
  }

  void CheckObject(const ObjectRecord& record) {
    const std::string place = ObjectPlace(path_, record);
    ObjectDigest digest;
    uint64_t index_values = 0;
    const auto index = LoadIndex(
        path_, record,
        [&](const Bytes& key, const std::string& at) -> Result<Bytes> {
          if (Stopped()) return Status{StatusCode::kCancelled, place};
          return ReadIndexValue(snapshot_, key, at);
        },
        [&](uint32_t first, ByteSpan body) {
          ++index_values;
          digest.AddIndexValue(first, body);
        });
    if (!index.ok()) {
      Fail(index.status());
      return;
    }
    const ValueKeys keys(record.id, *index);
    CheckCount(place + ": values of its index", index_values, Table::kIndex, record.id);
    CheckCount(place + ": values of its units", keys.count(), Table::kUnits, record.id);
    CheckCounts(record, *index, place);

    CheckTexture(record, place);

    uint64_t payload_bytes = 0;
    bool whole = true;
    for (UnitId unit = 0; unit < index->unit_count(); ++unit) {
      if (Stopped()) return;
      const UnitEntry& entry = index->unit(unit);
      const PayloadLocation& location = index->location(unit);
      const bool ends_value =
          unit + 1 == index->unit_count() || index->location(unit + 1).offset == 0;
      const auto payload = ReadPayload(keys[location.value], location, ends_value,
                                       UnitSeed(unit, entry.round, entry.hilbert),
                                       place + ": " + UnitLabel(record, unit));
      whole = whole && payload.ok();
      if (!payload.ok()) {
        Fail(payload.status());
        continue;
      }
      payload_bytes += payload->size();
      digest.AddUnit(unit, entry.round, entry.hilbert, *payload);
    }
    Checked(record.name + ": checksums of " + std::to_string(record.clusters) + " clusters and " +
            std::to_string(record.root_pieces) + " root pieces");
    if (!whole) return;
    digest.AddRecord(record);
    if (payload_bytes != record.payload_bytes) {
      Fail(place + ": payload bytes: expected " + std::to_string(record.payload_bytes) +
           " of its record, found " + std::to_string(payload_bytes));
    }
    if (digest.low() != record.digest_low || digest.high() != record.digest_high) {
      Fail(place + ": digest: expected " + record.digest_hex() + " of its record, found another");
    }
    Checked(record.name + ": index, counts and digest");
  }

  void CheckTexture(const ObjectRecord& record, const std::string& place) {
    const uint32_t files = record.texture ? record.texture->files() : 0;
    uint64_t parts = 0;
    for (uint32_t file = 0; file < files; ++file) {
      parts += PartsOfPage(record.texture->file(file).bytes);
    }
    const size_t failures = report_->failures.size();
    CheckCount(place + ": values of its texture", parts, Table::kTextures, record.id);
    for (uint32_t file = 0; file < files; ++file) {
      if (const Status status = CheckTextureFile(record, file, place); !status.ok()) Fail(status);
      if (Stopped()) return;
    }
    if (!record.texture || report_->failures.size() != failures) return;
    Checked(record.name + ": checksums of " + std::to_string(files - 1) +
            (files == 2 ? " page" : " pages") + " of its texture, and of its tiles");
  }

  Status CheckTextureFile(const ObjectRecord& record, uint32_t file, const std::string& place) {
    const uint64_t size = record.texture->file(file).bytes;
    if (size == 0) return Status::Ok();
    RunningHash hash;
    for (uint32_t part = 0; part < PartsOfPage(size); ++part) {
      if (Stopped()) return Status::Ok();
      MTDB_ASSIGN_OR_RETURN(const Bytes bytes,
                            ReadTexturePart(snapshot_, record, file, part, place));
      hash.Add(bytes);
    }
    return CheckFileChecksum(record, file, hash.value(), place);
  }

  void CheckCount(const std::string& what, uint64_t expected, Table table, ObjectId id) {
    const auto it = values_.find({table, id});
    const uint64_t found = it == values_.end() ? 0 : it->second;
    if (found == expected) return;
    Fail(what + ": expected " + std::to_string(expected) + ", found " + std::to_string(found));
  }

  void CheckCounts(const ObjectRecord& record, const ClusterIndex& index,
                   const std::string& place) {
    uint64_t nodes = 0;
    uint64_t triangles = 0;
    for (UnitId unit = 0; unit < index.unit_count(); ++unit) {
      nodes += index.unit(unit).nodes;
      if (unit >= index.cluster_count()) triangles += index.unit(unit).out_triangles;
    }
    const auto compare = [&](const char* what, uint64_t expected, uint64_t found) {
      if (expected == found) return;
      Fail(place + ": " + what + ": expected " + std::to_string(expected) +
           " of its record, found " + std::to_string(found) + " in its index");
    };
    compare("nodes", record.nodes, nodes);
    compare("root triangles", record.root_triangles, triangles);
  }

  // As a reader reads it; besides, the last payload of a value must reach the value's end.
  Result<Bytes> ReadPayload(const Bytes& key, const PayloadLocation& location, bool ends_value,
                            uint64_t seed, const std::string& where) {
    MTDB_ASSIGN_OR_RETURN(const auto value, snapshot_.Find(Table::kUnits, key));
    if (!value) return Corrupt(where + ": its value is missing");
    const uint64_t end = uint64_t{location.offset} + location.length;
    if (ends_value && end != value->size) {
      return Corrupt(where + ": expected the value's end at byte " + std::to_string(end) +
                     ", found " + std::to_string(value->size));
    }
    return mtdb::ReadPayload(snapshot_.pages(), *value, location, seed, where);
  }

  const Snapshot& snapshot_;
  const std::string path_;
  CheckReport* report_;
  const std::function<bool()> stopped_;
  CatalogListing listing_;
  std::set<ObjectId> owners_;     // every object of the catalog
  std::set<ObjectId> published_;  // those that readers see
  std::map<std::pair<Table, ObjectId>, uint64_t> values_;
};

}  // namespace

Status VerifyStore(const std::string& path, const std::string& object, CheckReport* report,
                   const std::function<bool()>& stopped, const OpenOptions& options) {
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<RangeReader> ranges, OpenPackedRanges(path, options));
  if (ranges != nullptr) return VerifyPacked(std::move(ranges), object, report, stopped);
  // A store that cannot even be opened is a finding; a file that is none is an error, as is one of
  // a version that mtdb does not know.
  const auto environment = Environment::Open(path, {});
  if (!environment.ok()) {
    if (environment.status().code() != StatusCode::kCorrupt) return environment.status();
    report->failures.push_back(environment.status().message());
    return Status::Ok();
  }
  // Even when this process has it open since before somebody changed it.
  if (const Status status = CheckStoreFile((*environment)->file()); !status.ok()) {
    report->failures.push_back(status.message());
    return Status::Ok();
  }
  report->checks.push_back("meta pages, size of the file, superblock");
  for (int i = 0; i < kTries; ++i) {
    const auto snapshot = (*environment)->NewestPinned();
    if (!snapshot.ok()) {
      if (snapshot.status().code() != StatusCode::kCorrupt) return snapshot.status();
      report->failures.push_back(snapshot.status().message());
      return Status::Ok();
    }
    CheckReport found = *report;
    // Once it has stopped, all that comes after stops too.
    bool cancelled = false;
    const auto ask = [&] { return cancelled = cancelled || (stopped && stopped()); };
    StoreVerifier(*snapshot, &found, ask).Run(object);
    if (cancelled) return {StatusCode::kCancelled, path + ": the check was cancelled"};
    const auto held = (*environment)->Holds(*snapshot);
    if (held.ok() && !*held) continue;
    *report = std::move(found);
    if (!held.ok()) report->failures.push_back(held.status().message());
    return Status::Ok();
  }
  return {StatusCode::kBusy,
          path +
              ": it is being written, and its lock file cannot be used to keep a snapshot for "
              "that long: verify it when nobody writes, or as a user who may write both files"};
}

}  // namespace mtdb
