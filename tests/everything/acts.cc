// SPDX-License-Identifier: Apache-2.0
// The acts. Each reads its parameters from the step, acts on the product and on the model, and
// compares what both say.
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <unistd.h>

#include "builder/build.h"
#include "store/database.h"
#include "tests/everything/world.h"
#include "tools/cli/verbs/merge.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;
constexpr size_t kLargeRows = 10'000'000;
constexpr size_t kManyTriangles = 50000;
constexpr int kJournalUnit = 10'000;  // of "kill", bytes

std::set<std::string> FilesOf(const World& world) {
  std::set<std::string> files;
  for (const char* folder : {"stores", "tmp"}) {
    for (const auto& entry : fs::directory_iterator(world.Folder(folder))) {
      files.insert(std::string(folder) + "/" + entry.path().filename().string());
    }
  }
  return files;
}

bool IsStoreOrLock(std::string name) {
  for (const char* end : {"-lock", ".lock"}) {
    if (name.ends_with(end)) name.resize(name.size() - std::string(end).size());
  }
  return name.ends_with(".mtdb");
}

}  // namespace

// ---- what holds after every act ----

void CheckLeftovers(World& world) {
  for (const std::string& file : FilesOf(world)) {
    if (IsStoreOrLock(file) || world.expected_files.contains(file)) continue;
    world.ErrorFault("left behind", file);
    world.expected_files[file] = "";
  }
}

namespace {

// An ingest of `work` came to no end: it may leave its journal, and must where it says so.
void ExpectJournal(World& world, const std::set<std::string>& before, const std::string& work,
                   bool promised) {
  size_t journals = 0;
  for (const std::string& file : FilesOf(world)) {
    if (!file.ends_with(".journal")) continue;
    if (!before.contains(file)) world.expected_files[file] = work;
    const auto known = world.expected_files.find(file);
    journals += known != world.expected_files.end() && known->second == work ? 1 : 0;
  }
  if (promised && journals == 0) world.Fault("no journal though --resume is promised", work);
}

// The ingest of `work` came to its end, so none of its journals may be there.
void ExpectNoJournal(World& world, const std::string& work) {
  std::erase_if(world.expected_files, [&](const auto& file) { return file.second == work; });
}

}  // namespace

bool HasStore(const StorePlace& place) {
  return fs::exists(place.path) && !Database::NothingStored(place.path);
}

// The store has what the model says, and verify finds nothing.
void CheckStore(World& world, int64_t number, const std::string& level) {
  StorePlace& place = world.Store(number);
  if (!place.model.exists || world.stopped()) return;
  ++world.counts().acts;
  const Ran list = world.Mtdb({"list", place.path, "--json"});
  const auto json = nlohmann::json::parse(list.out, nullptr, false);
  if (!list.ok() || !json.is_object()) {
    world.ErrorFault("list: refused", list.err);
    return world.Stop();
  }
  std::set<std::string> found, expected;
  for (const auto& object : json.at("objects")) found.insert(object.at("object"));
  for (const auto& [name, object] : place.model.objects) expected.insert(name);
  if (found != expected) {
    std::string detail = "found:";
    for (const std::string& name : found) detail += " " + name;
    detail += "; expected:";
    for (const std::string& name : expected) detail += " " + name;
    const bool lost = !std::ranges::includes(found, expected);
    world.Fault(lost ? "store: an object is lost" : "store: an object that was not put in", detail);
    return world.Stop();
  }
  const Ran verify = world.Mtdb({"verify", place.path, "--level", level, "--json"});
  if (!verify.ok()) {
    const auto report = nlohmann::json::parse(verify.out, nullptr, false);
    const bool told =
        report.is_object() && report.contains("failures") && !report.at("failures").empty();
    world.ErrorFault("verify: damage",
                     told ? report.at("failures").at(0).get<std::string>() : verify.err);
    return world.Stop();
  }
}

// Every object is what it was; asked of the whole, in this process.
void CheckObject(World& world, int64_t number, const std::string& name) {
  const auto object = world.Store(number).model.objects.at(name);
  const Step step{"ask", {}};
  const Question question = MakeQuestion(step, object->truth, object->diagonal);
  const Asked asked{&world, number, name, object.get(), &question, &step};
  Answer answer;
  answer.way = Ways()[0].name;
  Ways()[0].ask(asked, &answer);
  if (!answer.refused.empty()) return world.ErrorFault("ask: refused", answer.refused);
  (void)Judge(asked, answer, nullptr);
}

namespace {

// The store says that it has put in what `object` is.
void TakeOver(World& world, int64_t number, const std::string& name, StoredObject object) {
  StorePlace& place = world.Store(number);
  place.model.exists = true;
  const Result<ObjectRecord> record = ReadRecord(place.path, name);
  if (!record.ok()) {
    world.Fault("store: an object is lost", record.status().message());
    return world.Stop();
  }
  const std::string fault = Settle(*record, &object);
  place.Close(name);
  if (!fault.empty()) {
    // What it is instead nobody knows, so nothing can be asked of it.
    world.ErrorFault("ingest: another mesh", fault);
    return world.Stop();
  }
  place.model.objects[name] = std::make_shared<StoredObject>(std::move(object));
}

// ---- ingest ----

std::string NameOf(const Step& step) { return step.Text("name", "a"); }

// An ingest that is ready to be started.
struct Plan {
  Input input;
  StoredObject object;
  std::string store;
  std::string name;
  Arguments options;
};

Plan MakePlan(World& world, const Step& step, const std::string& by) {
  static int next = 0;
  const std::string folder = world.Folder("inputs/i" + std::to_string(next++));
  fs::create_directories(folder);
  Plan plan;
  plan.input = MakeInput(step, folder);
  plan.object = Planned(step, plan.input.truth);
  plan.store = world.PathOf(step.Int("store", 0), by);
  plan.name = NameOf(step);
  plan.options = plan.object.Options();
  if (step.Flag("force")) plan.options.emplace_back("--replace");
  if (step.Flag("resume")) plan.options.emplace_back("--resume");
  if (step.has("threads")) {
    plan.options.push_back("--threads=" +
                           std::to_string(std::clamp<int64_t>(step.Int("threads", 1), 1, 64)));
  }
  if (step.has("memory")) {
    plan.options.push_back(
        "--memory=" + std::to_string(std::max<int64_t>(256, step.Int("memory", 256))) + "M");
  }
  if (step.Flag("tmp")) plan.options.push_back("--tmp=" + world.Folder("tmp"));
  if (!plan.input.format.empty()) plan.options.push_back("--format=" + plan.input.format);
  plan.options.push_back("--name=" + plan.name);
  return plan;
}

Arguments CommandOf(const World& world, const Plan& plan, const Step& step) {
  Arguments arguments{world.options().mtdb, "ingest"};
  if (step.Text("via") == "library") {
    arguments = {fs::read_symlink("/proc/self/exe").string(), "--library-ingest"};
    arguments.push_back("--tile=" +
                        std::to_string(std::clamp<int64_t>(step.Int("tile", 8192), 32, 1 << 20)));
    if (step.has("kill")) arguments.push_back("--die=" + std::to_string(step.Int("kill", 1)));
  } else {
    arguments.emplace_back("--json");
  }
  arguments.insert(arguments.end(), plan.options.begin(), plan.options.end());
  arguments.insert(arguments.end(), plan.input.paths.begin(), plan.input.paths.end());
  arguments.push_back(plan.store);
  return arguments;
}

// Whether a journal below stores/ or tmp/ has so many bytes.
bool JournalReaches(const World& world, uint64_t bytes) {
  for (const char* folder : {"stores", "tmp"}) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(world.Folder(folder), error)) {
      if (entry.path().extension() != ".journal") continue;
      const auto size = entry.file_size(error);
      if (!error && size >= bytes) return true;
    }
  }
  return false;
}

Step WithoutInterruption(Step step) {
  for (const char* key : {"kill", "operation", "resume", "threads", "memory", "force"}) {
    step.with.erase(key);
  }
  return step;
}
std::string Place(const Step& step) { return step.Text("store", "0") + " " + NameOf(step); }
// Ingests of one object that use one journal.
std::string WorkOf(const Step& step) {
  return Place(step) + (step.Flag("tmp") ? " tmp" : "") +
         (step.Text("via") == "library" ? " library" : "") +
         (step.Text("by") == "hardlink" ? " hardlink" : "");
}
bool PromisesResume(const Ran& ran) { return ran.err.find(" goes on where") != std::string::npos; }

// Whether one cell of the tolerance's size has more vertices than an ingest permits, or there are
// more cells than doubles can number.
bool WeldsTooMuch(const Truth& truth) {
  constexpr uint64_t kMostInCell = 64;
  if (!truth.weld || !(*truth.weld > 0)) return false;
  std::map<std::array<double, 3>, uint64_t> cells;
  for (const Vec3d& p : truth.mesh.positions) {
    std::array<double, 3> cell;
    for (size_t i = 0; i < 3; ++i) cell[i] = std::floor(p[static_cast<int>(i)] / *truth.weld);
    if (std::ranges::any_of(cell, [](double c) { return !(std::abs(c) < 0x1p52); })) return true;
    if (++cells[cell] > kMostInCell) return true;
  }
  return false;
}

// Why this ingest may be refused though nothing is wrong with its input; empty: it may not.
std::string MayRefuse(World& world, const Step& step, const StoredObject& object,
                      const std::string& by) {
  const StoreModel& model = world.Store(step.Int("store", 0)).model;
  if (model.objects.contains(NameOf(step)) && !step.Flag("force")) return "the name is taken";
  const auto killed = world.interrupted.find(Place(step));
  if (killed != world.interrupted.end() && step.Flag("resume") &&
      killed->second != WithoutInterruption(step)) {
    return "it goes on with something else";
  }
  // More attributes than fit the memory that is allowed.
  if (step.has("memory") && step.has("wide")) return "memory";
  if (WeldsTooMuch(object.truth)) return "tolerance";
  if (step.has("far")) return "the grid is too coarse";
  // Writers and readers by another name of the file shut each other out.
  return by == "hardlink" ? "another name" : "";
}

void Judged(World& world, const Step& step, Plan plan, const Ran& ran, const std::string& by) {
  const int64_t store = step.Int("store", 0);
  const std::string refusal = plan.object.Refusal();
  // To go on with what published its object before it was killed is to publish it again.
  const bool goes_on = step.Flag("resume") && world.interrupted.contains(Place(step));
  const bool taken =
      world.Store(store).model.objects.contains(plan.name) && !step.Flag("force") && !goes_on;
  if (ran.ok()) {
    if (!refusal.empty() || taken) {
      world.Fault("ingest: not refused: " + (taken ? "the name is taken" : refusal),
                  CommandLine(plan.options));
      if (taken) return world.Stop();
    }
    TakeOver(world, store, plan.name, std::move(plan.object));
  } else if (!ran.killed && ran.signal == 0 && refusal.empty() &&
             MayRefuse(world, step, plan.object, by).empty()) {
    world.ErrorFault("ingest: refused", ran.err);
  }
  if (step.has("memory") && ran.peak_bytes > 0) {
    const uint64_t limit =
        static_cast<uint64_t>(std::max<int64_t>(256, step.Int("memory", 256))) * kMiB;
    if (ran.peak_bytes > limit) {
      world.Fault("ingest: more memory than --memory",
                  std::to_string(ran.peak_bytes >> 20) + " MiB of " + std::to_string(limit >> 20));
    }
  }
}

// `list` tells of the journal of an ingest that was killed, unless that had published its object,
// or had not written anything yet: then there is nothing to go on with, and `list` removes it.
void CheckList(World& world, const Step& step, bool published) {
  bool left = false, has_bytes = false;
  for (const auto& [file, work] : world.expected_files) {
    if (work != WorkOf(step)) continue;
    std::error_code error;
    const auto size = fs::file_size(world.Folder(file), error);
    left = true;
    has_bytes |= !error && size > 0;
  }
  if (!left) return;
  const bool done = published || !has_bytes;
  const int64_t store = step.Int("store", 0);
  Arguments list{"list", world.PathOf(store, step.Text("by", "plain")), "--json"};
  if (step.Flag("tmp")) list.push_back("--tmp=" + world.Folder("tmp"));
  const Ran ran = world.Mtdb(list);
  const auto json = nlohmann::json::parse(ran.out, nullptr, false);
  if (!ran.ok() && done && !HasStore(world.Store(store))) {
    return ExpectNoJournal(world, WorkOf(step));  // there is nothing that it could tell of
  }
  if (!ran.ok() || !json.is_object()) return world.ErrorFault("list: refused", ran.err);
  bool offered = false;
  for (const auto& journal : json.value("journals", nlohmann::json::array())) {
    offered |= journal.at("object") == NameOf(step);
  }
  if (offered && done) world.Fault("list: offers to go on with what is done", ran.out);
  if (!offered && !done) world.Fault("list: does not tell of a journal", ran.out);
  if (done) ExpectNoJournal(world, WorkOf(step));
}

void Ingest(World& world, const Step& given) {
  Step step = given;
  // There is no other name of a store that is still to be made.
  if (step.Text("by") == "hardlink" && !fs::exists(world.Store(step.Int("store", 0)).path)) {
    step.with.erase("by");
  }
  const int64_t store = step.Int("store", 0);
  const std::string by = step.Text("by", "plain");
  Plan plan = MakePlan(world, step, by);
  const std::string name = plan.name;
  RunOptions run;
  run.folder = world.Folder("inputs");
  const bool library = step.Text("via") == "library";
  run.input = plan.input.standard_input;
  run.measure = step.has("memory") && !step.has("kill") && !library;
  if (step.has("kill") && !library) {
    const auto bytes =
        static_cast<uint64_t>(std::max<int64_t>(1, step.Int("kill", 1)) * kJournalUnit);
    run.kill_when = [&world, bytes] { return JournalReaches(world, bytes); };
  }
  if (step.has("operation") && !world.options().faults.empty()) {
    run.environment = {"LD_PRELOAD=" + world.options().faults, "MTDB_FAULT=kill",
                       "MTDB_FAULT_UNDER=" + world.options().folder,
                       "MTDB_FAULT_AT=" + step.Text("operation")};
  }
  ++world.counts().acts;
  const std::set<std::string> before = FilesOf(world);
  Ran ran = Run(CommandOf(world, plan, step), world.scratch(), run);
  if ((step.has("kill") || step.has("operation")) && ran.signal == SIGKILL) ran.killed = true;
  ran = world.Checked(std::move(ran), "mtdb ingest");
  if (ran.killed) {
    // The journal, for the next one that goes on.
    world.interrupted[Place(step)] = WithoutInterruption(step);
    ExpectJournal(world, before, WorkOf(step), false);
    // It may have made the store, and even published.
    std::optional<bool> published = false;
    StorePlace& place = world.Store(store);
    place.model.exists |= HasStore(place);
    if (ReadRecord(place.path, name).ok() && !place.model.objects.contains(name)) {
      TakeOver(world, store, name, std::move(plan.object));
      published = true;
    } else if (place.model.objects.contains(name) && step.Flag("force")) {
      // The old one or the new one: their records tell.
      StoredObject fresh = plan.object;
      const Result<ObjectRecord> record = ReadRecord(place.path, name);
      StoredObject old = *place.model.objects.at(name);
      if (record.ok() && Settle(*record, &fresh).empty()) {
        // The two may be the same to the record.
        published.reset();
        if (!Settle(*record, &old).empty()) {
          TakeOver(world, store, name, std::move(fresh));
          published = true;
        }
      }
    }
    // Who does not look finds the journal there when he goes on.
    if (!library && published && (!step.Flag("tmp") || step.Flag("list"))) {
      CheckList(world, step, published == true);
    }
  } else {
    Judged(world, step, std::move(plan), ran, by);
    StorePlace& place = world.Store(store);
    place.model.exists |= HasStore(place);
    if (ran.ok() && place.model.objects.contains(name)) CheckObject(world, store, name);
    if (ran.ok()) world.interrupted.erase(Place(step));
    if (ran.ok()) ExpectNoJournal(world, WorkOf(step));
    if (PromisesResume(ran)) ExpectJournal(world, before, WorkOf(step), true);
  }
  CheckLeftovers(world);
  CheckStore(world, store, "full");
}

// Two ingests at once, of objects of two names.
void Pair(World& world, const Step& step) {
  const std::string by = step.Text("by", "plain"), by2 = step.Text("by2", "plain");
  Step second = step;
  second.Set("name", step.Text("name2", "b"));
  second.Set("by", by2);
  second.Set("shapeseed", step.Int("shapeseed", 1) + 1);
  Step first = step;
  for (Step* s : {&first, &second}) {
    for (const char* key : {"kill", "resume", "memory", "stdin"}) s->with.erase(key);
  }
  if (NameOf(first) == NameOf(second)) return;
  Plan one = MakePlan(world, first, by);
  Plan two = MakePlan(world, second, by2);
  RunOptions run;
  run.folder = world.Folder("inputs");
  world.counts().acts += 2;
  const std::set<std::string> before = FilesOf(world);
  Child a(CommandOf(world, one, first), world.scratch(), run);
  Child b(CommandOf(world, two, second), world.scratch(), run);
  const Ran ran_a = world.Checked(a.Wait(), "mtdb ingest");
  const Ran ran_b = world.Checked(b.Wait(), "mtdb ingest");
  const std::string strictest = by == "hardlink" || by2 == "hardlink" ? "hardlink" : by;
  Judged(world, first, std::move(one), ran_a, strictest);
  Judged(world, second, std::move(two), ran_b, strictest);
  for (const auto& [ran, s] : {std::pair(ran_a, first), std::pair(ran_b, second)}) {
    if (ran.ok()) ExpectNoJournal(world, WorkOf(s));
    if (PromisesResume(ran)) ExpectJournal(world, before, WorkOf(s), true);
  }
  StorePlace& place = world.Store(step.Int("store", 0));
  place.model.exists |= HasStore(place);
  CheckLeftovers(world);
  CheckStore(world, step.Int("store", 0), "full");
}

// ---- the others ----

void Remove(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  const std::string name = NameOf(step);
  const bool there = place.model.objects.contains(name);
  ++world.counts().acts;
  const std::string by = step.Text("by", "plain");
  const Ran ran = world.Mtdb({"remove", world.PathOf(step.Int("store", 0), by), name});
  if (ran.ok() != there && by != "hardlink") {
    world.ErrorFault(there ? "remove: refused" : "remove: nothing was there", ran.err);
  }
  if (ran.ok()) place.model.objects.erase(name);
  if (ran.ok()) place.Close(name);
  CheckLeftovers(world);
  CheckStore(world, step.Int("store", 0), "full");
}

// The file as it is, while servers and sessions have it open.
void Copy(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  if (!place.model.exists) return;
  ++world.counts().acts;
  const std::string copy = world.Folder("out/copy.mtdb");
  fs::copy_file(place.path, copy, fs::copy_options::overwrite_existing);
  const Ran original = world.Mtdb({"info", place.path, "--json"});
  const Ran copied = world.Mtdb({"info", copy, "--json"});
  const auto objects = [](const Ran& ran) {
    const auto json = nlohmann::json::parse(ran.out, nullptr, false);
    return json.is_object() ? json.at("objects").dump() : ran.err;
  };
  if (objects(original) != objects(copied)) {
    world.Fault("copy: tells something else", copied.out + copied.err);
  }
  const Ran verify = world.Mtdb({"verify", copy, "--level", "full"});
  if (!verify.ok()) world.ErrorFault("copy: damage", verify.out + verify.err);
  for (const char* end : {"", "-lock", ".lock"}) fs::remove(copy + end);
}

void Verify(World& world, const Step& step) {
  CheckStore(world, step.Int("store", 0), step.Text("level", "global"));
  if (step.has("packed")) VerifyPacked(world, step);
  for (const auto& [name, object] : world.Store(step.Int("store", 0)).model.objects) {
    CheckObject(world, step.Int("store", 0), name);
  }
}

void Restart(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  place.sessions.clear();
  place.streams.clear();
  place.server.reset();
}

// Text has the shortest numbers that are a float32's, where all positions are such values.
void RoundToFloat(const StoredObject& object, TriangleMesh* mesh) {
  const auto rounded = [](Vec3d p) {
    for (int i = 0; i < 3; ++i) p[i] = static_cast<float>(p[i]);
    return p;
  };
  const auto is_single = [&](Vec3d p) { return rounded(p) == p; };
  if (!std::ranges::all_of(object.mesh.positions, is_single)) return;
  std::ranges::transform(mesh->positions, mesh->positions.begin(), rounded);
}

// Draco's files have room for so many attributes; those of colours and of normals count as one.
bool TooWideForDraco(const Asked& asked) {
  constexpr size_t kMost = 128;
  const auto& attributes = asked.object->layout.attributes;
  size_t count = attributes.size() + (asked.question->normals ? 1 : 0);
  const auto has = [&](const char* name) {
    return std::ranges::find(attributes, name, &VertexAttribute::name) != attributes.end();
  };
  if (has("red") || has("diffuse_red") || has("r")) count -= 2;
  if (has("nx") || has("normal_x")) count -= 2;
  return count > kMost;
}

void Ask(World& world, const Step& step) {
  const int64_t number = step.Int("store", 0);
  const StoreModel& model = world.Store(number).model;
  if (model.objects.empty()) return;
  auto at = model.objects.begin();
  std::advance(at, static_cast<size_t>(step.Int("of", 0)) % model.objects.size());
  const std::string name = at->first;
  const std::shared_ptr<StoredObject> object = at->second;
  const Question question = MakeQuestion(step, object->truth, object->diagonal);
  const Asked asked{&world, number, name, object.get(), &question, &step};
  ++world.counts().questions;
  const std::vector<std::string> wanted = Split(step.Text("ways"), ',');
  std::optional<Answer> reference;
  std::set<std::string> told;
  for (const NamedWay& way : Ways()) {
    // The first is the one that others are compared with.
    if (reference && step.has("ways") && std::ranges::find(wanted, way.name) == wanted.end()) {
      continue;
    }
    // Hundreds of megabytes need not go all ways, nor what is large for the sake of small caches.
    const std::string is = way.name;
    if (reference && object->mesh.rows.size() > kLargeRows && is != "command") continue;
    if (reference && object->mesh.triangles.size() > kManyTriangles && is != "command" &&
        is != "small-cache" && is != "stream") {
      continue;
    }
    Answer answer;
    answer.way = way.name;
    world.Note(std::string("ask ") + way.name);
    if (!way.ask(asked, &answer)) continue;
    if (answer.mesh.header.from_text) RoundToFloat(*object, &answer.mesh);
    ++world.counts().answers;
    if (step.Text("output") == "drc" && answer.refused.find("Draco holds") != std::string::npos &&
        ((reference && reference->triangles == 0) || TooWideForDraco(asked))) {
      continue;
    }
    if (!answer.refused.empty()) {
      world.ErrorFault("ask: " + answer.way + ": refused", answer.refused);
      continue;
    }
    const auto found = Judge(asked, answer, reference ? &*reference : nullptr, told);
    if (reference) continue;
    reference = std::move(answer);
    told = found;
  }
}

void ProbeAct(World& world, const Step& step) {
  const int64_t number = step.Int("store", 0);
  const StoreModel& model = world.Store(number).model;
  if (model.objects.empty()) return;
  auto at = model.objects.begin();
  std::advance(at, static_cast<size_t>(step.Int("of", 0)) % model.objects.size());
  ++world.counts().questions;
  JudgeProbe(world, step, number, at->first, *at->second);
}

struct NamedAct {
  const char* name;
  Act act;
};
constexpr NamedAct kActs[] = {{"ingest", Ingest},
                              {"pair", Pair},
                              {"remove", Remove},
                              {"copy", Copy},
                              {"verify", Verify},
                              {"restart", Restart},
                              {"ask", Ask},
                              {"probe", ProbeAct},
                              {"rename", RenameAct},
                              {"copy-into", CopyIntoAct},
                              {"compact", CompactAct},
                              {"terrain", TerrainAct},
                              {"picture", PictureAct},
                              {"pack-onto", PackOntoAct},
                              {"page", PageAct},
                              {"tile", TileAct},
                              {"aim", AimAct},
                              {"pour", PourAct},
                              {"beside", BesideAct}};

}  // namespace

Act ActOf(const std::string& name) {
  for (const NamedAct& a : kActs) {
    if (name == a.name) return a.act;
  }
  return nullptr;
}

std::vector<std::string> ActNames() {
  std::vector<std::string> names;
  for (const NamedAct& a : kActs) names.emplace_back(a.name);
  return names;
}

// As its documentation tells users of the library.
void RemoveIfFinished(const std::string& store, const std::string& name,
                      const std::string& journal) {
  const Result<ObjectRecord> record = ReadRecord(store, name);
  if (record.ok()) RemoveFinishedJournal(journal, std::span(&*record, 1));
}

int LibraryIngestMain(int count, char** arguments) {
  BuildOptions options;
  std::vector<std::string> paths;
  std::string name = "a", format;
  bool force = false;
  int64_t reports_left = 0;
  for (int i = 0; i < count; ++i) {
    const std::string argument = arguments[i];
    const size_t equals = argument.find('=');
    const std::string key = argument.substr(0, equals);
    const std::string value = equals == std::string::npos ? "" : argument.substr(equals + 1);
    const auto number = [&] { return std::strtoll(value.c_str(), nullptr, 10); };
    if (key == "--bits") options.bits = static_cast<int>(number());
    if (key == "--step") options.step = std::strtod(value.c_str(), nullptr);
    if (key == "--lossless") options.mode = PositionMode::kLossless;
    if (key == "--weld") options.weld = std::strtod(value.c_str(), nullptr);
    if (key == "--no-weld") options.keep_apart = true;
    if (key == "--orient") options.orient = true;
    if (key == "--normal-bits") options.normal_bits = static_cast<int>(number());
    if (key == "--attribute-step") {
      const size_t split = value.rfind('=');
      options.attribute_steps.push_back(
          {value.substr(0, split), std::strtod(value.c_str() + split + 1, nullptr)});
    }
    if (key == "--threads") options.threads = static_cast<unsigned>(number());
    if (key == "--memory") options.memory_bytes = static_cast<uint64_t>(number()) * kMiB;
    if (key == "--tile") options.tile_triangles = static_cast<uint32_t>(number());
    if (key == "--tmp") options.tmp_directory = value;
    if (key == "--die") reports_left = number();
    if (key == "--name") name = value;
    if (key == "--format") format = value;
    if (key == "--resume") options.resume = true;
    if (key == "--replace") force = true;
    if (!argument.starts_with("--")) paths.push_back(argument);
  }
  const std::string store = paths.back();
  paths.pop_back();
  std::string file_name;
  for (const char c : name) file_name += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  if (options.tmp_directory == ".") {
    options.tmp_directory = fs::path(store).parent_path().string();
    options.journal_path = store + "." + file_name + ".journal";
  } else {
    options.journal_path = options.tmp_directory + "/" + fs::path(store).filename().string() + "." +
                           file_name + ".journal";
  }
  const auto build = [&]() -> Status {
    if (!options.resume) RemoveIfFinished(store, name, options.journal_path);
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                          Database::Open(store, {.writable = true, .create = true}));
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ObjectWriter> writer,
                          database->Create(name, force));
    std::vector<std::string> notes;
    MTDB_ASSIGN_OR_RETURN(const std::vector<MeshInput> inputs,
                          OpenMeshes(paths, format, options.tmp_directory));
    return BuildObject([&](MeshSink& sink) { return ReadMeshes(inputs, sink, &notes); }, options,
                       *writer,
                       [&](const BuildProgress&) {
                         if (--reports_left == 0) ::raise(SIGKILL);
                         return Status::Ok();
                       })
        .status();
  };
  const Status status = build();
  if (!status.ok()) std::fprintf(stderr, "mtdb: %s\n", status.message().c_str());
  return status.ok() ? 0 : 1;
}

}  // namespace mtdb::everything
