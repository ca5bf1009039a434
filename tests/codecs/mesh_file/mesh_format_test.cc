// SPDX-License-Identifier: Apache-2.0
// The table of mesh formats, and the documents that list them.
#include <set>

#include "codecs/mesh_file/readers/mesh_format_table.h"
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {

using namespace internal;

namespace {

std::string Document(const std::string& path) {
  const std::string text = testing::ReadBytes(std::string(MTDB_SOURCE_DIR) + "/" + path);
  REQUIRE(!text.empty());
  return text;
}

bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// "PLY, OBJ".
std::string NamesOf(const std::vector<MeshFormat>& formats) {
  std::string names;
  for (const MeshFormat& f : formats) {
    names += (names.empty() ? "" : ", ") + std::string(f.name);
  }
  return names;
}

TEST_CASE("Every row of the table of mesh formats is whole, and no two have a suffix in common") {
  std::set<std::string_view> names, suffixes;
  for (const MeshFormatRow& row : MeshFormatTable()) {
    INFO(row.format.name);
    CHECK(names.insert(row.format.name).second);
    CHECK((row.recognise == nullptr) == (row.read == nullptr));
    CHECK((row.read != nullptr || row.create_writer != nullptr));
    REQUIRE(!row.format.suffixes.empty());
    for (const std::string_view suffix : row.format.suffixes) {
      CHECK(suffixes.insert(suffix).second);
      CHECK(suffix.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789") ==
            std::string_view::npos);
    }
    CHECK(Contains(std::string(row.format.content_type), "/"));
  }
}

TEST_CASE("Formats are found by suffix, in whatever letters") {
  REQUIRE(WrittenMeshFormatOf("a/b.c/D.Ply").ok());
  CHECK(WrittenMeshFormatOf("a/b.c/D.Ply")->name == "PLY");
  CHECK(WrittenMeshFormatOf("x.glb")->content_type == "model/gltf-binary");
  for (const char* wrong : {"", "ply", ".ply", "a.", "a.png", "a.ply/b", "a.ply "}) {
    INFO(wrong);
    CHECK(WrittenMeshFormatOf(wrong).status().code() == StatusCode::kUnsupported);
  }
  CHECK(FindWrittenMeshFormat("drc")->keeps_mesh);
  for (const char* wrong : {"", "PLY", ".ply", "gltf", "ply,obj"}) {
    CHECK(FindWrittenMeshFormat(wrong).status().code() == StatusCode::kUnsupported);
  }
}

TEST_CASE("The documents list the formats that there are") {
  const std::string readme = Document("README.md");
  CHECK(Contains(readme, "Input: " + NamesOf(ReadMeshFormats()) + ";"));
  CHECK(Contains(readme, "Output: " + NamesOf(WrittenMeshFormats()) + "."));

  // "`format` is `ply` (the default), `obj` or `stl`."
  std::string list;
  const std::vector<MeshFormat> written = WrittenMeshFormats();
  for (size_t i = 0; i < written.size(); ++i) {
    if (i > 0) list += i + 1 < written.size() ? ", " : " or ";
    list += "`" + std::string(written[i].suffixes[0]) + "`";
    if (i == 0) list += " (the default)";
  }
  CHECK(Contains(Document("docs/protocol.md"), "`format` is " + list + "."));

  // A row for each: what is read, what is written.
  const std::string table = Document("codecs/mesh_file/README.md");
  for (const MeshFormatRow& row : MeshFormatTable()) {
    const std::string begin = "\n| " + std::string(row.format.name) + " | ";
    INFO(begin);
    const size_t at = table.find(begin);
    REQUIRE(at != std::string::npos);
    const std::string line =
        table.substr(at + begin.size(), table.find('\n', at + 1) - at - begin.size());
    const size_t bar = line.find(" | ");
    REQUIRE(bar != std::string::npos);
    CHECK((line.substr(0, bar) != "no") == (row.read != nullptr));
    CHECK(!line.substr(bar + 3).starts_with("no ") == (row.create_writer != nullptr));
  }
}

}  // namespace
}  // namespace mtdb
