// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/ply_textures.h"

#include <algorithm>
#include <limits>

#include "codecs/mesh_file/textures/file_names.h"

namespace mtdb::internal {
namespace {

struct NamePair {
  const char* u;
  const char* v;
  bool of_any_float;  // also of float64, which no other property of this name has
};
constexpr std::array kPairs{NamePair{"texture_u", "texture_v", true}, NamePair{"s", "t", false},
                            NamePair{"u", "v", false}};
constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();

const PlyProperty* FindProperty(const PlyElement& element, const std::string& name) {
  const auto at = std::ranges::find(element.properties, name, &PlyProperty::name);
  return at == element.properties.end() ? nullptr : &*at;
}

bool IsCoordinate(const PlyElement& element, const char* name, bool of_any_float) {
  const PlyProperty* const p = FindProperty(element, name);
  if (p == nullptr || p->is_list) return false;
  return p->type == ScalarType::kFloat32 || (of_any_float && p->type == ScalarType::kFloat64);
}

}  // namespace

Status PlyTextures::Plan(const std::string& path, const PlyHeader& header, MeshReadReport* report) {
  const PlyElement* const faces = header.Find("face");
  const PlyProperty* const list = faces == nullptr ? nullptr : FindProperty(*faces, "texcoord");
  of_faces_ = list != nullptr && list->is_list && faces->count > 0;
  const PlyElement* const vertices = header.Find("vertex");
  // A "w" beside u and v makes them a vector's.
  const bool is_vector = FindProperty(*vertices, "w") != nullptr;
  for (const NamePair& pair : kPairs) {
    if (of_faces_ || of_vertices_ || (is_vector && pair.u[0] == 'u')) break;
    of_vertices_ = IsCoordinate(*vertices, pair.u, pair.of_any_float) &&
                   IsCoordinate(*vertices, pair.v, pair.of_any_float);
    if (of_vertices_) names_ = {pair.u, pair.v};
  }
  if (!are_used()) return Status::Ok();
  TexturePages pages(path, report);
  for (const std::string& name : header.texture_files) {
    // A page for each line, whose numbers faces name.
    const size_t before = pages.size();
    MTDB_ASSIGN_OR_RETURN(const uint32_t page, pages.AddFile(FolderOf(path), name));
    if (page == before) continue;
    Texture again = pages.pages()[page];
    MTDB_RETURN_IF_ERROR(pages.Add(std::move(again)).status());
  }
  if (pages.size() == 0) pages.AddUnknown();
  pages_ = pages.pages();
  return Status::Ok();
}

void PlyTextures::PutInto(MeshHeader* header) const {
  header->textured = true;
  header->textures = pages_;
}

int PlyTextures::PartOf(const PlyProperty& p) const {
  if (!of_vertices_ || p.is_list) return -1;
  return p.name == names_[0] ? 0 : p.name == names_[1] ? 1 : -1;
}

void PlyTextures::BeginFace() {
  corners_.clear();
  numbers_.clear();
  page_ = 0;
  is_page_wrong_ = false;
}

void PlyTextures::SetPage(int64_t number) {
  const bool is_page = number >= 0 && static_cast<uint64_t>(number) < pages_.size();
  page_ = is_page ? static_cast<uint32_t>(number) : TextureCorner::kNoPage;
  is_page_wrong_ = !is_page && number != -1;
}

Status PlyTextures::CornerOf(VertexIndex v, TextureCorner* corner) {
  TexturePlace place{kNoNumber, kNoNumber};
  if (v < table_.size()) MTDB_RETURN_IF_ERROR(table_.Get(v, &place));
  *corner = {place.u, place.v, page_};
  return Status::Ok();
}

Status PlyTextures::EndFace(FaceEmitter* faces) {
  const bool has_none = of_faces_ && numbers_.empty();
  const bool fits = numbers_.size() == 2 * corners_.size();
  for (size_t i = 0; i < corners_.size(); ++i) {
    TextureCorner corner = kNoTexture;
    if (of_vertices_) {
      MTDB_RETURN_IF_ERROR(CornerOf(corners_[i], &corner));
    } else if (!has_none) {
      corner = {fits ? numbers_[2 * i] : kNoNumber, fits ? numbers_[2 * i + 1] : 0, page_};
    }
    if (is_page_wrong_) corner.u = kNoNumber;  // to be counted
    MTDB_RETURN_IF_ERROR(faces->AddCorner(corners_[i], corner));
  }
  return faces->EndFace();
}

Status PlyTextures::AddTriangle(const TriangleVertices& t, FaceEmitter* faces) {
  std::array<TextureCorner, 3> corners;
  page_ = 0;
  for (size_t i = 0; i < 3; ++i) MTDB_RETURN_IF_ERROR(CornerOf(t[i], &corners[i]));
  return faces->AddTriangle(t, corners);
}

}  // namespace mtdb::internal
