// SPDX-License-Identifier: Apache-2.0
// Acts by which objects and stores move: rename, copy, compact; and verify of what is packed.
#include <algorithm>
#include <csignal>
#include <filesystem>

#include "query/query_control.h"
#include "query/surface.h"
#include "query/verify_object.h"
#include "store/database.h"
#include "store/verify_store.h"
#include "tests/everything/world.h"
#include "tests/support/file_server.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

std::string NameOf(const Step& step) { return step.Text("name", "a"); }

// Who comes by another name of the file, and who has the file open, shut each other out.
bool MayBeShutOut(const Step& step) {
  return step.Text("by") == "hardlink" || step.Text("by2") == "hardlink";
}

bool HasSeveralNames(const StorePlace& place) {
  std::error_code error;
  return fs::hard_link_count(place.path, error) > 1 && !error;
}

}  // namespace

Ran RunOrKill(World& world, const Step& step, Arguments arguments) {
  RunOptions run;
  if (step.has("operation") && !world.options().faults.empty()) {
    run.environment = {"LD_PRELOAD=" + world.options().faults, "MTDB_FAULT=kill",
                       "MTDB_FAULT_UNDER=" + world.options().folder,
                       "MTDB_FAULT_AT=" + step.Text("operation")};
  }
  const std::string verb = arguments[0];
  arguments.insert(arguments.begin(), world.options().mtdb);
  run.folder = world.Folder("inputs");
  Ran ran = Run(arguments, world.scratch(), run);
  ran.killed = step.has("operation") && ran.signal == SIGKILL;
  return world.Checked(std::move(ran), "mtdb " + verb);
}

namespace {

// What a copy that was killed left is removed by the next one to the same path.
void ExpectPartial(World& world, const StorePlace& place) {
  const std::string file = "stores/" + fs::path(place.path).filename().string() + ".partial";
  for (const char* end : {"", "-lock", ".lock"}) {
    if (fs::exists(world.Folder(file + end))) world.expected_files[file + end] = "partial";
  }
}

void CheckAll(World& world, int64_t store) {
  CheckLeftovers(world);
  CheckStore(world, store, "full");
  if (world.stopped()) return;
  for (const auto& [name, object] : world.Store(store).model.objects) {
    CheckObject(world, store, name);
  }
}

// What of `names` differs in the target; the objects that a copy would put there.
struct Conflicts {
  bool differ = false;
  std::vector<std::string> missing;
};

Conflicts Compare(World& world, int64_t from, int64_t to, const std::vector<std::string>& names) {
  Conflicts conflicts;
  for (const std::string& name : names) {
    const bool there = world.Store(to).model.objects.contains(name);
    const auto mine = ReadRecord(world.Store(from).path, name);
    const auto theirs = ReadRecord(world.Store(to).path, name);
    const bool equal =
        there && mine.ok() && theirs.ok() && mine->digest_hex() == theirs->digest_hex();
    conflicts.differ |= there && !equal;
    if (!equal) conflicts.missing.push_back(name);
  }
  return conflicts;
}

}  // namespace

void RenameAct(World& world, const Step& step) {
  const int64_t store = step.Int("store", 0);
  StorePlace& place = world.Store(store);
  const std::string from = NameOf(step), to = step.Text("to", "b");
  if (from == to || !place.model.exists) return;
  ++world.counts().acts;
  const bool fits = place.model.objects.contains(from) && !place.model.objects.contains(to);
  const Ran ran = world.Mtdb({"rename", world.PathOf(store, step.Text("by", "plain")), from, to});
  if (ran.ok() != fits && (ran.ok() || !MayBeShutOut(step))) {
    world.ErrorFault(fits ? "rename: refused" : "rename: not refused", ran.err + ran.out);
    if (ran.ok()) return world.Stop();
  }
  if (ran.ok()) {
    place.model.objects[to] = place.model.objects.at(from);
    place.model.objects.erase(from);
    place.Close(from);
  }
  CheckAll(world, store);
}

void CopyIntoAct(World& world, const Step& step) {
  const int64_t from = step.Int("store", 0), to = from + 1;
  StorePlace &source = world.Store(from), &target = world.Store(to);
  std::vector<std::string> names;
  if (step.has("name")) {
    names = {NameOf(step)};
  } else {
    for (const auto& [name, object] : source.model.objects) names.push_back(name);
  }
  const bool all_there = source.model.exists && std::ranges::all_of(names, [&](const auto& name) {
                           return source.model.objects.contains(name);
                         });
  const Conflicts conflicts = all_there ? Compare(world, from, to, names) : Conflicts{};
  const bool fits = all_there && (!conflicts.differ || step.Flag("force"));
  Arguments arguments{"copy", "--json", world.PathOf(from, step.Text("by", "plain")),
                      world.PathOf(to, target.model.exists ? step.Text("by2", "plain") : "plain")};
  if (step.Flag("force")) arguments.emplace_back("--replace");
  if (step.has("name")) arguments.push_back(NameOf(step));
  ++world.counts().acts;
  const bool was_there = fs::exists(target.path);
  const Ran ran = RunOrKill(world, step, arguments);
  if (ran.ok() && !fits) {
    world.Fault("copy-into: not refused", CommandLine(arguments));
    return world.Stop();
  }
  // An ingest that was killed may have left an empty file.
  const bool half_made = was_there && !target.model.exists;
  if (!ran.ok() && ran.signal == 0 && fits && !MayBeShutOut(step) && !half_made) {
    world.ErrorFault("copy-into: refused", ran.err);
  }
  for (const std::string& name : conflicts.missing) {
    // One that was killed has copied some of them, each of them whole or not at all.
    const auto record = ReadRecord(target.path, name);
    const auto wanted = ReadRecord(source.path, name);
    const bool arrived = record.ok() && wanted.ok() && record->digest_hex() == wanted->digest_hex();
    if (!ran.ok() && !(ran.signal != 0 && arrived)) continue;
    target.Close(name);
    target.model.objects[name] = source.model.objects.at(name);
  }
  target.model.exists |= HasStore(target);
  if (ran.signal != 0) ExpectPartial(world, target);
  CheckAll(world, to);
}

void CompactAct(World& world, const Step& step) {
  const int64_t store = step.Int("store", 0);
  StorePlace& place = world.Store(store);
  if (!place.model.exists) return;
  const std::string path = world.PathOf(store, step.Text("by", "plain"));
  if (step.Flag("alone")) {
    fs::remove(world.Folder("stores/hardlink-" + fs::path(place.path).filename().string()));
    if (step.Text("by") == "hardlink") return;
  }
  const bool fits = !HasSeveralNames(place);
  const uint64_t before = fs::file_size(place.path);
  ++world.counts().acts;
  const Ran ran = RunOrKill(world, step, {"compact", path, "--json"});
  if (ran.ok() != fits && ran.signal == 0) {
    world.ErrorFault(fits ? "compact: refused" : "compact: not refused", ran.err + ran.out);
  }
  if (ran.ok() && fs::file_size(place.path) > before) {
    world.Fault("compact: the file is larger",
                std::to_string(before) + ", now " + std::to_string(fs::file_size(place.path)));
  }
  if (ran.signal != 0) {
    ExpectPartial(world, place);
    CheckAll(world, store);
    const Ran again = world.Mtdb({"compact", path});
    if (!again.ok()) world.ErrorFault("compact: refused after one was killed", again.err);
    std::erase_if(world.expected_files, [](const auto& file) { return file.second == "partial"; });
  }
  CheckAll(world, store);
}

void VerifyPacked(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  if (place.model.objects.empty()) return;
  ++world.counts().acts;
  const std::string file = world.Folder("out/verified.mtdbp");
  const Ran packed = world.Mtdb({"pack", place.path, file});
  if (!packed.ok()) return world.ErrorFault("pack: refused", packed.err);
  const mtdb::testing::FileServer server(ReadText(file));
  const int64_t most = std::max<int64_t>(0, step.Int("packed", 0));
  for (const std::string& from : {file, server.url()}) {
    world.Note("verify " + from);
    // Given up at the n-th time that it asks.
    int64_t asked = 0;
    CheckReport report;
    const Status status = VerifyStore(from, "", &report, [&] { return ++asked > most; });
    if (status.message().find("without libcurl") != std::string::npos) continue;
    const StatusCode code = asked > most ? StatusCode::kCancelled : StatusCode::kOk;
    if (status.code() != code) {
      world.ErrorFault("verify packed: " + std::string(asked > most ? "goes on" : "ends"),
                       status.message());
    }
    if (asked > most && !(report.checks.empty() && report.failures.empty())) {
      world.Fault("verify packed: reports what it gave up", from);
    }
    const Ran ran = world.Mtdb({"verify", from, "--level", step.Text("level", "full")});
    if (!ran.ok()) world.ErrorFault("verify packed: damage", ran.out + ran.err);
    const auto database = Database::Open(from);
    if (!database.ok()) return world.ErrorFault("packed: refused", database.status().message());
    const auto object = (*database)->OpenObject(place.model.objects.begin()->first);
    if (!object.ok()) return world.ErrorFault("packed: refused", object.status().message());
    const auto surface = Surface::Open(*object, {.threads = 2});
    if (!surface.ok()) return world.ErrorFault("packed: refused", surface.status().message());
    QueryControl control;
    control.Cancel();
    report = {};
    const Status cancelled = VerifyObject(**surface, VerifyLevel::kFull, &report, &control);
    if (cancelled.code() != StatusCode::kCancelled) {
      world.ErrorFault("verify packed: an object is not given up", cancelled.message());
    }
  }
  fs::remove(file);
}

}  // namespace mtdb::everything
