// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <bit>
#include <cmath>
#include <vector>

#include "codecs/mesh_file/writers/mesh_writer.h"
#include "codecs/mesh_file/writers/text_format.h"

namespace mtdb::internal {
namespace {

// Texture coordinates that were written lately, so that corners that share them name one line: a
// table in which each has one place, and takes it from whoever had it.
class RecentCorners {
 public:
  // The number of the line of these coordinates, from 1; *is_new when it is to be written.
  uint64_t NumberOf(float u, float v, bool* is_new) {
    const uint64_t bits = uint64_t{std::bit_cast<uint32_t>(u)} << 32 | std::bit_cast<uint32_t>(v);
    Entry& entry = entries_[(bits * 0x9e3779b97f4a7c15u) >> (64 - kBits)];
    *is_new = entry.number == 0 || entry.bits != bits;
    if (*is_new) entry = {bits, ++written_};
    return entry.number;
  }

 private:
  static constexpr int kBits = 16;
  struct Entry {
    uint64_t bits = 0;
    uint64_t number = 0;  // 0: none
  };
  std::vector<Entry> entries_ = std::vector<Entry>(size_t{1} << kBits);
  uint64_t written_ = 0;
};

constexpr const char* kNoMaterial = "material_none";
std::string MaterialName(uint32_t page) {
  return page == TextureCorner::kNoPage ? kNoMaterial : "material_" + std::to_string(page);
}

// "v X Y Z" (with "R G B" from 0 to 1 where the mesh has colours), and "vn X Y Z" where it has
// normals, then "f A B C", or "f A//A B//B C//C". Other attributes have no place in OBJ. A textured
// mesh has "vt U V" lines between its faces, "f A/T B/T C/T" and a material for each page, which an
// MTL file beside it gives its image.
class ObjWriter final : public MeshWriter {
 public:
  using MeshWriter::MeshWriter;
  double LargestRounding(const MeshHeader&) const override { return 0; }

 private:
  Status WriteHeader() override {
    colours_ = ColourReader(FindColours(header().attributes));
    normals_ = FindNormals(header().attributes);
    Carry(colours_.indices(3));
    if (normals_.found) Carry(normals_.indices);
    if (!is_textured() || !has_materials()) return Status::Ok();
    return file().Append("mtllib " + std::string(LastPart(MaterialPath(path()))) + "\n");
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    const size_t row_bytes = header().attributes.row_bytes();
    text_.clear();
    for (size_t i = 0; i < positions.size(); ++i) {
      text_ += "v ";
      if (!AppendPosition(&text_, positions[i])) return TooLarge();
      for (int c = 0; c < 3 && colours_.count() > 0; ++c) {
        text_ += ' ';
        AppendNumber(&text_, static_cast<float>(colours_.Part(rows.data() + i * row_bytes, c)));
      }
      text_ += '\n';
      if (normals_.found) AppendNormal(rows.data() + i * row_bytes);
    }
    return file().Append(text_);
  }

  void AppendNormal(const std::byte* row) {
    text_ += "vn";
    const Vec3d normal = NormalIn(row, normals_);
    for (int i = 0; i < 3; ++i) {
      const auto value = static_cast<float>(normal[i]);
      text_ += ' ';
      AppendNumber(&text_, std::isfinite(value) ? value : 0.0f);
    }
    text_ += '\n';
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    text_.clear();
    for (const TriangleVertices& t : triangles) {
      text_ += 'f';
      for (const VertexIndex v : t) {
        text_ += ' ';
        AppendNumber(&text_, v + 1);
        if (!normals_.found) continue;
        text_ += "//";
        AppendNumber(&text_, v + 1);
      }
      text_ += '\n';
    }
    return file().Append(text_);
  }

  bool has_textures() const override { return true; }
  bool has_materials() const { return has_folder() && images().has_some(); }

  Status WriteTexturedTriangles(std::span<const TriangleVertices> triangles,
                                std::span<const TextureCorner> corners) override {
    text_.clear();
    for (size_t i = 0; i < triangles.size(); ++i) {
      const std::span<const TextureCorner> own = corners.subspan(3 * i, 3);
      std::array<uint64_t, 3> numbers{};
      const bool has_none = own[0] == kNone && own[1] == kNone && own[2] == kNone;
      for (size_t c = 0; c < 3 && !has_none; ++c) numbers[c] = AppendCoordinates(own[c]);
      AppendMaterial(own[0].page);
      text_ += 'f';
      for (size_t c = 0; c < 3; ++c) AppendCorner(triangles[i][c] + 1, numbers[c]);
      text_ += '\n';
    }
    return file().Append(text_);
  }

  uint64_t AppendCoordinates(const TextureCorner& corner) {
    bool is_new = false;
    const uint64_t number = recent_.NumberOf(corner.u, corner.v, &is_new);
    if (!is_new) return number;
    text_ += "vt ";
    AppendNumber(&text_, corner.u);
    text_ += ' ';
    AppendNumber(&text_, corner.v);
    text_ += '\n';
    return number;
  }

  void AppendMaterial(uint32_t page) {
    if (has_page_ && page == page_) return;
    has_page_ = true;
    page_ = page;
    none_used_ |= page == TextureCorner::kNoPage;
    text_ += "usemtl " + MaterialName(page) + "\n";
  }

  void AppendCorner(VertexIndex vertex, uint64_t texture) {
    text_ += ' ';
    AppendNumber(&text_, vertex);
    if (texture != 0 || normals_.found) text_ += '/';
    if (texture != 0) AppendNumber(&text_, texture);
    if (!normals_.found) return;
    text_ += '/';
    AppendNumber(&text_, vertex);
  }

  Status WriteEnd() override {
    if (!is_textured() || !has_materials()) return Status::Ok();
    std::string text;
    for (uint32_t page = 0; page < header().textures.size(); ++page) {
      if (!images().is_used(page)) continue;
      text += "newmtl " + MaterialName(page) + "\nKd 1 1 1\n";
      if (images().has_file(page)) text += "map_Kd " + images().name(page) + "\n";
    }
    if (none_used_) text += std::string("newmtl ") + kNoMaterial + "\nKd 1 1 1\n";
    return images().WriteText(MaterialPath(path()), text);
  }

  const char* position_type() const override { return "decimal"; }
  void AddToReport(MeshWriteReport* report) const override {
    colours_.AddToReport(nullptr, report);
  }

  ColourReader colours_;
  NormalAttributes normals_;
  std::string text_;
  RecentCorners recent_;
  static constexpr TextureCorner kNone{0, 0, TextureCorner::kNoPage};
  uint32_t page_ = 0;      // of the last triangle
  bool has_page_ = false;  // there was one
  bool none_used_ = false;
};

}  // namespace

std::unique_ptr<MeshWriter> CreateObjWriter(const std::string& path) {
  return std::make_unique<ObjWriter>(path);
}

}  // namespace mtdb::internal
