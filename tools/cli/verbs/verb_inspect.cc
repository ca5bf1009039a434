// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/mesh_file/mesh_file.h"
#include "query/heights.h"
#include "query/surface.h"
#include "query/verify_object.h"
#include "store/base/redact.h"
#include "store/database.h"
#include "store/verify_store.h"
#include "tools/cli/grouped.h"
#include "tools/cli/mesh_report.h"
#include "tools/cli/options.h"
#include "tools/cli/raster_ingest.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/ingest_arguments.h"
#include "tools/cli/verbs/ingest_journal.h"
#include "tools/client/printable.h"
#include "tools/request/arguments.h"
#include "tools/request/report_json.h"
#include "tools/tiles/verify/verify_tiles.h"

namespace mtdb {

namespace {

struct InspectArguments {
  std::string store;
  OpenOptions open;
  std::string name;
  std::string level = "fast";  // verify
  bool streams = false;        // info: read all payloads, and tell what their streams take
  std::string format;          // info: of a mesh on standard input
  std::string tmp;             // list: where journals lie; empty: the store's folder
  bool json = false;
};
constexpr uint64_t kMuchFreeSpace = uint64_t{1} << 20;

using BitsPerVertex = std::map<std::string, double>;

// What the streams of all clusters take, by name, and the root pieces.
Result<BitsPerVertex> MeasureStreams(const Database& database, const ObjectRecord& record) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<ClusterSource> source,
                        database.OpenObject(record.name));
  std::map<std::string, uint64_t> bytes;
  std::vector<UnitId> clusters;
  for (uint32_t i = 0; i < record.clusters; ++i) clusters.push_back(i);
  MTDB_RETURN_IF_ERROR(ReadUnits(*source, clusters, [&](UnitId, const Bytes& payload) {
    uint64_t listed = 0;
    for (const StreamSize& s : ClusterStreamSizes(payload)) {
      bytes[s.name] += s.coded_bytes;
      listed += s.coded_bytes;
    }
    bytes["directory"] += payload.size() - listed;
    return Status::Ok();
  }));
  uint64_t sum = 0;
  for (const auto& [name, n] : bytes) sum += n;
  bytes["root"] = record.payload_bytes - sum;
  BitsPerVertex bits;
  for (const auto& [name, n] : bytes) {
    bits[name] = 8.0 * static_cast<double>(n) / static_cast<double>(record.vertices);
  }
  return bits;
}

Json JournalsJson(const std::vector<IngestJournal>& journals) {
  Json list = Json::Array();
  for (const IngestJournal& j : journals) {
    list.push_back({{"object", j.object},
                    {"running", j.running},
                    {"journal", j.path},
                    {"bytes", j.bytes},
                    {"folder", j.folder},
                    {"resume", j.command}});
  }
  return list;
}

// A journal's texts come from a file that anybody may have written.
void PrintJournal(const IngestJournal& j) {
  const std::string object = j.object.empty() ? "an object" : Printable(j.object);
  const double megabytes = static_cast<double>(j.bytes) / 1e6;
  if (j.running) {
    std::printf("  being ingested: %s; its journal %s has %.1f MB\n", object.c_str(),
                Printable(j.path).c_str(), megabytes);
    return;
  }
  std::printf("  interrupted: the ingest of %s; its journal %s has %.1f MB\n", object.c_str(),
              Printable(j.path).c_str(), megabytes);
  if (!j.command.empty()) {
    std::printf("    to go on, in %s: %s\n", Printable(j.folder).c_str(),
                Printable(j.command).c_str());
  }
  std::printf("    to give it up: rm %s\n", QuoteForShell(Printable(j.path)).c_str());
}

Status Info(const InspectArguments& arguments) {
  MTDB_RETURN_IF_ERROR(CheckNoPicture({arguments.store}));
  const bool is_input = IsMeshFile(arguments.store) || IsRaster(arguments.store);
  if (arguments.store == "-" ||
      (is_input && !Database::Open(arguments.store, arguments.open).ok())) {
    IngestArguments mesh;
    mesh.inputs = {arguments.store};
    mesh.format = arguments.format;
    mesh.tmp = std::filesystem::temp_directory_path().string();
    mesh.json = arguments.json;
    return Survey(mesh);
  }
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, database->FileBytes());
  std::vector<ObjectRecord> records;
  if (arguments.name.empty()) {
    MTDB_ASSIGN_OR_RETURN(records, database->List());
  } else {
    MTDB_ASSIGN_OR_RETURN(ObjectRecord record, database->Find(arguments.name));
    records.push_back(std::move(record));
  }
  if (arguments.json) {
    Json objects = Json::Array();
    for (const ObjectRecord& r : records) {
      Json& object = objects.push_back(RecordJson(r, file_bytes));
      if (!arguments.streams) continue;
      MTDB_ASSIGN_OR_RETURN(const BitsPerVertex bits, MeasureStreams(*database, r));
      Json& json = object["stream_bits_per_vertex"] = Json::Object();
      for (const auto& [name, n] : bits) json[name] = n;
    }
    PrintAnswer("info",
                {{"store", arguments.store}, {"file_bytes", file_bytes}, {"objects", objects}});
    return Status::Ok();
  }
  for (const ObjectRecord& r : records) {
    PrintInfo(r);
    if (!arguments.streams) continue;
    MTDB_ASSIGN_OR_RETURN(const BitsPerVertex bits, MeasureStreams(*database, r));
    for (const auto& [name, n] : bits) {
      std::printf("  stream       %s, %.2f bits per vertex\n", name.c_str(), n);
    }
  }
  std::printf("store: %s bytes, %s\n", Grouped(file_bytes).c_str(),
              Counted(records.size(), "object", "objects").c_str());
  return Status::Ok();
}

Status List(const InspectArguments& arguments) {
  const std::string store = RealStorePath(arguments.store);
  uint64_t file_bytes = 0, free_bytes = 0;
  const auto list = [&]() -> Result<std::vector<ObjectRecord>> {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                          Database::Open(arguments.store, arguments.open));
    MTDB_ASSIGN_OR_RETURN(file_bytes, database->FileBytes());
    MTDB_ASSIGN_OR_RETURN(free_bytes, database->FreeBytes());
    return database->List();
  };
  Result<std::vector<ObjectRecord>> records = list();
  const std::vector<IngestJournal> journals =
      FindJournals(arguments.tmp.empty() ? FolderOf(store) : arguments.tmp, store,
                   records.ok() ? *records : std::vector<ObjectRecord>());
  // The first ingest may have been interrupted before it made the store, or while it did.
  const bool none = !journals.empty() && (records.status().code() == StatusCode::kNotFound ||
                                          Database::NothingStored(store));
  if (!records.ok() && !none) return records.status();
  if (none) records = std::vector<ObjectRecord>();
  if (arguments.json) {
    Json json = CatalogJson(*records);
    json["store"] = arguments.store;
    json["file_bytes"] = file_bytes;
    json["free_bytes"] = free_bytes;
    if (!journals.empty()) json["journals"] = JournalsJson(journals);
    PrintAnswer("list", json);
    return Status::Ok();
  }
  for (const ObjectRecord& r : *records) {
    std::printf("%15s triangles  %s\n", Grouped(r.triangles).c_str(), r.name.c_str());
  }
  if (!none) {
    std::printf("%s: %zu object%s, %s", WithoutSecrets(arguments.store).c_str(), records->size(),
                records->size() == 1 ? "" : "s", SizeText(file_bytes).c_str());
    const bool much = free_bytes > file_bytes / 10 && free_bytes > kMuchFreeSpace;
    if (free_bytes > 0) std::printf(", of which %s are free", SizeText(free_bytes).c_str());
    std::printf("%s\n", much ? " ('mtdb compact' makes the file smaller)" : "");
  }
  for (const IngestJournal& j : journals) PrintJournal(j);
  return Status::Ok();
}

// `*failed`: a check did; an error: nothing could be examined.
// `damaged`: what to do with `place` then.
void TellChecks(const InspectArguments& arguments, const std::string& level,
                const CheckReport& report, const std::string& place, const char* damaged) {
  if (arguments.json) {
    Json json = {{"store", arguments.store}, {"level", level}};
    json.Update(ChecksJson(report));
    PrintAnswer("verify", json);
    return;
  }
  for (const std::string& check : report.checks) std::printf("checked: %s\n", check.c_str());
  for (const std::string& failure : report.failures) {
    std::printf("FAILED: %s\n", WithoutSecrets(failure).c_str());
  }
  std::printf("%s: %s\n", WithoutSecrets(place).c_str(), report.ok() ? "ok" : damaged);
}

Status Verify(const InspectArguments& arguments, bool* failed) {
  CheckReport report;
  if (!arguments.name.empty()) {
    // A name that is not there is a mistake of the caller, unless the catalog is damaged.
    const auto database = Database::Open(arguments.store, arguments.open);
    if (database.ok()) {
      const auto found = (*database)->Find(arguments.name);
      if (found.status().code() == StatusCode::kNotFound) return found.status();
    }
  }
  MTDB_RETURN_IF_ERROR(VerifyStore(arguments.store, arguments.name, &report, {}, arguments.open));
  if (arguments.level != "fast" && report.ok()) {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                          Database::Open(arguments.store, arguments.open));
    std::vector<std::string> names{arguments.name};
    if (arguments.name.empty()) {
      names.clear();
      MTDB_ASSIGN_OR_RETURN(const std::vector<ObjectRecord> records, database->List());
      for (const ObjectRecord& r : records) names.push_back(r.name);
    }
    for (const std::string& name : names) {
      MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source, database->OpenObject(name));
      MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface,
                            Surface::Open(std::move(source)));
      MTDB_RETURN_IF_ERROR(VerifyObject(*surface, VerifyLevel::kFull, &report));
      if (arguments.level == "global") {
        MTDB_RETURN_IF_ERROR(VerifyObject(*surface, VerifyLevel::kGlobal, &report));
      }
    }
  }
  *failed = !report.ok();
  TellChecks(arguments, arguments.level, report, arguments.store,
             "damaged; restore it from a copy, or ingest again");
  return Status::Ok();
}

RunVerb AddInfo(VerbOptions* verb) {
  const auto a = std::make_shared<InspectArguments>();
  verb->Add("STORE", a->store, "the store file, or a mesh file; - is a mesh on standard input")
      .Required();
  AddInputFormat(verb, &a->format);
  AddOnly(verb, &a->name);
  AddJson(verb, &a->json);
  verb->AddFlag("--streams", a->streams,
                "read all clusters, and tell what their streams take, attributes among them");
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation&) { return Info(*a); };
}

RunVerb AddList(VerbOptions* verb) {
  const auto a = std::make_shared<InspectArguments>();
  AddStore(verb, &a->store);
  AddJson(verb, &a->json);
  verb->Add("--tmp", a->tmp,
            "look for journals of interrupted ingests in DIR (default: the store's folder)")
      .Form("DIR");
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation&) { return List(*a); };
}

Status VerifyTileFolder(const InspectArguments& arguments, const std::string& folder,
                        bool* failed) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source,
                        database->OpenObject(arguments.name));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, Surface::Open(std::move(source)));
  CheckReport report;
  MTDB_RETURN_IF_ERROR(VerifyTiles(*surface, folder, &report));
  *failed = !report.ok();
  TellChecks(arguments, "tiles", report, folder,
             "damaged; remove it, and 'mtdb tile' writes it anew");
  return Status::Ok();
}

RunVerb AddVerify(VerbOptions* verb) {
  const auto a = std::make_shared<InspectArguments>();
  const auto tiles = std::make_shared<std::string>();
  AddStore(verb, &a->store);
  AddOnly(verb, &a->name);
  AddJson(verb, &a->json);
  verb->Add("--level", a->level,
            "fast: pages, checksums, index, digests; full: also decodes every cluster; "
            "global: also rebuilds the whole surface and compares it with what was ingested")
      .Form("LEVEL")
      .OneOf({"fast", "full", "global"});
  verb->Add("--tiles", *tiles,
            "instead check the tiles in DIR ('mtdb tile'): files, boxes, errors, and "
            "distances from the object")
      .Form("DIR");
  AddCacheDirectory(verb, &a->open);
  return [a, tiles](Invocation& invocation) {
    return tiles->empty() ? Verify(*a, &invocation.failed)
                          : VerifyTileFolder(*a, *tiles, &invocation.failed);
  };
}

}  // namespace

const Verb kInfoVerb{"info", "tell what a store holds, or what a mesh file is like", "", AddInfo};

const Verb kListVerb{"list", "list the objects of a store, and ingests that were interrupted", "",
                     AddList};

const Verb kVerifyVerb{"verify", "check a store's bytes and meshes, or tiles", "", AddVerify};

}  // namespace mtdb
