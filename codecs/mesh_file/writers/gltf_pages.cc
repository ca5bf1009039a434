// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/writers/gltf_pages.h"

#include <bit>

#include "codecs/mesh_file/textures/image_info.h"

namespace mtdb::internal {
namespace {

bool IsKnown(const std::string& media_type) {
  return media_type == "image/jpeg" || media_type == "image/png" || media_type == "image/webp";
}

constexpr const char* kWebp = "EXT_texture_webp";

}  // namespace

size_t GltfPages::CopyHash::operator()(const Copy& copy) const {
  uint64_t hash = (uint64_t{copy.u} << 32 | copy.v) * 0x9e3779b97f4a7c15u;
  hash ^= hash >> 29 ^ copy.vertex ^ uint64_t { copy.page } << 32;
  hash *= 0xbf58476d1ce4e5b9u;
  return static_cast<size_t>(hash ^ hash >> 32);
}

uint32_t GltfPages::AddVertex(const Vertex& vertex, Part* part) {
  Vec3f p;
  std::memcpy(&p, vertices_.data() + vertex.given * stride_, sizeof(p));
  part->bounds.Add(Vec3d{p.x, p.y, p.z});
  part->vertices.push_back(vertex);
  ++vertex_count_;
  return static_cast<uint32_t>(part->vertices.size() - 1);
}

uint32_t GltfPages::IndexOf(uint32_t page, uint32_t vertex, const TextureCorner& corner,
                            Part* part) {
  const Vertex wanted{vertex, {corner.u, 1 - corner.v}};
  First& first = first_[vertex];
  if (first.page == kNone) {
    first = {page, AddVertex(wanted, part)};
    return first.index;
  }
  if (first.page == page && part->vertices[first.index].place == wanted.place) return first.index;
  const Copy copy{page, vertex, std::bit_cast<uint32_t>(wanted.place[0]),
                  std::bit_cast<uint32_t>(wanted.place[1])};
  const auto [at, is_new] = copies_.try_emplace(copy, 0);
  if (is_new) at->second = AddVertex(wanted, part);
  return at->second;
}

void GltfPages::AddTriangles(std::span<const TriangleVertices> triangles,
                             std::span<const TextureCorner> corners) {
  first_.resize(vertices_.size() / stride_);
  for (size_t i = 0; i < triangles.size(); ++i) {
    const uint32_t page = corners[3 * i].page;
    Part& part = parts_[page];
    for (size_t c = 0; c < 3; ++c) {
      const auto vertex = static_cast<uint32_t>(triangles[i][c]);
      part.indices.push_back(IndexOf(page, vertex, corners[3 * i + c], &part));
    }
  }
  index_bytes_ += triangles.size() * 3 * sizeof(uint32_t);
}

Status GltfPages::WriteMesh(AtomicFile* file) const {
  Bytes row(stride_);
  for (const auto& [page, part] : parts_) {
    for (const Vertex& vertex : part.vertices) {
      std::memcpy(row.data(), vertices_.data() + vertex.given * stride_, stride_);
      std::memcpy(row.data() + place_at_, vertex.place.data(), sizeof(vertex.place));
      MTDB_RETURN_IF_ERROR(file->Append(row));
    }
  }
  for (const auto& [page, part] : parts_) {
    MTDB_RETURN_IF_ERROR(file->Append(std::as_bytes(std::span(part.indices))));
  }
  return Status::Ok();
}

Status GltfPages::WriteImages(const MeshHeader& header, const ImageFiles& names, AtomicFile* file) {
  for (auto& [page, part] : parts_) {
    if (page == TextureCorner::kNoPage) continue;
    const Texture& texture = header.textures[page];
    if (texture.load == nullptr) continue;
    MTDB_ASSIGN_OR_RETURN(const Bytes bytes, texture.load());
    Image image{LookAtImage(bytes).media_type, names.name(page), image_bytes_, bytes.size()};
    if (!IsKnown(image.media_type)) {
      left_out_.push_back(image.name);
      continue;
    }
    part.image = static_cast<int>(images_.size());
    images_.push_back(std::move(image));
    const size_t padding = (4 - bytes.size() % 4) % 4;
    MTDB_RETURN_IF_ERROR(file->Append(bytes));
    MTDB_RETURN_IF_ERROR(file->Append(std::string(padding, '\0')));
    image_bytes_ += bytes.size() + padding;
  }
  return Status::Ok();
}

std::string GltfPages::MaterialsJson(size_t first_view) const {
  std::string materials, textures, images;
  for (const auto& [page, part] : parts_) {
    materials +=
        std::string(materials.empty() ? "" : ",") +
        R"({"pbrMetallicRoughness":{"metallicFactor":0)" +
        (part.image < 0 ? ""
                        : R"(,"baseColorTexture":{"index":)" + std::to_string(part.image) + "}") +
        R"(},"doubleSided":true})";
  }
  bool has_webp = false;
  for (size_t i = 0; i < images_.size(); ++i) {
    const char* const comma = i == 0 ? "" : ",";
    const bool is_webp = images_[i].media_type == "image/webp";
    const std::string source = "{\"source\":" + std::to_string(i) + "}";
    has_webp |= is_webp;
    textures +=
        comma +
        (is_webp ? std::string("{\"extensions\":{\"") + kWebp + "\":" + source + "}}" : source);
    // Names of files have nothing that JSON escapes.
    images += comma + std::string("{\"bufferView\":") + std::to_string(first_view + i) +
              ",\"mimeType\":\"" + images_[i].media_type + "\",\"name\":\"" + images_[i].name +
              "\"}";
  }
  std::string json = ",\"materials\":[" + materials + "]";
  if (!images_.empty()) json += ",\"textures\":[" + textures + "],\"images\":[" + images + "]";
  if (!has_webp) return json;
  const std::string list = std::string("[\"") + kWebp + "\"]";
  return json + ",\"extensionsUsed\":" + list + ",\"extensionsRequired\":" + list;
}

std::string GltfPages::ViewsJson(uint64_t offset) const {
  std::string json;
  for (const Image& image : images_) {
    json += ",{\"buffer\":0,\"byteOffset\":" + std::to_string(offset + image.offset) +
            ",\"byteLength\":" + std::to_string(image.bytes) + "}";
  }
  return json;
}

size_t GltfPages::JsonRoom() const {
  // What the texts above have for an image, its name and its numbers.
  constexpr size_t kMostBytes = 512;
  return (parts_.size() + 1) * kMostBytes;
}

}  // namespace mtdb::internal
