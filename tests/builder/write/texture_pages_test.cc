// SPDX-License-Identifier: Apache-2.0
// Images of the input become files of the object: each loaded once, under a name that a folder can
// hold; those that cannot be had are told.
#include "builder/write/texture_pages.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <map>

#include "store/base/hash.h"
#include "store/object_name.h"

namespace mtdb::testing {

using namespace internal;

namespace {

// Keeps files; fails from some call on.
class FileWriter final : public ObjectWriter {
 public:
  explicit FileWriter(int calls = -1) : left_(calls) {}
  Result<UnitId> Add(const UnitEntry&, std::span<const UnitId>, ByteSpan) override {
    return IoError("no units");
  }
  Status AddTextureFile(uint32_t page, ByteSpan part) override {
    if (left_-- == 0) return {StatusCode::kNoSpace, "the disk is full"};
    CHECK(part.size() <= (1 << 20));
    CHECK((files.empty() || files.rbegin()->first <= page));
    files[page].insert(files[page].end(), part.begin(), part.end());
    return Status::Ok();
  }
  Result<ObjectRecord> Publish(const ObjectRecord&, const BeforePublish&) override {
    return IoError("no object");
  }
  std::map<uint32_t, Bytes> files;

 private:
  int left_;
};

Texture Image(const std::string& name, size_t bytes, int* loads = nullptr) {
  Texture texture{name, "image/jpeg", 64, 32, {}};
  texture.load = [=]() -> Result<Bytes> {
    if (loads != nullptr) ++*loads;
    return Bytes(bytes, static_cast<std::byte>(bytes + 1));
  };
  return texture;
}

Texture Failing(const Status& status) {
  Texture texture{"gone.png", "image/png", 0, 0, {}};
  texture.load = [=]() -> Result<Bytes> { return status; };
  return texture;
}

Status Add(const std::vector<Texture>& textures, ObjectWriter& writer, TextureRecord* record,
           std::vector<std::string>* notes) {
  const SpoolSpace space{std::filesystem::temp_directory_path().string()};
  TileMaker tiles(&space, 1, [] { return Status::Ok(); });
  return AddTexturePages(textures, writer, tiles, record, notes);
}

std::vector<std::string> NamesOf(const std::vector<std::string>& given) {
  std::vector<Texture> textures;
  for (const std::string& name : given) textures.push_back(Image(name, 1));
  FileWriter writer;
  TextureRecord record;
  std::vector<std::string> notes, names;
  REQUIRE(Add(textures, writer, &record, &notes).ok());
  for (const TextureRecord::Page& page : record.pages) {
    CHECK(CheckPageName(page.name).ok());
    names.push_back(page.name);
  }
  return names;
}

}  // namespace

TEST_CASE("images are loaded once and added in parts, and the record says what they are") {
  int loads = 0;
  const std::vector<Texture> textures{Image("a.jpg", 3 << 20, &loads), Image("b.jpg", 0, &loads),
                                      Texture{"c.jpg", "", 7, 9, {}}, Image("d.jpg", 1, &loads)};
  FileWriter writer;
  TextureRecord record;
  record.step = 0.5;
  std::vector<std::string> notes;
  REQUIRE(Add(textures, writer, &record, &notes).message() == "");
  CHECK(loads == 3);
  // They are no images, so no tiles are made of them.
  CHECK(notes == std::vector<std::string>{
                     "a.jpg: kept, but not drawn: the image is neither a PNG nor a JPEG file",
                     "d.jpg: kept, but not drawn: the image is neither a PNG nor a JPEG file"});
  CHECK(record.tiles == TextureRecord::File{});
  CHECK(record.step == 0.5);
  REQUIRE(record.pages.size() == 4);
  CHECK(writer.files.size() == 2);
  for (uint32_t page = 0; page < 4; ++page) {
    const Bytes& file = writer.files[page];
    CHECK(record.pages[page].bytes == file.size());
    CHECK(record.pages[page].checksum == (file.empty() ? 0 : Hash64(file)));
    CHECK(record.pages[page].name == textures[page].name);
    CHECK(record.pages[page].media_type == textures[page].media_type);
    CHECK(record.pages[page].width == textures[page].width);
    CHECK(record.pages[page].height == textures[page].height);
  }
  CHECK(writer.files[0] == textures[0].load().value());
}

TEST_CASE("an image that cannot be had is a page without bytes, and a note") {
  FileWriter writer;
  TextureRecord record;
  std::vector<std::string> notes;
  const std::vector<Texture> textures{Failing(NotFound("gone.png: no such file")),
                                      Image("b.jpg", 5)};
  REQUIRE(Add(textures, writer, &record, &notes).message() == "");
  CHECK(notes.at(0) == "gone.png: no such file");
  CHECK(record.pages[0].bytes == 0);
  CHECK(record.pages[0].checksum == 0);
  CHECK(record.pages[1].bytes == 5);
  for (const StatusCode code : {StatusCode::kCancelled, StatusCode::kNoSpace}) {
    CHECK(Add({Failing({code, "ended"})}, writer, &record, &notes).code() == code);
  }
  FileWriter full(2);
  CHECK(Add({Image("a.jpg", 3 << 20)}, full, &record, &notes).message() == "the disk is full");
  CHECK(Add(std::vector<Texture>(kMostPages + 1), writer, &record, &notes).code() ==
        StatusCode::kBadInput);
}

TEST_CASE("images get names that a folder can hold, none twice") {
  CHECK(NamesOf({"a.jpg", "a.jpg", "a-2.jpg", "a.jpg"}) ==
        std::vector<std::string>{"a.jpg", "a-2.jpg", "a-2-2.jpg", "a-3.jpg"});
  CHECK(NamesOf({"/etc/passwd", "..\\b.png", "..", "", "x/", "\xff.jpg", "a\nb"}) ==
        std::vector<std::string>{"passwd", "b.png", "texture3.jpg", "texture4.jpg", "texture5.jpg",
                                 "texture6.jpg", "texture7.jpg"});
  CHECK(NamesOf({"noext", "noext", ".hidden", ".hidden"}) ==
        std::vector<std::string>{"noext", "noext-2", ".hidden", ".hidden-2"});
  std::string wide;
  for (int i = 0; i < 125; ++i) wide += "\xc3\xa9";
  // Checks them.
  NamesOf({wide + ".jpg", wide + ".jpg", wide + ".jpg", std::string(255, 'a'),
           std::string(255, 'a'), "a." + std::string(253, 'b'), "a." + std::string(253, 'b')});
}

}  // namespace mtdb::testing
