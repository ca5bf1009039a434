// SPDX-License-Identifier: Apache-2.0
// Packed files: what is packed comes out again, the file does not depend on where it came from, and
// every byte of it is checked.
#include "store/packed_file.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <condition_variable>
#include <mutex>
#include <numeric>
#include <random>
#include <thread>

#include "store/base/out_of_memory.h"
#include "store/copy.h"
#include "store/packed/packed_reader.h"
#include "tests/store/store_fixture.h"
#include "tests/support/failing_allocation.h"

namespace mtdb::test {

using namespace internal;
namespace {

Bytes PackAll(const Database& database, const std::vector<std::string>& names) {
  std::vector<std::shared_ptr<ClusterSource>> sources;
  for (const std::string& name : names) {
    auto source = database.OpenObject(name, true);
    REQUIRE(source.ok());
    sources.push_back(*source);
  }
  Bytes file;
  const auto report = PackObjects(sources, [&](ByteSpan bytes) {
    file.insert(file.end(), bytes.begin(), bytes.end());
    return Status::Ok();
  });
  REQUIRE(report.status().message() == "");
  REQUIRE(report->file_bytes == file.size());
  return file;
}

struct Packed {
  SyntheticObject first, second;
  Bytes bytes;
  std::vector<ObjectRecord> records;  // in the store
};

Packed MakePacked(const TempDir& dir, uint32_t clusters, uint32_t max_payload) {
  Packed p;
  p.first = MakeObject({.seed = 1,
                        .clusters = clusters,
                        .max_payload = max_payload,
                        .page_bytes = {max_payload, 0, 1, 2 * size_t{max_payload}}});
  p.second = MakeObject({.seed = 2, .clusters = clusters / 4, .max_payload = 2 * max_payload});
  const auto store = OpenWritable(dir.File("store.mtdb"));
  REQUIRE(WriteObject(*store, "second", p.second).ok());
  REQUIRE(WriteObject(*store, "first", p.first).ok());
  p.bytes = PackAll(*store, {"first", "second"});
  p.records = store->List().value();
  return p;
}

// The bytes of a file, answered by a thread of its own, in any order; some fail.
class LateRanges final : public RangeReader {
 public:
  LateRanges(Bytes bytes, uint64_t seed, double failing = 0) : shared_(std::make_shared<Shared>()) {
    shared_->bytes = std::move(bytes);
    shared_->random.seed(seed);
    shared_->failing = failing;
    thread_ = std::thread([shared = shared_] { Run(*shared); });
  }
  ~LateRanges() override {
    {
      const std::lock_guard lock(shared_->mutex);
      shared_->stopping = true;
    }
    shared_->asked.notify_all();
    if (thread_.get_id() == std::this_thread::get_id()) {
      thread_.detach();  // an answer was the last to hold the reader
    } else {
      thread_.join();
    }
  }
  const std::string& name() const override { return name_; }
  uint64_t size() const override { return shared_->bytes.size(); }
  Ticket Read(ByteRange range, Answer answer) override {
    REQUIRE(range.offset + range.bytes <= size());
    const std::lock_guard lock(shared_->mutex);
    shared_->open.emplace_back(range, std::move(answer));
    shared_->asked.notify_all();
    bytes_read_ += range.bytes;
    return ++requests_;
  }
  bool answers_at_once() const override { return false; }
  uint64_t bytes_read() const override { return bytes_read_; }
  uint64_t requests() const override { return requests_; }

 private:
  // What the thread needs, which may outlive the reader.
  struct Shared {
    Bytes bytes;
    std::mutex mutex;
    std::condition_variable asked;
    std::vector<std::pair<ByteRange, Answer>> open;
    std::mt19937_64 random;
    double failing = 0;
    bool stopping = false;
  };

  static void Run(Shared& shared) {
    std::unique_lock lock(shared.mutex);
    while (!shared.stopping) {
      if (shared.open.empty()) {
        shared.asked.wait(lock);
        continue;
      }
      std::swap(shared.open[shared.random() % shared.open.size()], shared.open.back());
      auto [range, answer] = std::move(shared.open.back());
      shared.open.pop_back();
      const bool fails = static_cast<double>(shared.random() % 1000) < 1000 * shared.failing;
      lock.unlock();
      if (fails) {
        answer(IoError("the line is dead"));
      } else {
        const auto begin = shared.bytes.begin() + static_cast<ptrdiff_t>(range.offset);
        answer(Bytes(begin, begin + static_cast<ptrdiff_t>(range.bytes)));
      }
      answer = {};  // without the lock: it may end the reader
      lock.lock();
    }
  }

  const std::string name_ = "late";
  const std::shared_ptr<Shared> shared_;
  uint64_t bytes_read_ = 0;
  uint64_t requests_ = 0;
  std::thread thread_;
};

// The bytes of a file, answered when Pump() is called, and until then by Hold() at once.
class PumpedRanges final : public RangeReader {
 public:
  explicit PumpedRanges(Bytes bytes) : bytes_(std::move(bytes)) {}
  const std::string& name() const override { return name_; }
  uint64_t size() const override { return bytes_.size(); }
  bool answers_at_once() const override { return false; }
  Ticket Read(ByteRange range, Answer answer) override {
    open_.emplace_back(range, std::move(answer));
    if (!held_) Pump();
    return ++requests_;
  }
  uint64_t bytes_read() const override { return 0; }
  uint64_t requests() const override { return requests_; }
  void Hold() { held_ = true; }
  void Pump() {
    while (!open_.empty()) {
      auto [range, answer] = std::move(open_.back());
      open_.pop_back();
      const auto begin = bytes_.begin() + static_cast<ptrdiff_t>(range.offset);
      const auto end = begin + static_cast<ptrdiff_t>(range.bytes);
      answer(CatchOutOfMemory([&]() -> Result<Bytes> { return Bytes(begin, end); }));
    }
  }

 private:
  const std::string name_ = "pumped";
  const Bytes bytes_;
  std::vector<std::pair<ByteRange, Answer>> open_;
  uint64_t requests_ = 0;
  bool held_ = false;
};

// How often each unit was answered, and how.
class CountingReceiver final : public PayloadReceiver {
 public:
  explicit CountingReceiver(size_t units) : answers(units), ok(units) {}
  void Receive(UnitId unit, Result<Bytes> payload) override {
    ++answers[unit];
    ok[unit] = payload.ok();
    if (!payload.ok() && payload.status().code() != StatusCode::kNoSpace) ++others;
  }
  std::vector<int> answers, ok;
  int others = 0;
};

bool HasPromisedRows(const ClusterIndex& index, UnitId unit) {
  const auto has = [&](UnitId u) { return index.Has(u); };
  if (!has(unit) || !std::ranges::all_of(index.parents(unit), has)) return false;
  uint8_t below = 0;
  for (const UnitId c : index.children(unit)) {
    if (!has(c)) return false;
    below = std::max(below, index.unit(c).error_code_max);
  }
  return index.error_code_below(unit) == below;
}

// All units, coarse ones first as a query asks for them, or an error; with kInvalidArgument when
// something is not what was written, or a row is not there.
Status ReadFromTop(ClusterSource& source, const SyntheticObject& object, size_t at_once) {
  const auto differs = [](const std::string& what) { return InvalidArgument("differs: " + what); };
  const ClusterIndex& index = source.index();
  for (uint32_t end = index.unit_count(); end > 0;) {
    std::vector<UnitId> units;
    for (; end > 0 && units.size() < at_once; --end) units.push_back(end - 1);
    MTDB_RETURN_IF_ERROR(ReadUnits(source, units, [&](UnitId u, const Bytes& payload) {
      if (payload != object.units[u].payload) return differs("payload");
      if (!HasPromisedRows(index, u)) return differs("rows that are promised");
      if (index.unit(u) != object.units[u].entry) return differs("entry");
      return Status::Ok();
    }));
  }
  VertexIndex vertex = object.record.root_vertices;
  for (UnitId u = 0; u < index.unit_count(); ++u) {
    if (index.first_vertex(u) != vertex) return differs("first vertex");
    vertex += index.unit(u).nodes;
    if (!std::ranges::equal(index.children(u), object.units[u].children))
      return differs("children");
  }
  return Status::Ok();
}

// Opens the bytes as over a network and reads all.
Status ReadLate(const Bytes& bytes, const Packed& packed, uint64_t seed, double failing = 0) {
  MTDB_ASSIGN_OR_RETURN(const auto file,
                        PackedFile::Open(std::make_shared<LateRanges>(bytes, seed, failing)));
  for (const auto& [name, object] :
       {std::pair{"first", &packed.first}, std::pair{"second", &packed.second}}) {
    MTDB_ASSIGN_OR_RETURN(const PackedObject* const entry, file->Find(name));
    MTDB_ASSIGN_OR_RETURN(const auto source, PackedSource::Open(file, *entry, false));
    MTDB_RETURN_IF_ERROR(ReadFromTop(*source, *object, 1 + seed % 50));
    MTDB_RETURN_IF_ERROR(CompareFiles(*source, *object));
  }
  return Status::Ok();
}

Status ReadAtOnce(const std::string& path, const Packed& packed) {
  MTDB_ASSIGN_OR_RETURN(const auto database, Database::Open(path));
  for (const auto& [name, object] :
       {std::pair{"first", &packed.first}, std::pair{"second", &packed.second}}) {
    MTDB_ASSIGN_OR_RETURN(const auto source, database->OpenObject(name));
    MTDB_RETURN_IF_ERROR(CompareObject(*source, *object));
  }
  return Status::Ok();
}

}  // namespace

TEST_CASE("what is packed is read and unpacked as it was", "[packed]") {
  const TempDir dir;
  for (const uint32_t clusters : {4u, 150u, 900u}) {
    const TempDir here;
    const Packed packed = MakePacked(here, clusters, 700);
    const std::string path = here.File("file.mtdbp");
    WriteFile(path, packed.bytes);
    CHECK(VerifyFailures(path) == "");
    CHECK(VerifyFailures(path, "second") == "");
    CHECK(VerifyFailures(path, "third") != "");
    CHECK(ReadAtOnce(path, packed).message() == "");
    for (const uint64_t seed : {1u, 20u, 47u}) {
      CHECK(ReadLate(packed.bytes, packed, seed).message() == "");
    }
    const auto database = OpenReadOnly(path);
    CHECK(database->is_packed());
    CHECK(database->FileBytes().value() == packed.bytes.size());
    const auto records = database->List().value();
    REQUIRE(records.size() == 2);
    const auto store = OpenWritable(here.File("unpacked.mtdb"));
    for (size_t i = 0; i < records.size(); ++i) {
      CHECK(records[i].digest_hex() == packed.records[i].digest_hex());
      const auto source = database->OpenObject(records[i].name);
      REQUIRE(source.ok());
      const auto copy = CopyObject(**source, *store, (*source)->record().name, false);
      REQUIRE(copy.status().message() == "");
      CHECK(copy->digest_hex() == packed.records[i].digest_hex());
      CHECK(CopyObject(**source, *store, (*source)->record().name, false).status().code() ==
            StatusCode::kAlreadyExists);
    }
    CHECK(VerifyFailures(here.File("unpacked.mtdb")) == "");
    // The same file, whichever way the objects went.
    CHECK(PackAll(*store, {"first", "second"}) == packed.bytes);
    CHECK(PackAll(*database, {"first", "second"}) == packed.bytes);
    CHECK(PackAll(*store, {"second", "first"}) != packed.bytes);
  }
}

TEST_CASE("an image of an object has the bytes of its packed file, in any range") {
  const TempDir dir;
  const uint32_t clusters = GENERATE(1, 40, 700);
  const SyntheticObject object = MakeObject(
      {.seed = 7, .clusters = clusters, .max_payload = 900, .page_bytes = {0, 1, 3 << 20, 999}});
  const auto store = OpenWritable(dir.File("store.mtdb"));
  REQUIRE(WriteObject(*store, "one", object).ok());
  const Bytes file = PackAll(*store, {"one"});
  const auto image = PackedImage::Open(store->OpenObject("one", true).value());
  REQUIRE(image.status().message() == "");
  REQUIRE((*image)->size() == file.size());
  const auto same = [&](uint64_t offset, uint64_t bytes) {
    const auto part = (*image)->Read({offset, bytes});
    return part.ok() && std::ranges::equal(*part, ByteSpan(file).subspan(offset, bytes));
  };
  REQUIRE(same(0, file.size()));
  REQUIRE(same(file.size(), 0));
  std::mt19937_64 random(clusters);
  for (int i = 0; i < 500; ++i) {
    const uint64_t offset = random() % file.size();
    REQUIRE(same(offset, random() % (file.size() - offset + 1)));
    REQUIRE(same(offset, std::min<uint64_t>(file.size() - offset, random() % 40)));
  }
  REQUIRE((*image)->Read({file.size(), 1}).status().code() == StatusCode::kInvalidArgument);
  REQUIRE((*image)->Read({0, file.size() + 1}).status().code() == StatusCode::kInvalidArgument);
  REQUIRE((*image)->Read({1, ~uint64_t{0}}).status().code() == StatusCode::kInvalidArgument);
}

TEST_CASE("a packed file is not written to", "[packed]") {
  const TempDir dir;
  const Packed packed = MakePacked(dir, 20, 100);
  const std::string path = dir.File("file.mtdbp");
  WriteFile(path, packed.bytes);
  CHECK(Database::Open(path, {.writable = true}).status().code() == StatusCode::kInvalidArgument);
  const auto database = OpenReadOnly(path);
  CHECK(database->Create("x", false).status().code() == StatusCode::kInvalidArgument);
  CHECK(database->Remove("first").code() == StatusCode::kInvalidArgument);
  CHECK(database->OpenObject("x").status().code() == StatusCode::kNotFound);
  CHECK(database->OpenObject("").status().code() == StatusCode::kInvalidArgument);
  CHECK(ReadFile(path) == packed.bytes);
}

TEST_CASE("an object of more units has no longer directory, but larger pages", "[packed]") {
  const TempDir dir;
  SyntheticObject object;
  uint32_t before = 0;
  uint8_t round = 1;
  const auto add = [&](uint8_t in_round, uint32_t first_child, uint32_t children) {
    SyntheticObject::Unit u;
    u.entry.round = in_round;
    u.entry.nodes = in_round == kRootRound ? 0 : 1 + object.units.size() % 3;
    u.entry.external_vertices = 20;
    u.entry.bounds.Add(Vec3i{1, 2, 3});
    for (uint32_t c = 0; c < children; ++c) u.children.push_back(first_child + c);
    u.payload.resize(1 + object.units.size() % 5, std::byte{7});
    object.record.nodes += u.entry.nodes;
    object.units.push_back(std::move(u));
  };
  for (uint32_t count = 40960; count > 10; count /= 4, ++round) {
    const auto here = static_cast<uint32_t>(object.units.size());
    for (uint32_t i = 0; i < count; ++i) add(round, before + 4 * i, round == 1 ? 0 : 4);
    object.record.rounds.emplace_back();
    before = here;
  }
  object.record.clusters = static_cast<uint32_t>(object.units.size());
  object.record.root_pieces = 1;
  object.record.root_vertices = 17;
  object.record.vertices = 17 + object.record.nodes;
  object.record.bounds.Add(Vec3d{0, 1, 2});
  add(kRootRound, before, object.record.clusters - before);
  const auto store = OpenWritable(dir.File("store.mtdb"));
  REQUIRE(WriteObject(*store, "large", object).status().message() == "");
  const Bytes bytes = PackAll(*store, {"large"});
  const auto ranges = std::make_shared<LateRanges>(bytes, 3);
  const auto file = PackedFile::Open(ranges).value();
  CHECK(file->objects()[0].pages.size() <= 512);
  CHECK(file->objects()[0].rows_per_page == 128);
  const auto source = PackedSource::Open(file, file->objects()[0], false).value();
  CHECK(ranges->bytes_read() < 120000);
  CHECK(ReadFromTop(*source, object, 100).message() == "");
}

TEST_CASE("every flipped byte of a packed file is found and never read as if it were right",
          "[packed]") {
  const TempDir dir;
  const Packed packed = MakePacked(dir, 24, 16);
  const std::string path = dir.File("flipped.mtdbp");
  INFO(packed.bytes.size() << " bytes");
  std::mt19937_64 random(7);
  for (size_t at = 0; at < packed.bytes.size(); ++at) {
    Bytes flipped = packed.bytes;
    flipped[at] ^= static_cast<std::byte>(1u << random() % 8);
    WriteFile(path, flipped);
    const std::string failures = VerifyFailures(path);
    const Status read = ReadAtOnce(path, packed);
    const Status late = at % 29 == 0 ? ReadLate(flipped, packed, at) : read;
    if (failures == "" || read.ok() || late.ok() || read.message().starts_with("differs") ||
        late.message().starts_with("differs")) {
      FAIL("byte " << at << ": verify: " << failures << "; read: " << read.message()
                   << "; late: " << late.message());
    }
  }
}

TEST_CASE("a packed file that is cut off or appended to is refused", "[packed]") {
  const TempDir dir;
  const Packed packed = MakePacked(dir, 60, 60);
  const std::string path = dir.File("cut.mtdbp");
  for (size_t size = 0; size <= packed.bytes.size() + 3; ++size) {
    if (size == packed.bytes.size()) continue;
    if (size > 300 && size % 97 != 0 && size + 5 < packed.bytes.size()) continue;
    Bytes cut = packed.bytes;
    cut.resize(size);
    WriteFile(path, cut);
    const auto database = Database::Open(path);
    INFO(size << " of " << packed.bytes.size());
    REQUIRE(!database.ok());
    CHECK(database.status().code() == StatusCode::kCorrupt);
    CHECK(database.status().message().starts_with(path + ": "));
    CHECK(VerifyFailures(path) != "");
  }
}

TEST_CASE("a header that claims a directory larger than any is refused before it is read",
          "[packed]") {
  const TempDir dir;
  const std::string path = dir.File("sparse.mtdbp");
  internal::PackedHeader header;
  header.file_bytes = uint64_t{1} << 40;
  for (const uint64_t bytes : {internal::kMaxDirectoryBytes + 1, header.file_bytes - 72}) {
    header.directory_bytes = bytes;
    header.first_bytes = 72 + bytes;
    WriteFile(path, internal::EncodePackedHeader(header));
    std::filesystem::resize_file(path, header.file_bytes);
    const auto database = Database::Open(path);
    REQUIRE(!database.ok());
    CHECK_THAT(database.status().message(), Catch::Contains("impossible numbers"));
  }
}

TEST_CASE("a directory whose textures are not in its objects' bytes is refused", "[packed]") {
  const TempDir dir;
  const Packed packed = MakePacked(dir, 20, 100);
  const std::string path = dir.File("changed.mtdbp");
  const auto opened = [&](const std::function<void(PackedObject*)>& change) {
    PackedHeader header = DecodePackedHeader(packed.bytes, packed.bytes.size(), "file").value();
    std::vector<PackedObject> objects =
        DecodePackedDirectory(
            ByteSpan(packed.bytes).subspan(kPackedHeaderBytes, header.directory_bytes), header,
            "file")
            .value();
    change(&objects[0]);
    const Bytes directory = EncodePackedDirectory(objects);
    REQUIRE(directory.size() == header.directory_bytes);
    SetContentHash(directory, &header);
    Bytes bytes = packed.bytes;
    const Bytes head = EncodePackedHeader(header);
    std::ranges::copy(head, bytes.begin());
    std::ranges::copy(directory, bytes.begin() + kPackedHeaderBytes);
    WriteFile(path, bytes);
    return Database::Open(path).status();
  };
  CHECK(opened([](PackedObject*) {}).message() == "");
  CHECK(VerifyFailures(path) == "");
  const auto larger = [](uint64_t bytes) {
    return [=](PackedObject* o) { o->record.texture->pages[3].bytes = bytes; };
  };
  REQUIRE(packed.first.files[3].size() == 200);  // its length takes two bytes
  CHECK(opened(larger(16000)).code() == StatusCode::kCorrupt);
  // Into the last payload: found when that is read, or the file.
  CHECK_FALSE((opened(larger(201)).ok() && VerifyFailures(path) == ""));
  CHECK_FALSE((opened(larger(199)).ok() && VerifyFailures(path) == ""));
  CHECK(opened([](PackedObject* o) { o->record.texture->pages[0].checksum ^= 1; }).ok());
  CHECK_THAT(VerifyFailures(path), Catch::Contains("object first: page 0 (page1.jpg): checksum"));
}

TEST_CASE("reads that fail are errors of what needs them, and may be tried again", "[packed]") {
  const TempDir dir;
  const Packed packed = MakePacked(dir, 400, 300);
  size_t failed = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const Status status = ReadLate(packed.bytes, packed, seed, 0.02);
    if (status.ok()) continue;
    ++failed;
    CHECK(status.code() == StatusCode::kIoError);
  }
  CHECK(failed > 5);
  const auto file = PackedFile::Open(std::make_shared<LateRanges>(packed.bytes, 5, 0.1));
  if (!file.ok()) return;
  const auto source = PackedSource::Open(*file, (*file)->objects()[0], false);
  if (!source.ok()) return;
  Status status = IoError("");
  for (int i = 0; i < 1000 && !status.ok(); ++i) {
    status = ReadFromTop(**source, packed.first, 3);
    REQUIRE((status.ok() || status.code() == StatusCode::kIoError));
    if (i > 20) break;  // units that were read are read again: no progress is promised
  }
}

TEST_CASE("memory that runs out while bytes arrive is the error of what waits for them",
          "[packed]") {
  using testing::FailingAllocation;
  const TempDir dir;
  const Packed packed = MakePacked(dir, 400, 300);
  for (const auto mode : {FailingAllocation::Mode::kOnce, FailingAllocation::Mode::kFromThenOn}) {
    uint64_t step = 1;
    for (uint64_t n = 1;; n += step) {
      const auto ranges = std::make_shared<PumpedRanges>(packed.bytes);
      const auto file = PackedFile::Open(ranges).value();
      const auto source = PackedSource::Open(file, file->objects()[0], false).value();
      ranges->Hold();
      std::vector<UnitId> units(source->index().unit_count());
      std::iota(units.begin(), units.end(), 0);
      const auto receiver = std::make_shared<CountingReceiver>(units.size());
      source->Read(units, receiver);
      uint64_t failures = 0;
      {
        const FailingAllocation failing(n, mode);
        ranges->Pump();
        failures = failing.failures();
      }
      INFO("allocation " << n);
      REQUIRE(receiver->others == 0);
      REQUIRE(std::ranges::all_of(receiver->answers, [](int count) { return count == 1; }));
      // What failed may be asked for again.
      source->Read(units, receiver);
      ranges->Pump();
      REQUIRE(std::ranges::all_of(receiver->answers, [](int count) { return count == 2; }));
      REQUIRE(std::ranges::all_of(receiver->ok, [](int ok) { return ok == 1; }));
      if (failures == 0) break;
      step = 1 + n / 50;
    }
  }
}

TEST_CASE("a file of which a reader has dropped the last hold is closed by its own thread",
          "[packed]") {
  const TempDir dir;
  const Packed packed = MakePacked(dir, 100, 300);
  struct Receiver final : PayloadReceiver {
    void Receive(UnitId, Result<Bytes>) override {}
  };
  for (uint64_t seed = 0; seed < 30; ++seed) {
    auto file = PackedFile::Open(std::make_shared<LateRanges>(packed.bytes, seed)).value();
    auto source = PackedSource::Open(file, file->objects()[0], false).value();
    std::vector<UnitId> units;
    for (UnitId u = 0; u < source->index().unit_count(); ++u) units.push_back(u);
    const auto receiver = std::make_shared<Receiver>();
    source->Read(units, receiver);
    if (seed % 2 == 0) source->Cancel(*receiver);
    file.reset();
    source.reset();
  }
}

}  // namespace mtdb::test
