// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/obj_textures.h"

#include <cmath>
#include <limits>
#include <set>

#include "codecs/mesh_file/readers/readers.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMostNames = size_t{1} << 20;
constexpr size_t kMostLibraries = 4096;
constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();

// "u", "u v" or "u v w".
TexturePlace ParsePlace(std::string_view rest) {
  LineTokens tokens(rest);
  std::string_view token;
  TexturePlace place;
  if (!tokens.Next(&token) || !ParseReal(token, &place.u)) return {kNoNumber, kNoNumber};
  if (tokens.Next(&token) && token[0] != '#' && !ParseReal(token, &place.v)) place.v = kNoNumber;
  return place;
}

}  // namespace

std::string_view ObjTextures::Reference(std::string_view token) {
  const size_t slash = token.find('/');
  if (slash == std::string_view::npos) return {};
  token.remove_prefix(slash + 1);
  return token.substr(0, token.find('/'));
}

bool ObjTextures::HasAll(LineTokens corners) {
  std::string_view token;
  while (corners.Next(&token) && token[0] != '#') {
    if (Reference(token).empty()) return false;
  }
  return true;
}

Status ObjTextures::Scan(std::string_view word, std::string_view rest) {
  if (word == "vt") return table_.Append(ParsePlace(rest));
  if (word == "f") {
    if (is_used_ && is_noted_) return Status::Ok();
    std::string_view token;
    if (!LineTokens(rest).Next(&token) || Reference(token).empty()) return Status::Ok();
    is_used_ = true;
    is_noted_ = true;
    if (materials_.size() >= kMostNames) {
      return Unsupported(path_ + ": more than " + std::to_string(kMostNames) +
                         " materials; join some, or split the mesh");
    }
    if (materials_.try_emplace(current_, TextureCorner::kNoPage).second) {
      used_.push_back(current_);
    }
  } else if (word == "usemtl") {
    current_ = TrimmedName(rest);
    is_noted_ = false;
  } else if (word == "mtllib" && libraries_.size() < kMostLibraries) {
    libraries_.emplace_back(rest);
  }
  return Status::Ok();
}

Status ObjTextures::Finish() {
  if (table_.size() == 0) is_used_ = false;
  if (!is_used_) return Status::Ok();
  MaterialFiles files;
  std::set<std::string> read;
  for (const std::string& names : libraries_) {
    if (read.insert(std::string(TrimmedName(names))).second) {
      files.ReadNamed(FolderOf(path_), names, report_);
    }
  }
  uint64_t without = 0;
  for (const std::string& name : used_) {
    const MaterialFiles::Material* material = files.Find(name);
    // Without "usemtl", the only material there is.
    if (name.empty() && used_.size() == 1 && files.all().size() == 1) {
      material = &files.all().begin()->second;
    }
    if (material == nullptr || material->image.empty()) {
      ++without;
      continue;
    }
    MTDB_ASSIGN_OR_RETURN(materials_[name], pages_.AddFile(material->folder, material->image));
  }
  if (pages_.size() == 0) {
    pages_.AddUnknown();
    for (auto& [name, page] : materials_) page = 0;
  } else if (without > 0) {
    AddIgnored(report_, std::to_string(without) + (without == 1 ? " material" : " materials") +
                            " without an image");
  }
  const auto first = materials_.find("");
  page_ = first == materials_.end() ? TextureCorner::kNoPage : first->second;
  return Status::Ok();
}

void ObjTextures::PutInto(MeshHeader* header) const {
  header->textured = true;
  header->textures = pages_.pages();
}

bool ObjTextures::Follow(std::string_view word, std::string_view rest) {
  if (word == "vt") {
    ++seen_;
  } else if (word == "usemtl") {
    const auto at = materials_.find(TrimmedName(rest));
    page_ = at == materials_.end() ? TextureCorner::kNoPage : at->second;
  } else {
    return word == "mtllib";
  }
  return true;
}

Status ObjTextures::Corner(std::string_view token, TextureCorner* corner) {
  *corner = {kNoNumber, kNoNumber, page_};
  int64_t index = 0;
  if (!ParseInteger(Reference(token), &index)) return Status::Ok();
  const int64_t absolute = index > 0 ? index - 1 : index + static_cast<int64_t>(seen_);
  if (index == 0 || absolute < 0 || absolute >= static_cast<int64_t>(table_.size())) {
    return Status::Ok();
  }
  TexturePlace place;
  MTDB_RETURN_IF_ERROR(table_.Get(static_cast<uint64_t>(absolute), &place));
  corner->u = place.u;
  corner->v = place.v;
  return Status::Ok();
}

}  // namespace mtdb::internal
