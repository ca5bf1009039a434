// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <set>

#include "codecs/mesh_file/atomic_file.h"
#include "store/copy.h"
#include "store/database.h"
#include "store/packed_file.h"
#include "tools/cli/grouped.h"
#include "tools/cli/options.h"
#include "tools/cli/verbs.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

struct PackArguments {
  std::string from;  // pack: a store; unpack: a packed file or its URL
  OpenOptions open;  // of `from`
  std::string to;
  std::vector<std::string> names;  // none: all
  bool replace = false;            // unpack: replaces objects
  bool json = false;
};
// The given ones in their order; without any, all by name.
Result<std::vector<std::string>> NamesOf(const Database& database,
                                         const std::vector<std::string>& given) {
  std::vector<std::string> names = given;
  if (names.empty()) {
    MTDB_ASSIGN_OR_RETURN(const std::vector<ObjectRecord> records, database.List());
    for (const ObjectRecord& r : records) names.push_back(r.name);
  }
  if (names.empty()) return NotFound(database.path() + ": the store holds no object");
  std::set<std::string> seen;
  for (const std::string& name : names) {
    if (!seen.insert(name).second) return InvalidArgument("--name " + name + " is given twice");
  }
  return names;
}

Status Pack(const PackArguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.from, arguments.open));
  MTDB_ASSIGN_OR_RETURN(const std::vector<std::string> names, NamesOf(*database, arguments.names));
  std::vector<std::shared_ptr<ClusterSource>> sources;
  for (const std::string& name : names) {
    MTDB_ASSIGN_OR_RETURN(sources.emplace_back(), database->OpenObject(name, true));
  }
  // A packed file may replace the one that it is made of, unless objects would be lost.
  const std::string kept = arguments.names.empty() ? "" : arguments.from;
  MTDB_ASSIGN_OR_RETURN(
      const std::unique_ptr<AtomicFile> file,
      AtomicFile::Create(arguments.to, {.replaces_packed_file = true, .source = kept}));
  MTDB_ASSIGN_OR_RETURN(const PackReport report,
                        PackObjects(sources, [&](ByteSpan bytes) { return file->Append(bytes); }));
  MTDB_RETURN_IF_ERROR(file->Commit());
  if (arguments.json) {
    Json objects = Json::Array();
    for (const std::string& name : names) objects.push_back({{"object", name}});
    PrintAnswer("pack", {{"output", arguments.to},
                         {"objects", objects},
                         {"file_bytes", report.file_bytes},
                         {"first_bytes", report.first_bytes},
                         {"content_hash", report.content_hash}});
    return Status::Ok();
  }
  std::printf("%s: %s, %s bytes, the first %s of them for a first picture, hash %s\n",
              arguments.to.c_str(), Counted(names.size(), "object", "objects").c_str(),
              Grouped(report.file_bytes).c_str(), Grouped(report.first_bytes).c_str(),
              report.content_hash.c_str());
  return Status::Ok();
}

Status Unpack(const PackArguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.from, arguments.open));
  if (!database->is_packed()) {
    return InvalidArgument(arguments.from + ": expected a packed file, found a store");
  }
  MTDB_ASSIGN_OR_RETURN(const std::vector<std::string> names, NamesOf(*database, arguments.names));
  ObjectSources sources;
  for (const std::string& name : names) {
    MTDB_ASSIGN_OR_RETURN(sources.emplace_back(), database->OpenObject(name, true));
  }
  std::error_code error;
  if (std::filesystem::exists(std::filesystem::symlink_status(arguments.to, error))) {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> store,
                          Database::Open(arguments.to, {.writable = true}));
    for (const auto& source : sources) {
      MTDB_RETURN_IF_ERROR(
          CopyObject(*source, *store, source->record().name, arguments.replace).status());
    }
  } else {
    MTDB_RETURN_IF_ERROR(CopyToNewStore(sources, arguments.to));
  }
  Json objects = Json::Array();
  for (const auto& source : sources) {
    const ObjectRecord& record = source->record();
    objects.push_back({{"object", record.name}, {"digest", record.digest_hex()}});
    if (arguments.json) continue;
    std::printf("%s: digest %s\n", record.name.c_str(), record.digest_hex().c_str());
  }
  if (arguments.json) PrintAnswer("unpack", {{"store", arguments.to}, {"objects", objects}});
  return Status::Ok();
}

void AddNamesAndJson(VerbOptions* verb, PackArguments* a) {
  verb->Add("--name", a->names, "this object only; several: in this order")
      .Form("NAME")
      .Repeatable();
  AddJson(verb, &a->json);
}

RunVerb AddPack(VerbOptions* verb) {
  const auto a = std::make_shared<PackArguments>();
  AddStore(verb, &a->from);
  IsWritten(verb->Add("FILE", a->to, "the packed file; one of that name is replaced")).Required();
  AddNamesAndJson(verb, a.get());
  return [a](Invocation&) { return Pack(*a); };
}

RunVerb AddUnpack(VerbOptions* verb) {
  const auto a = std::make_shared<PackArguments>();
  verb->Add("FILE", a->from, "the packed file, or its URL").Required();
  IsWritten(verb->Add("STORE", a->to, "the store; made if it is not there")).Required();
  AddNamesAndJson(verb, a.get());
  verb->AddFlag("--replace", a->replace, "replace objects of the same names");
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation&) { return Unpack(*a); };
}

}  // namespace

const Verb kPackVerb{"pack", "write a store's objects into one file for a web server",
                     "Every verb that reads takes the file, or its URL, for a store.\n"
                     "Examples: mtdb pack scans.mtdb statue.mtdbp --name statue\n"
                     "          mtdb info https://example.org/statue.mtdbp\n"
                     "More: docs/packed.md",
                     AddPack};

const Verb kUnpackVerb{"unpack", "put a packed file's objects into a store",
                       "Example: mtdb unpack statue.mtdbp scans.mtdb", AddUnpack};

}  // namespace mtdb
