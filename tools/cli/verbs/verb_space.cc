// SPDX-License-Identifier: Apache-2.0
// Which objects a store has, and how much room they take: remove, rename, copy, compact.
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>

#include "store/copy.h"
#include "store/database.h"
#include "tools/cli/options.h"
#include "tools/cli/progress.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/ingest_journal.h"
#include "tools/request/arguments.h"
#include "tools/request/report_json.h"

namespace mtdb {
namespace {

struct SpaceArguments {
  std::string store;
  std::string target;              // copy: another store
  std::vector<std::string> names;  // remove, copy: the objects (copy: none are all); rename: both
  bool replace = false;            // copy: replace objects of the same names
  bool json = false;
  bool quiet = false;  // no progress
};
// Set by Ctrl-C.
volatile std::sig_atomic_t g_interrupted = 0;

// Shows how far a copy is, and ends it when it is interrupted.
CopyProgress ShownBy(ProgressLine& line, const std::string& what) {
  // The first one ends the copy in good order, the second one the process.
  const auto interrupt = [](int signal) {
    g_interrupted = 1;
    std::signal(signal, SIG_DFL);
  };
  std::signal(SIGINT, interrupt);
  std::signal(SIGTERM, interrupt);
  return [&line, what](uint64_t done, uint64_t total) {
    if (g_interrupted != 0) return Status(StatusCode::kCancelled, "interrupted");
    line.Update(total == 0 ? 1 : static_cast<double>(done) / static_cast<double>(total), what);
    return Status::Ok();
  };
}

// What is true of the store afterwards.
Status PrintRoom(const Database& database) {
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, database.FileBytes());
  MTDB_ASSIGN_OR_RETURN(const uint64_t free_bytes, database.FreeBytes());
  std::printf("%s: %s, of which %s are free\n", database.path().c_str(),
              SizeText(file_bytes).c_str(), SizeText(free_bytes).c_str());
  return Status::Ok();
}

bool IsThere(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(std::filesystem::symlink_status(path, error));
}

// All that are wanted, by name; all of the store without names.
Result<ObjectSources> OpenWanted(const Database& database, const std::vector<std::string>& names) {
  MTDB_ASSIGN_OR_RETURN(ObjectSources all, database.OpenAll());
  if (names.empty()) return all;
  ObjectSources wanted;
  for (const std::string& name : names) {
    const auto at = std::ranges::find(all, name, [](const auto& s) { return s->record().name; });
    if (at == all.end()) {
      MTDB_RETURN_IF_ERROR(database.Find(name).status());
      return NotFound(database.path() + ": no object " + name);
    }
    if (std::ranges::find(wanted, *at) == wanted.end()) wanted.push_back(*at);
  }
  return wanted;
}

bool IsEqual(const ObjectRecord& a, const ObjectRecord& b) {
  return a.digest_low == b.digest_low && a.digest_high == b.digest_high;
}

// What a copy did.
struct Copied {
  std::vector<std::string> copied, unchanged, replaced;
};

// Nothing is written when one of the objects is refused.
Status CopyInto(const SpaceArguments& arguments, const ObjectSources& wanted,
                const CopyProgress& progress, Copied* done) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> target,
                        Database::Open(arguments.target, {.writable = true, .create = false}));
  ObjectSources missing;
  for (const auto& object : wanted) {
    const ObjectRecord& record = object->record();
    const Result<ObjectRecord> there = target->Find(record.name);
    if (there.ok() && IsEqual(*there, record)) {
      done->unchanged.push_back(record.name);
    } else if (there.ok() && !arguments.replace) {
      return {StatusCode::kAlreadyExists,
              arguments.target + ": has another object " + record.name +
                  "; give --replace to replace it, or rename one of the two; nothing was copied"};
    } else if (!there.ok() && there.status().code() != StatusCode::kNotFound) {
      return there.status();
    } else {
      (there.ok() ? done->replaced : done->copied).push_back(record.name);
      missing.push_back(object);
    }
  }
  for (const auto& object : missing) {
    MTDB_RETURN_IF_ERROR(
        CopyObject(*object, *target, object->record().name, arguments.replace, progress).status());
  }
  return Status::Ok();
}

Status Remove(const SpaceArguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, {.writable = true, .create = false}));
  MTDB_ASSIGN_OR_RETURN(const uint64_t free_before, database->FreeBytes());
  std::vector<ObjectRecord> records;
  for (const std::string& name : arguments.names) {
    MTDB_ASSIGN_OR_RETURN(ObjectRecord record, database->Find(name));
    const auto same = [&](const ObjectRecord& r) { return r.name == record.name; };
    if (std::ranges::none_of(records, same)) records.push_back(std::move(record));
  }
  // The journal of what is removed would pass for an ingest that was interrupted.
  const std::string store = RealStorePath(arguments.store);
  (void)FindJournals(FolderOf(store), store, records);
  for (const ObjectRecord& r : records) MTDB_RETURN_IF_ERROR(database->Remove(r.name));
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, database->FileBytes());
  MTDB_ASSIGN_OR_RETURN(const uint64_t free_bytes, database->FreeBytes());
  const uint64_t freed = free_bytes > free_before ? free_bytes - free_before : 0;
  if (arguments.json) {
    Json removed = Json::Array();
    for (const ObjectRecord& r : records) removed.push_back(r.name);
    PrintAnswer("remove", {{"store", arguments.store},
                           {"removed", removed},
                           {"freed_bytes", freed},
                           {"file_bytes", file_bytes},
                           {"free_bytes", free_bytes}});
    return Status::Ok();
  }
  for (const ObjectRecord& r : records) std::printf("removed %s\n", r.name.c_str());
  std::printf(
      "%s: %s were freed; of the file's %s, %s are free for other objects ('mtdb compact' makes "
      "the file smaller)\n",
      arguments.store.c_str(), SizeText(freed).c_str(), SizeText(file_bytes).c_str(),
      SizeText(free_bytes).c_str());
  return Status::Ok();
}

Status Rename(const SpaceArguments& arguments) {
  const std::string& old_name = arguments.names.at(0);
  const std::string& new_name = arguments.names.at(1);
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, {.writable = true, .create = false}));
  MTDB_RETURN_IF_ERROR(database->Rename(old_name, new_name));
  if (arguments.json) {
    PrintAnswer("rename",
                {{"store", arguments.store}, {"object", new_name}, {"old_name", old_name}});
  } else {
    std::printf("%s is now %s\n", old_name.c_str(), new_name.c_str());
  }
  return Status::Ok();
}

Status Copy(const SpaceArguments& arguments) {
  std::error_code error;
  if (std::filesystem::equivalent(arguments.store, arguments.target, error)) {
    return InvalidArgument(arguments.target + ": is the same store as " + arguments.store +
                           "; give another, or use 'mtdb rename'");
  }
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database, Database::Open(arguments.store));
  MTDB_ASSIGN_OR_RETURN(ObjectSources wanted, OpenWanted(*database, arguments.names));
  ProgressLine line(arguments.json || arguments.quiet);
  const CopyProgress progress = ShownBy(line, "copying");
  Copied done;
  Status status = Status::Ok();
  if (IsThere(arguments.target)) {
    status = CopyInto(arguments, wanted, progress, &done);
  } else {
    status = CopyToNewStore(wanted, arguments.target, progress);
    for (const auto& object : wanted) done.copied.push_back(object->record().name);
  }
  line.Finish();
  MTDB_RETURN_IF_ERROR(status);
  wanted.clear();
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> target, Database::Open(arguments.target));
  if (arguments.json) {
    MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, target->FileBytes());
    PrintAnswer("copy", {{"store", arguments.store},
                         {"target", arguments.target},
                         {"copied", done.copied},
                         {"replaced", done.replaced},
                         {"unchanged", done.unchanged},
                         {"file_bytes", file_bytes}});
    return Status::Ok();
  }
  for (const std::string& name : done.copied) std::printf("copied %s\n", name.c_str());
  for (const std::string& name : done.replaced) std::printf("replaced %s\n", name.c_str());
  for (const std::string& name : done.unchanged) {
    std::printf("%s was there already, the same\n", name.c_str());
  }
  return PrintRoom(*target);
}

Status Compact(const SpaceArguments& arguments) {
  ProgressLine line(arguments.json || arguments.quiet);
  const Result<CompactReport> report =
      CompactStore(arguments.store, ShownBy(line, "writing the new file"));
  line.Finish();
  MTDB_RETURN_IF_ERROR(report.status());
  if (arguments.json) {
    PrintAnswer("compact", {{"store", arguments.store},
                            {"bytes_before", report->bytes_before},
                            {"file_bytes", report->bytes_after},
                            {"freed_bytes", report->bytes_before - report->bytes_after}});
    return Status::Ok();
  }
  if (report->bytes_after == report->bytes_before) {
    std::printf("%s: %s, which cannot be made smaller\n", arguments.store.c_str(),
                SizeText(report->bytes_after).c_str());
    return Status::Ok();
  }
  std::printf("%s: %s, before %s\n", arguments.store.c_str(), SizeText(report->bytes_after).c_str(),
              SizeText(report->bytes_before).c_str());
  return Status::Ok();
}

template <Status (*kRun)(const SpaceArguments&)>
RunVerb Running(std::shared_ptr<SpaceArguments> arguments) {
  return [a = std::move(arguments)](Invocation& invocation) {
    a->quiet = invocation.quiet;
    return kRun(*a);
  };
}

RunVerb AddRemove(VerbOptions* verb) {
  auto a = std::make_shared<SpaceArguments>();
  AddWrittenStore(verb, &a->store);
  verb->Add("NAME", a->names, "the objects").Required().Values(1, 1 << 20);
  AddJson(verb, &a->json);
  return Running<Remove>(std::move(a));
}

RunVerb AddRename(VerbOptions* verb) {
  auto a = std::make_shared<SpaceArguments>();
  AddWrittenStore(verb, &a->store);
  verb->Add("OLD NEW", a->names, "the object's name, and its new name").Required().Values(2, 2);
  AddJson(verb, &a->json);
  return Running<Rename>(std::move(a));
}

RunVerb AddCopy(VerbOptions* verb) {
  auto a = std::make_shared<SpaceArguments>();
  AddStore(verb, &a->store);
  IsWritten(verb->Add("TARGET", a->target, "the other store")).Required();
  verb->Add("NAME", a->names, "the objects (default: all)").Values(0, 1 << 20);
  verb->AddFlag("--replace", a->replace, "replace objects of TARGET that differ");
  AddJson(verb, &a->json);
  return Running<Copy>(std::move(a));
}

RunVerb AddCompact(VerbOptions* verb) {
  auto a = std::make_shared<SpaceArguments>();
  AddWrittenStore(verb, &a->store);
  AddJson(verb, &a->json);
  return Running<Compact>(std::move(a));
}

}  // namespace

const Verb kRemoveVerb{
    "remove", "remove objects from a store",
    "The file keeps its size: the next objects fill the room, or 'mtdb compact' gives it back.\n"
    "Example: mtdb remove scans.mtdb statue vase",
    AddRemove};

const Verb kRenameVerb{"rename", "give an object another name",
                       "Example: mtdb rename scans.mtdb scan statue", AddRename};

const Verb kCopyVerb{
    "copy", "copy objects into another store, or make a backup",
    "A TARGET that is not there appears when the copy is complete, with what STORE had at one "
    "moment.\nInto one that is there go the objects that it has not; an object that differs "
    "under\nthe same name is an error, or replaced with --replace.\n"
    "Examples: mtdb copy scans.mtdb backup.mtdb\n"
    "          mtdb copy scans.mtdb museum.mtdb statue vase",
    AddCopy};

const Verb kCompactVerb{
    "compact", "make a store's file as small as its objects",
    "Writes a new file beside the old one and puts it in its place in one step; the disk must "
    "have\nroom for both. Nobody may write to the store meanwhile.\n"
    "Example: mtdb compact scans.mtdb",
    AddCompact};

}  // namespace mtdb
