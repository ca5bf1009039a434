// SPDX-License-Identifier: Apache-2.0
// The image files of textured objects: they come out as they went in, of stores and packed files,
// whole and in parts; what disagrees with the record is refused, and what is removed is free.
#include "store/texture_pages.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <csignal>
#include <random>
#include <sys/wait.h>
#include <unistd.h>

#include "store/base/hash.h"
#include "store/base/running_hash.h"
#include "store/copy.h"
#include "store/lmdb/environment.h"
#include "store/lmdb/test_hooks.h"
#include "store/packed_file.h"
#include "store/records/page_parts.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

constexpr size_t kPart = kPagePartBytes;
const std::vector<size_t> kSizes = {0, 1, 3 << 20, kPart - 1, kPart, kPart + 1, 2 * kPart + 1, 0};

SyntheticObject Textured() {
  return MakeObject({.seed = 5,
                     .clusters = 8,
                     .max_payload = 300,
                     .page_bytes = kSizes,
                     .tile_bytes = kPart + 1000});
}

std::shared_ptr<ClusterSource> Open(const std::string& path) {
  auto source = OpenReadOnly(path)->OpenObject("one");
  REQUIRE(source.status().message() == "");
  return *source;
}

// Packs the object of the store into a file.
void Pack(const std::string& store, const std::string& packed) {
  const std::vector<std::shared_ptr<ClusterSource>> sources{Open(store)};
  Bytes file;
  const auto report = PackObjects(sources, [&](ByteSpan bytes) {
    file.insert(file.end(), bytes.begin(), bytes.end());
    return Status::Ok();
  });
  REQUIRE(report.status().message() == "");
  REQUIRE(report->file_bytes == file.size());
  REQUIRE(report->first_bytes < 100000);  // the files come later
  WriteFile(packed, file);
}

// What Publish says of the object, of which `add` adds files.
Status Publish(const SyntheticObject& object, const std::function<Status(ObjectWriter&)>& add) {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("s.mtdb"));
  Status status = Status::Ok();
  {
    const auto writer = database->Create("one", false).value();
    for (const auto& u : object.units) {
      REQUIRE(writer->Add(u.entry, u.children, u.payload).ok());
    }
    status = add(*writer);
    if (status.ok()) status = writer->Publish(object.record).status();
  }
  CHECK(database->List()->size() == (status.ok() ? 1 : 0));
  CHECK(VerifyFailures(dir.File("s.mtdb")) == "");
  return status;
}

TEST_CASE("a running hash is the hash of all bytes, however they are cut", "[store]") {
  std::mt19937_64 random(1);
  for (const size_t size : {0, 1, 16, 240, 241, 1000, 100000}) {
    Bytes bytes(size);
    for (std::byte& b : bytes) b = static_cast<std::byte>(random());
    for (const uint64_t seed : {uint64_t{0}, uint64_t{77}}) {
      RunningHash hash(seed);
      for (ByteSpan left = bytes; !left.empty();) {
        const ByteSpan part = left.first(std::min<size_t>(left.size(), random() % 700));
        hash.Add(part);
        left = left.subspan(part.size());
      }
      CHECK(hash.value() == Hash64(bytes, seed));
    }
  }
}

TEST_CASE("files of pages are copied, compacted, packed and unpacked as they were", "[store]") {
  const TempDir dir;
  const SyntheticObject object = Textured();
  const std::string store = dir.File("s.mtdb"), copy = dir.File("c.mtdb"),
                    packed = dir.File("p.mtdbp"), unpacked = dir.File("u.mtdb");
  const auto record = WriteObject(*OpenWritable(store), "one", object);
  REQUIRE(record.status().message() == "");
  CHECK(record->texture == object.record.texture);
  CHECK(TextureBytes(*record) > (3 << 20));
  CHECK(record->stored_bytes > TextureBytes(*record));
  CHECK(record->payload_bytes < 100000);
  REQUIRE(CopyToNewStore(*OpenReadOnly(store)->OpenAll(), copy).message() == "");
  Pack(store, packed);
  REQUIRE(CopyToStore(*OpenReadOnly(packed)->OpenAll(), unpacked, false).message() == "");
  REQUIRE(CompactStore(unpacked).status().message() == "");
  for (const std::string& path : {store, copy, packed, unpacked}) {
    INFO(path);
    CHECK(VerifyFailures(path) == "");
    CHECK(Open(path)->record().digest_hex() == record->digest_hex());
    CHECK(CompareObject(*Open(path), object).message() == "");
  }
  // The same file, wherever it is made from.
  Pack(unpacked, dir.File("again.mtdbp"));
  CHECK(ReadFile(packed) == ReadFile(dir.File("again.mtdbp")));
  Pack(packed, dir.File("again.mtdbp"));
  CHECK(ReadFile(packed) == ReadFile(dir.File("again.mtdbp")));
}

TEST_CASE("any part of a file is read, and nothing beyond it", "[store]") {
  const TempDir dir;
  const SyntheticObject object = Textured();
  const std::string store = dir.File("s.mtdb"), packed = dir.File("p.mtdbp");
  REQUIRE(WriteObject(*OpenWritable(store), "one", object).ok());
  Pack(store, packed);
  std::mt19937_64 random(3);
  for (const std::string& path : {store, packed}) {
    const auto source = Open(path);
    for (int i = 0; i < 200; ++i) {
      const auto page = static_cast<uint32_t>(random() % object.files.size());
      const Bytes& file = object.files[page];
      const uint64_t offset = random() % (file.size() + 1);
      const uint64_t bytes = random() % (file.size() - offset + 1);
      const auto part = source->ReadTextureFile(page, offset, bytes);
      REQUIRE(part.status().message() == "");
      REQUIRE(std::ranges::equal(*part, ByteSpan(file).subspan(offset, bytes)));
    }
    const auto refused = [&](uint32_t page, uint64_t offset, uint64_t bytes) {
      const Status status = source->ReadTextureFile(page, offset, bytes).status();
      INFO(status.message());
      CHECK(status.message().find("page " + std::to_string(page)) != std::string::npos);
      CHECK(status.message().find("one") != std::string::npos);
      return status.code() == StatusCode::kInvalidArgument;
    };
    CHECK(refused(9, 0, 0));
    CHECK(refused(~0u, 0, 1));
    CHECK(refused(0, 0, 1));
    CHECK(refused(0, 1, 0));
    CHECK(refused(1, 0, 2));
    CHECK(refused(2, 1, 3 << 20));
    CHECK(refused(2, ~uint64_t{0}, 2));
    CHECK(refused(2, 2, ~uint64_t{0}));
    // What `take` says ends the reading.
    int parts = 0;
    const Status ended = ReadTextureFile(*source, 2, [&](ByteSpan) {
      ++parts;
      return IoError("full");
    });
    CHECK(ended.message() == "full");
    CHECK(parts == 1);
    CHECK(ReadTextureFile(*source, 0, [&](ByteSpan) { return IoError("called"); }).ok());
  }
}

TEST_CASE("a packed file tells where the files of textures lie", "[store]") {
  const TempDir dir;
  const SyntheticObject object = Textured();
  REQUIRE(WriteObject(*OpenWritable(dir.File("s.mtdb")), "one", object).ok());
  Pack(dir.File("s.mtdb"), dir.File("p.mtdbp"));
  const Bytes packed = ReadFile(dir.File("p.mtdbp"));
  const auto objects = PackedObjects::Open(OpenFileRanges(dir.File("p.mtdbp")).value()).value();
  const std::vector<ByteRange> files = objects->TextureFiles("one").value();
  REQUIRE(files.size() == object.files.size());
  for (size_t i = 0; i < files.size(); ++i) {
    REQUIRE(files[i].offset + files[i].bytes <= packed.size());
    CHECK(std::ranges::equal(ByteSpan(packed).subspan(files[i].offset, files[i].bytes),
                             object.files[i]));
  }
  CHECK(objects->TextureFiles("two").status().code() == StatusCode::kNotFound);
}

TEST_CASE("the textures of an object load their files", "[store]") {
  const TempDir dir;
  const SyntheticObject object = Textured();
  REQUIRE(WriteObject(*OpenWritable(dir.File("s.mtdb")), "one", object).ok());
  std::vector<Texture> textures;
  {
    const auto source = Open(dir.File("s.mtdb"));
    textures = TexturesOf(source->record(), source);
  }
  REQUIRE(textures.size() + 1 == object.files.size());
  for (size_t i = 0; i < textures.size(); ++i) {
    CHECK(textures[i].name == object.record.texture->pages[i].name);
    CHECK(textures[i].media_type == "image/jpeg");
    CHECK(textures[i].width == 640);
    CHECK(textures[i].height == 480);
    REQUIRE((textures[i].load == nullptr) == object.files[i].empty());
    if (textures[i].load) CHECK(textures[i].load().value() == object.files[i]);
  }
  const auto plain = MakeObject({.seed = 1}).record;
  CHECK(TexturesOf(plain, nullptr).empty());
  CHECK(TextureBytes(plain) == 0);
}

TEST_CASE("an object whose record says something else of its files is not published", "[store]") {
  const SyntheticObject object =
      MakeObject({.seed = 2, .clusters = 4, .page_bytes = {500, 0, 600}});
  const auto add = [&](ObjectWriter& writer, uint32_t page) {
    return writer.AddTextureFile(page, object.files[page]);
  };
  const auto add_all = [&](ObjectWriter& writer) {
    MTDB_RETURN_IF_ERROR(add(writer, 0));
    return add(writer, 2);
  };
  CHECK(Publish(object, add_all).message() == "");
  const auto refused = [](const Status& status, const char* what) {
    INFO(status.message());
    CHECK(status.message().find("object one: ") == 0);
    CHECK(status.message().find(what) != std::string::npos);
    return status.code() == StatusCode::kInvalidArgument;
  };
  CHECK(refused(Publish(object, [&](ObjectWriter& w) { return add(w, 0); }), "page 2 "));
  CHECK(refused(Publish(object, [&](ObjectWriter& w) { return add(w, 2); }), "page 0 "));
  CHECK(refused(Publish(object,
                        [&](ObjectWriter& w) {
                          MTDB_RETURN_IF_ERROR(add_all(w));
                          return add(w, 2);
                        }),
                "page 2 "));
  // Tiles that the record does not have.
  CHECK(refused(Publish(object,
                        [&](ObjectWriter& w) {
                          MTDB_RETURN_IF_ERROR(add_all(w));
                          return w.AddTextureFile(3, object.files[0]);
                        }),
                "tiles"));
  // Pages in another order, pages that the record does not have.
  CHECK(refused(Publish(object,
                        [&](ObjectWriter& w) {
                          MTDB_RETURN_IF_ERROR(add(w, 2));
                          return add(w, 0);
                        }),
                "ascending"));
  for (const uint32_t page : {4u, kMostPages - 1, kMostPages, ~0u}) {
    CHECK(refused(Publish(object,
                          [&](ObjectWriter& w) {
                            MTDB_RETURN_IF_ERROR(add_all(w));
                            return w.AddTextureFile(page, object.files[0]);
                          }),
                  "file "));
  }
  SyntheticObject other = object;
  other.record.texture->pages[2].checksum ^= 1;
  CHECK(refused(Publish(other, add_all), "page 2 "));
  other = object;
  other.record.texture->pages[0].bytes -= 1;
  CHECK(refused(Publish(other, add_all), "page 0 "));
  other = object;
  other.record.texture->pages[1].bytes = 7;
  CHECK(refused(Publish(other, add_all), "page 1 "));
  other = object;
  other.record.texture->pages[1].name = other.record.texture->pages[0].name;
  CHECK(refused(Publish(other, add_all), "page 1 "));
  other = object;
  other.record.texture->tiles = {9, 1};
  CHECK(refused(Publish(other, add_all), "tiles"));
  other = object;
  other.record.texture.reset();
  CHECK(refused(Publish(other, add_all), "file 0 "));
  other.files.clear();
  CHECK(Publish(other, [](ObjectWriter&) { return Status::Ok(); }).message() == "");
}

TEST_CASE("the digest of an object tells its files", "[store]") {
  const TempDir dir;
  const auto database = OpenWritable(dir.File("s.mtdb"));
  SyntheticObject object = MakeObject({.seed = 2, .clusters = 4, .page_bytes = {500}});
  const auto first = WriteObject(*database, "a", object);
  object.files[0][77] ^= std::byte{1};
  object.record.texture->pages[0].checksum = Hash64(object.files[0]);
  const auto second = WriteObject(*database, "b", object);
  REQUIRE((first.ok() && second.ok()));
  CHECK(first->digest_hex() != second->digest_hex());
  CHECK_FALSE(IsSameObject(*first, *second));
}

TEST_CASE("files of removed objects are free, and who still reads them is told", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("s.mtdb");
  const SyntheticObject object = Textured();
  const auto database = OpenWritable(path);
  REQUIRE(WriteObject(*database, "one", object).ok());
  const auto source = database->OpenObject("one").value();
  // Others write meanwhile.
  for (const char* name : {"a", "b", "c", "d"}) {
    REQUIRE(WriteObject(*database, name, MakeObject({.seed = 9, .clusters = 4})).ok());
  }
  CHECK(CompareFiles(*source, object).message() == "");
  REQUIRE(database->Remove("one").message() == "");
  CHECK(VerifyFailures(path) == "");
  CHECK(database->FreeBytes().value() > TextureBytes(object.record));
  const uint64_t file_bytes = database->FileBytes().value();
  REQUIRE(WriteObject(*database, "two", object).ok());
  CHECK(database->FileBytes().value() < file_bytes + (1 << 20));
  const Status gone = CompareFiles(*source, object);
  CHECK(gone.code() == StatusCode::kNotFound);
  CHECK(gone.message().find("object one was removed") != std::string::npos);
  // Replaced by one without texture.
  REQUIRE(WriteObject(*database, "two", MakeObject({.seed = 9, .clusters = 4}), true).ok());
  CHECK(VerifyFailures(path) == "");
  REQUIRE(CompactStore(dir.File("s.mtdb")).status().code() == StatusCode::kBusy);
}

TEST_CASE("a builder that gives up leaves nothing of its files", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("s.mtdb");
  const auto database = OpenWritable(path);
  const Bytes part(1 << 20, std::byte{7});
  {
    const auto writer = database->Create("one", false).value();
    for (int i = 0; i < 40; ++i) REQUIRE(writer->AddTextureFile(0, part).ok());
    CHECK(database->FileBytes().value() > (20 << 20));  // some of it is on disk
  }
  CheckReport report;
  REQUIRE(VerifyStore(path, "", &report).ok());
  CHECK(report.failures == std::vector<std::string>());
  CHECK(report.checks[1] == "catalog: 0 objects, 0 being built, 0 being removed");
  CHECK(database->FreeBytes().value() + (1 << 20) > database->FileBytes().value());
}

TEST_CASE("files that a killed builder left are gone with the next object", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("s.mtdb");
  const SyntheticObject small = MakeObject({.seed = 2, .clusters = 4, .page_bytes = {500}});
  const int status = RunChild([&] {
    TestPointHook() = [](const char* reached) {
      if (std::string("values committed") == reached) ::kill(::getpid(), SIGKILL);
    };
    const auto database = Database::Open(path, {.writable = true});
    const auto writer = (*database)->Create("one", false);
    const Bytes part(1 << 20, std::byte{7});
    for (int i = 0; i < 40; ++i) {
      if (!(*writer)->AddTextureFile(0, part).ok()) return 1;
    }
    return 2;
  });
  REQUIRE(WIFSIGNALED(status));
  CHECK(VerifyFailures(path) == "");
  CHECK(OpenReadOnly(path)->List()->empty());
  const auto database = OpenWritable(path);
  REQUIRE(WriteObject(*database, "two", small).status().message() == "");
  CHECK(VerifyFailures(path) == "");
  CHECK(database->FileBytes().value() > (20 << 20));
  CHECK(database->FreeBytes().value() + (1 << 20) > database->FileBytes().value());
}

TEST_CASE("parts that are missing, cut off or of another file are found", "[store]") {
  const SyntheticObject object = Textured();
  const auto damage = [&](const std::function<Status(WriteTransaction&, ObjectId)>& change) {
    const TempDir dir;
    const std::string path = dir.File("s.mtdb");
    const ObjectId id = WriteObject(*OpenWritable(path), "one", object)->id;
    {
      const auto environment = Environment::Open(path, {.writable = true}).value();
      REQUIRE(environment->Write([&](WriteTransaction& w) { return change(w, id); }).ok());
    }
    const std::string failures = VerifyFailures(path);
    INFO(failures);
    CHECK(failures.find("object 1 (one)") != std::string::npos);
    const Status read = CompareFiles(*Open(path), object);
    INFO(read.message());
    CHECK(read.code() == StatusCode::kCorrupt);
    CHECK(read.message().find("page 2 (page3.jpg)") != std::string::npos);
    CHECK(CopyToNewStore(*OpenReadOnly(path)->OpenAll(), dir.File("c.mtdb")).code() ==
          StatusCode::kCorrupt);
  };
  const auto body = [&](size_t begin, size_t bytes) {
    return ByteSpan(object.files[2]).subspan(begin, bytes);
  };
  const auto put = [](WriteTransaction& w, ObjectId id, uint32_t part, ByteSpan bytes) {
    return w.PutSealed(Table::kTextures, TextureKey(id, 2, part), bytes);
  };
  damage([&](WriteTransaction& w, ObjectId id) {
    return w.Delete(Table::kTextures, TextureKey(id, 2, 3));
  });
  damage([&](WriteTransaction& w, ObjectId id) { return put(w, id, 0, body(0, kPart - 1)); });
  damage([&](WriteTransaction& w, ObjectId id) { return put(w, id, 0, {}); });
  damage([&](WriteTransaction& w, ObjectId id) { return put(w, id, 0, body(0, kPart + 1)); });
  // Whole parts, but of another place in the file: only the checksum of all tells.
  damage([&](WriteTransaction& w, ObjectId id) { return put(w, id, 0, body(kPart, kPart)); });
}

}  // namespace
}  // namespace mtdb::test
