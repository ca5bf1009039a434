// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/gltf_textures.h"

#include <cmath>
#include <utility>

#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/textures/file_names.h"
#include "codecs/mesh_file/textures/image_info.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kNone = uint64_t{1} << 53;

// The number that a member of `json` is, or kNone.
uint64_t NumberOf(const GltfJson* json, const char* key) {
  uint64_t number = kNone;
  return GltfNumber(json, key, kNone, &number) ? number : kNone;
}

const std::string* TextOf(const GltfJson* json, const char* key) {
  const GltfJson* const text = GltfMember(json, key);
  return text != nullptr && text->is_string() ? &text->get_ref<const std::string&>() : nullptr;
}

// The part's bytes up to out.size() from `offset` on.
size_t ReadPart(const GltfBytes& part, uint64_t offset, std::span<std::byte> out) {
  if (offset >= part.size) return 0;
  out = out.first(static_cast<size_t>(std::min<uint64_t>(out.size(), part.size - offset)));
  if (part.memory != nullptr) {
    std::copy_n(part.memory->data() + part.begin + offset, out.size(), out.data());
    return out.size();
  }
  if (part.file == nullptr) return 0;
  const Result<size_t> n = part.file->ReadAt(part.begin + offset, out);
  return n.ok() ? *n : 0;
}

// Reads the image again when it is asked for.
std::function<Result<Bytes>()> Loader(const GltfBytes& part, const std::string& path) {
  return [part, path]() -> Result<Bytes> {
    if (part.memory != nullptr) {
      const auto begin = part.memory->begin() + static_cast<std::ptrdiff_t>(part.begin);
      return Bytes(begin, begin + static_cast<std::ptrdiff_t>(part.size));
    }
    Bytes bytes(part.size);
    MTDB_ASSIGN_OR_RETURN(const size_t read, part.file->ReadAt(part.begin, bytes));
    if (read < bytes.size()) return BadInput(path + ": glTF: an image is cut short");
    return bytes;
  };
}

}  // namespace

Result<GltfTextureUse> GltfTextures::Add(const GltfJson* primitive) {
  GltfTextureUse use;
  ++primitives_;
  const uint64_t number = NumberOf(primitive, "material");
  const GltfJson* const material = GltfElement(document_.json(), "materials", number);
  const GltfJson* const info =
      GltfMember(GltfMember(material, "pbrMetallicRoughness"), "baseColorTexture");
  uint64_t set = 0;
  if (info != nullptr) {
    set = NumberOf(info, "texCoord");
    if (set == kNone) set = 0;
    MTDB_RETURN_IF_ERROR(Transform(info, &use, &set));
  }
  const std::string name = "TEXCOORD_" + std::to_string(set);
  const uint64_t accessor = NumberOf(GltfMember(primitive, "attributes"), name.c_str());
  const Result<GltfAccessor> shape = document_.AccessorShape(accessor);
  if (!shape.ok() || shape->components != 2) return use;
  use.coordinates = name;
  ++with_coordinates_;
  if (info == nullptr) return use;
  MTDB_ASSIGN_OR_RETURN(use.page, PageOf(NumberOf(info, "index")));
  if (use.page != TextureCorner::kNoPage) {
    materials_.insert(number);
    has_images_ = true;
  }
  return use;
}

Status GltfTextures::Transform(const GltfJson* info, GltfTextureUse* use, uint64_t* set) const {
  const GltfJson* const t = GltfMember(GltfMember(info, "extensions"), "KHR_texture_transform");
  if (t == nullptr) return Status::Ok();
  if (const uint64_t other = NumberOf(t, "texCoord"); other != kNone) *set = other;
  std::array<double, 2> offset{0, 0}, scale{1, 1};
  double angle = 0;
  const auto read = [](const GltfJson* list, std::array<double, 2>* values) {
    if (list == nullptr) return true;
    if (!list->is_array() || list->size() != 2) return false;
    for (size_t i = 0; i < 2; ++i) {
      if (!(*list)[i].is_number()) return false;
      (*values)[i] = (*list)[i].get<double>();
    }
    return true;
  };
  const GltfJson* const rotation = GltfMember(t, "rotation");
  const bool is_good = read(GltfMember(t, "offset"), &offset) &&
                       read(GltfMember(t, "scale"), &scale) &&
                       (rotation == nullptr || rotation->is_number());
  if (!is_good) return document_.Error("KHR_texture_transform has a wrong member");
  if (rotation != nullptr) angle = rotation->get<double>();
  // Scaled, then turned counter-clockwise as it is seen where v goes down, then moved.
  const double c = std::cos(angle), s = std::sin(angle);
  use->place = {c * scale[0], s * scale[1], offset[0], -s * scale[0], c * scale[1], offset[1]};
  return Status::Ok();
}

Result<uint32_t> GltfTextures::PageOf(uint64_t texture) {
  const GltfJson* const json = GltfElement(document_.json(), "textures", texture);
  uint64_t image = NumberOf(json, "source");
  // Images in other formats than those that every reader knows.
  for (const char* extension :
       {"EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu", "MSFT_texture_dds"}) {
    if (image != kNone) break;
    image = NumberOf(GltfMember(GltfMember(json, "extensions"), extension), "source");
  }
  if (GltfElement(document_.json(), "images", image) == nullptr) return TextureCorner::kNoPage;
  const auto known = images_.find(image);
  if (known != images_.end()) return known->second;
  MTDB_ASSIGN_OR_RETURN(const uint32_t page, AddImage(image));
  images_[image] = page;
  return page;
}

Result<uint32_t> GltfTextures::AddImage(uint64_t number) {
  const GltfJson* const image = GltfElement(document_.json(), "images", number);
  const std::string* const uri = TextOf(image, "uri");
  if (uri != nullptr && !uri->starts_with("data:")) {
    return pages_.AddFile(FolderOf(document_.path()), GltfDocument::Unescaped(*uri));
  }
  return pages_.Add(TextureOf(image, number));
}

Texture GltfTextures::TextureOf(const GltfJson* image, uint64_t number) const {
  Texture texture;
  const std::string* const name = TextOf(image, "name");
  texture.name =
      name == nullptr || name->empty() ? "image_" + std::to_string(number) : PlainFileName(*name);
  const auto part = [&]() -> Result<GltfBytes> {
    if (const std::string* const uri = TextOf(image, "uri"); uri != nullptr) {
      return document_.DataUri(*uri);
    }
    MTDB_ASSIGN_OR_RETURN(GltfBytes bytes, document_.BufferView(NumberOf(image, "bufferView")));
    if (bytes.memory != nullptr) return bytes;
    if (bytes.file.get() == &file_) {
      // The reader's file is closed some time.
      MTDB_ASSIGN_OR_RETURN(bytes.file, file_.Copy());
    }
    return bytes;
  }();
  if (!part.ok()) {
    const Status status = part.status();
    AddIgnored(report_, "an image that cannot be read: " + status.message());
    texture.load = [status]() -> Result<Bytes> { return status; };
    return texture;
  }
  texture.load = Loader(*part, document_.path());
  const GltfBytes& bytes = *part;
  const ImageInfo info = LookAtImage(
      [&bytes](uint64_t offset, std::span<std::byte> out) { return ReadPart(bytes, offset, out); });
  texture.media_type = info.media_type;
  texture.width = info.width;
  texture.height = info.height;
  const std::string suffix = SuffixOfImage(info.media_type);
  if (!texture.name.ends_with(suffix) && (suffix != ".jpg" || !texture.name.ends_with(".jpeg"))) {
    texture.name += suffix;
  }
  return texture;
}

bool GltfTextures::Finish() {
  if (has_images_) return true;
  if (primitives_ == 0 || with_coordinates_ < primitives_) return false;
  pages_.AddUnknown();
  return true;
}

void GltfTextures::PutInto(MeshHeader* header) const {
  header->textured = true;
  header->textures = pages_.pages();
}

}  // namespace mtdb::internal
