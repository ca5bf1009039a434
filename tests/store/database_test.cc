// SPDX-License-Identifier: Apache-2.0
#include "store/database.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <set>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "tests/store/store_fixture.h"

namespace mtdb::test {
namespace {

TEST_CASE("an object comes back as it was written", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const uint32_t max_payload = GENERATE(3u, 700u, 20000u, 300000u);
  const SyntheticObject object = MakeObject({.seed = max_payload, .max_payload = max_payload});
  ObjectRecord published;
  {
    const auto database = OpenWritable(path);
    const auto record = WriteObject(*database, "bunny", object);
    REQUIRE(record.status().message() == "");
    published = *record;
    const auto source = database->OpenObject("bunny");
    REQUIRE(source.status().message() == "");
    CHECK(CompareObject(**source, object).message() == "");
  }
  const auto database = OpenReadOnly(path);
  const auto source = database->OpenObject("");
  REQUIRE(source.status().message() == "");
  CHECK(CompareObject(**source, object).message() == "");
  CHECK(EncodeObjectRecord((*source)->record()) == EncodeObjectRecord(published));
  CHECK(VerifyFailures(path) == "");
  uint64_t payload_bytes = 0;
  for (const auto& u : object.units) payload_bytes += u.payload.size();
  CHECK(published.payload_bytes == payload_bytes);
  CHECK(published.stored_bytes >= payload_bytes);
  CHECK(published.stored_bytes <= *database->FileBytes());
}

TEST_CASE("a small store is hardly larger than its values", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const auto database = OpenWritable(path);
  const auto record =
      WriteObject(*database, "bunny", MakeObject({.clusters = 6, .max_payload = 20000}));
  REQUIRE(record.status().message() == "");
  // What is stored, and two meta pages.
  CHECK(*database->FileBytes() == record->stored_bytes + 2 * 4096);
  CHECK(VerifyFailures(path) == "");
}

TEST_CASE("a store that was never written is one, of two pages", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  CHECK(*OpenWritable(path)->FileBytes() == 2 * 4096);
  CHECK(OpenReadOnly(path)->List()->empty());
  CHECK(VerifyFailures(path) == "");
  CHECK(WriteObject(*OpenWritable(path), "x", MakeObject({})).ok());
  CHECK(VerifyFailures(path) == "");
}

TEST_CASE("the same input gives the same digest under any name, id and store", "[store]") {
  const TempDir dir;
  const SyntheticObject object = MakeObject({.seed = 5});
  SyntheticObject other = object;
  other.units.back().payload[0] ^= std::byte{1};
  SyntheticObject renamed_units = object;
  renamed_units.record.units = std::string("mm");
  const auto a = OpenWritable(dir.File("a.mtdb"));
  const auto b = OpenWritable(dir.File("b.mtdb"));
  REQUIRE(WriteObject(*b, "before", MakeObject({.seed = 6})).ok());
  const auto in_a = WriteObject(*a, "x", object);
  const auto in_b = WriteObject(*b, "another name", object);
  const auto changed = WriteObject(*b, "changed", other);
  const auto units = WriteObject(*b, "units", renamed_units);
  REQUIRE(in_a.ok());
  REQUIRE(in_b.ok());
  REQUIRE(changed.ok());
  REQUIRE(units.ok());
  CHECK(in_a->digest_hex() == in_b->digest_hex());
  CHECK(in_a->stored_bytes == in_b->stored_bytes);
  CHECK(in_a->digest_hex() != changed->digest_hex());
  CHECK(in_a->digest_hex() != units->digest_hex());
  CHECK(in_a->digest_low != in_a->digest_high);
}

TEST_CASE("objects are found by name, listed by name, and counted", "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("a.mtdb"));
  CHECK(database->List()->empty());
  CHECK(database->Find("").status().code() == StatusCode::kNotFound);
  CHECK(database->Find("b").status().code() == StatusCode::kNotFound);
  const SyntheticObject object = MakeObject({.seed = 5, .clusters = 4});
  REQUIRE(WriteObject(*database, "b", object).ok());
  CHECK(database->Find("")->name == "b");
  REQUIRE(WriteObject(*database, "a", object).ok());
  CHECK(database->Find("").status().code() == StatusCode::kInvalidArgument);
  const auto list = database->List();
  REQUIRE(list->size() == 2);
  CHECK((*list)[0].name == "a");
  CHECK((*list)[1].name == "b");
  CHECK((*list)[0].id != (*list)[1].id);
  CHECK(database->Create("", false).status().code() == StatusCode::kInvalidArgument);
  CHECK(database->Create(std::string(501, 'n'), false).status().code() ==
        StatusCode::kInvalidArgument);
  REQUIRE(WriteObject(*database, std::string(500, 'n'), object).status().message() == "");
  CHECK(database->List()->size() == 3);
  CHECK(VerifyFailures(database->path()) == "");
  CHECK(VerifyFailures(database->path(), "a") == "");
  CHECK(VerifyFailures(database->path(), "missing") != "");
}

TEST_CASE("a published name is kept, unless it is replaced", "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("a.mtdb"));
  const SyntheticObject first = MakeObject({.seed = 1});
  const SyntheticObject second = MakeObject({.seed = 2});
  const auto published = WriteObject(*database, "x", first);
  REQUIRE(published.ok());
  CHECK(database->Create("x", false).status().code() == StatusCode::kAlreadyExists);
  const auto source = database->OpenObject("x");
  REQUIRE(source.ok());
  const auto replaced = WriteObject(*database, "x", second, true);
  REQUIRE(replaced.status().message() == "");
  CHECK(replaced->id > published->id);
  CHECK(CompareObject(**database->OpenObject("x"), second).message() == "");
  // The old handle says what happened.
  const Status status = CompareObject(**source, first);
  CHECK(status.code() == StatusCode::kNotFound);
  CHECK(status.message().find("object x was removed from") == 0);
  CHECK(VerifyFailures(database->path()) == "");
}

TEST_CASE("removal frees the pages for the next object", "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("a.mtdb"));
  const SyntheticObject object = MakeObject({.seed = 1, .max_payload = 50000});
  REQUIRE(WriteObject(*database, "x", object).ok());
  const auto source = database->OpenObject("x");
  REQUIRE(source.ok());
  const uint64_t bytes = *database->FileBytes();
  CHECK(database->Remove("y").code() == StatusCode::kNotFound);
  for (int i = 0; i < 6; ++i) {
    REQUIRE(database->Remove("x").message() == "");
    CHECK(database->List()->empty());
    CHECK(database->OpenObject("x").status().code() == StatusCode::kNotFound);
    CHECK(VerifyFailures(database->path()) == "");
    REQUIRE(WriteObject(*database, "x", object).ok());
  }
  CHECK(*database->FileBytes() < 2 * bytes);
  CHECK(CompareObject(**source, object).code() == StatusCode::kNotFound);
}

TEST_CASE("an object that is not published leaves nothing", "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("a.mtdb"));
  const SyntheticObject object = MakeObject({.seed = 1});
  {
    const auto writer = database->Create("x", false);
    REQUIRE(writer.ok());
    for (const auto& u : std::span(object.units).first(object.record.clusters)) {
      REQUIRE((*writer)->Add(u.entry, u.children, u.payload).ok());
    }
    CHECK(database->Create("x", true).status().code() == StatusCode::kBusy);
    CHECK(database->List()->empty());
    const auto wrong = (*writer)->Publish(object.record);  // root pieces are missing
    CHECK(wrong.status().code() == StatusCode::kInvalidArgument);
  }
  CHECK(database->List()->empty());
  CheckReport report;
  REQUIRE(VerifyStore(database->path(), "", &report).ok());
  CHECK(report.ok());
  CHECK(report.checks[1] == "catalog: 0 objects, 0 being built, 0 being removed");
  REQUIRE(WriteObject(*database, "x", object).ok());
}

TEST_CASE("two objects are built at a time", "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("a.mtdb"));
  const SyntheticObject a = MakeObject({.seed = 1});
  const SyntheticObject b = MakeObject({.seed = 2});
  const auto writer = database->Create("a", false);
  REQUIRE(writer.ok());
  const std::span a_units(a.units);
  for (const auto& u : a_units.first(a.record.clusters)) {
    REQUIRE((*writer)->Add(u.entry, u.children, u.payload).ok());
  }
  REQUIRE(WriteObject(*database, "b", b).ok());
  for (const auto& u : a_units.subspan(a.record.clusters)) {
    REQUIRE((*writer)->Add(u.entry, u.children, u.payload).ok());
  }
  REQUIRE((*writer)->Publish(a.record).ok());
  CHECK(CompareObject(**database->OpenObject("a"), a).message() == "");
  CHECK(CompareObject(**database->OpenObject("b"), b).message() == "");
  CHECK(VerifyFailures(database->path()) == "");
}

TEST_CASE("entries that break the rules are refused with their reason", "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("a.mtdb"));
  const auto writer = database->Create("x", false);
  REQUIRE(writer.ok());
  UnitEntry e = MakeObject({.seed = 1}).units[0].entry;
  e.hilbert = 10;
  REQUIRE((*writer)->Add(e, {}, Bytes(1)).ok());
  const auto code = [&](const UnitEntry& entry, std::vector<UnitId> children) {
    return (*writer)->Add(entry, children, Bytes(1)).status().code();
  };
  UnitEntry bad = e;
  bad.round = 0;
  CHECK(code(bad, {}) == StatusCode::kInvalidArgument);
  bad = e;
  bad.hilbert = 9;
  CHECK(code(bad, {}) == StatusCode::kInvalidArgument);
  bad = e;
  bad.nodes = 0;
  CHECK(code(bad, {}) == StatusCode::kInvalidArgument);
  bad = e;
  bad.bounds = {};
  CHECK(code(bad, {}) == StatusCode::kInvalidArgument);
  CHECK(code(e, {0}) == StatusCode::kInvalidArgument);  // a child of the same round
  UnitEntry coarser = e;
  coarser.round = 2;
  CHECK(code(coarser, {0, 0}) == StatusCode::kInvalidArgument);
  CHECK(code(coarser, {1}) == StatusCode::kInvalidArgument);
  CHECK(code(coarser, {0}) == StatusCode::kOk);
  CHECK(code(e, {}) == StatusCode::kInvalidArgument);  // back to a finer round
  CHECK((*writer)->Add(coarser, {}, {}).status().code() == StatusCode::kInvalidArgument);
  UnitEntry piece;
  piece.round = kRootRound;
  piece.bounds = e.bounds;
  CHECK((*writer)->Add(piece, {}, {}).status().code() == StatusCode::kInvalidArgument);
  for (const auto& spoil : std::vector<std::function<void(UnitEntry&)>>{
           [](UnitEntry& p) { p.nodes = 1; }, [](UnitEntry& p) { p.in_triangles = 1; },
           [](UnitEntry& p) { p.error_code_max = 1; }, [](UnitEntry& p) { p.explicit_arcs = true; },
           [](UnitEntry& p) { p.round = 3; }}) {
    bad = piece;
    spoil(bad);
    CHECK(code(bad, {}) == StatusCode::kInvalidArgument);
  }
  CHECK(code(piece, {1}) == StatusCode::kOk);
  CHECK(code(piece, {2}) == StatusCode::kInvalidArgument);  // a piece of the root
  CHECK(code(coarser, {}) == StatusCode::kInvalidArgument);
}

TEST_CASE("an object of more root vertices than its root pieces name is refused", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const auto database = OpenWritable(path);
  SyntheticObject object = MakeObject({.seed = 9, .clusters = 40});
  uint64_t most = 0;
  for (size_t i = object.record.clusters; i < object.units.size(); ++i) {
    most += object.units[i].entry.external_vertices;
  }
  for (const uint64_t vertices : {most, most + 1, uint64_t{1} << 32, uint64_t{1} << 50}) {
    object.record.root_vertices = vertices;
    object.record.vertices = vertices + object.record.nodes;
    const std::string name = std::to_string(vertices);
    INFO(name << " of " << most);
    REQUIRE(WriteObject(*database, name, object).status().message() == "");
    const auto source = database->OpenObject(name);
    CHECK(source.ok() == (vertices <= most));
    if (vertices <= most) continue;
    CHECK(source.status().code() == StatusCode::kCorrupt);
    CHECK(source.status().message().find(name + " root vertices, but the root pieces have " +
                                         std::to_string(most)) != std::string::npos);
    CHECK(VerifyFailures(path, name).find("root vertices") != std::string::npos);
  }
}

TEST_CASE("handles of a file share one environment, also when one of them writes", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject a = MakeObject({.seed = 1});
  const SyntheticObject b = MakeObject({.seed = 2});
  REQUIRE(WriteObject(*OpenWritable(path), "a", a).ok());
  const auto reader = OpenReadOnly(path);
  const auto source = reader->OpenObject("a");
  REQUIRE(source.ok());
  CHECK(reader->Create("b", false).status().code() == StatusCode::kInvalidArgument);
  CHECK(reader->Remove("a").code() == StatusCode::kInvalidArgument);
  const auto writer = OpenWritable(path);
  REQUIRE(WriteObject(*writer, "b", b).ok());
  const auto link = dir.File("link.mtdb");
  std::filesystem::create_symlink(path, link);
  const auto by_link = OpenReadOnly(link);
  CHECK(CompareObject(**source, a).message() == "");
  CHECK(CompareObject(**reader->OpenObject("b"), b).message() == "");
  CHECK(CompareObject(**by_link->OpenObject("b"), b).message() == "");
}

TEST_CASE("many threads read while one publishes and removes", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject kept = MakeObject({.seed = 1, .clusters = 100});
  const auto database = OpenWritable(path);
  REQUIRE(WriteObject(*database, "kept", kept).ok());
  const auto shared = database->OpenObject("kept");
  REQUIRE(shared.ok());
  std::atomic<bool> stop{false};
  std::atomic<int> reads{0};
  std::vector<std::string> errors(4);
  std::vector<std::thread> readers;
  for (size_t t = 0; t < errors.size(); ++t) {
    readers.emplace_back([&, t] {
      while (!stop || reads < 20) {
        Status status = CompareObject(**shared, kept);
        if (status.ok() && t % 2 == 0) {
          const auto own = OpenReadOnly(path)->OpenObject("kept");
          status = own.ok() ? CompareObject(**own, kept) : own.status();
        }
        if (!status.ok()) {
          errors[t] = status.message();
          break;
        }
        ++reads;
      }
    });
  }
  const SyntheticObject passing = MakeObject({.seed = 2, .clusters = 30});
  for (int i = 0; i < 10; ++i) {
    CHECK(WriteObject(*database, "passing", passing, true).status().message() == "");
    if (i % 3 == 2) CHECK(database->Remove("passing").message() == "");
  }
  stop = true;
  for (std::thread& t : readers) t.join();
  for (const std::string& e : errors) CHECK(e == "");
  CHECK(VerifyFailures(path) == "");
}

TEST_CASE("objects built side by side have ids of their own, in any order of publishing",
          "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("a.mtdb"));
  const SyntheticObject object = MakeObject({.seed = 1, .clusters = 4});
  const auto publish = [&](ObjectWriter& writer) {
    for (const auto& u : object.units) {
      REQUIRE(writer.Add(u.entry, u.children, u.payload).ok());
    }
    return writer.Publish(object.record).value().id.value;
  };
  auto first = database->Create("first", false).value();
  auto second = database->Create("second", false).value();
  const uint64_t second_id = publish(*second);
  auto third = database->Create("third", false).value();
  const uint64_t first_id = publish(*first);
  first.reset();  // its id is free to lock, but used
  auto fourth = database->Create("fourth", false).value();
  const uint64_t fourth_id = publish(*fourth);
  const uint64_t third_id = publish(*third);
  const std::set<uint64_t> ids{first_id, second_id, third_id, fourth_id};
  CHECK(ids.size() == 4);
  for (const char* name : {"first", "second", "third", "fourth"}) {
    CHECK(CompareObject(**database->OpenObject(name), object).message() == "");
  }
  CHECK(VerifyFailures(database->path()) == "");
}

TEST_CASE("small rounds share a value", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const auto database = OpenWritable(path);
  const SyntheticObject object = MakeObject({.clusters = 16, .max_payload = 1000});
  REQUIRE(object.units[object.record.clusters - 1].entry.round > 2);
  REQUIRE(WriteObject(*database, "x", object).ok());
  const auto source = database->OpenObject("x").value();
  const ClusterIndex& index = source->index();
  for (uint32_t i = 0; i < index.cluster_count(); ++i) {
    CHECK(index.location(i).value == 0);
  }
}

TEST_CASE("a name that another process builds is busy", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  int to_child[2];
  int to_parent[2];
  REQUIRE(::pipe(to_child) == 0);
  REQUIRE(::pipe(to_parent) == 0);
  const pid_t child = ::fork();
  char byte = 0;
  if (child == 0) {
    const auto database = Database::Open(path, {.writable = true});
    if (!database.ok()) ::_exit(1);
    const auto writer = (*database)->Create("x", false);
    if (!writer.ok() || ::write(to_parent[1], "r", 1) != 1) ::_exit(2);
    ::_exit(::read(to_child[0], &byte, 1) == 1 ? 0 : 3);  // like a crash: nothing is cleaned
  }
  REQUIRE(::read(to_parent[0], &byte, 1) == 1);
  const auto database = OpenWritable(path);
  const auto busy = database->Create("x", true);
  CHECK(busy.status().code() == StatusCode::kBusy);
  CHECK(database->Create("y", false).ok());
  REQUIRE(::write(to_child[1], "g", 1) == 1);
  int status = 0;
  ::waitpid(child, &status, 0);
  CHECK(status == 0);
  CHECK(WriteObject(*database, "x", MakeObject({.seed = 1})).status().message() == "");
  CHECK(VerifyFailures(path) == "");
}

TEST_CASE("reading a cluster reads its own bytes and few pages of the tree", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject object = MakeObject({.seed = 1, .clusters = 300, .max_payload = 20000});
  REQUIRE(WriteObject(*OpenWritable(path), "x", object).ok());
  const auto database = OpenReadOnly(path);
  const auto source = database->OpenObject("x");
  REQUIRE(source.ok());
  const auto ignore = [](UnitId, Bytes) { return Status::Ok(); };
  const auto read = [&](uint32_t id) {
    const uint64_t before = (*source)->bytes_read();
    const UnitId ids[] = {id};
    REQUIRE(ReadUnits(**source, ids, ignore).ok());
    return (*source)->bytes_read() - before - object.units[id].payload.size();
  };
  CHECK(read(150) <= 16 + 4 * 4096);
  CHECK(read(150) == 4 * 152);  // the meta pages, each twice
  const UnitId bad[] = {100000};
  CHECK(ReadUnits(**source, bad, ignore).code() == StatusCode::kInvalidArgument);
  const UnitId good[] = {1, 0};
  int calls = 0;
  const auto stop = [&](UnitId, Bytes) {
    ++calls;
    return Status(StatusCode::kCancelled, "enough");
  };
  CHECK(ReadUnits(**source, good, stop).code() == StatusCode::kCancelled);
  CHECK(calls == 1);
}

}  // namespace
}  // namespace mtdb::test
