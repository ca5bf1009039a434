// SPDX-License-Identifier: Apache-2.0
// GltfPages: a textured mesh as glTF has it.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "codecs/mesh_file/atomic_file.h"
#include "codecs/mesh_file/textures/image_files.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// In glTF a vertex has one place in an image, and a primitive one image. So each page has vertices
// of its own, and one whose corners have several places is there several times. Memory: that of the
// vertices, and some 40 bytes a triangle.
class GltfPages {
 public:
  // `stride`: bytes of a vertex, which begins with its position as floats and has its place, two
  // floats, at `place_at`.
  GltfPages(size_t stride, size_t place_at) : stride_(stride), place_at_(place_at) {}

  void AddVertices(ByteSpan vertices) {
    vertices_.insert(vertices_.end(), vertices.begin(), vertices.end());
  }
  void AddTriangles(std::span<const TriangleVertices> triangles,
                    std::span<const TextureCorner> corners);
  // Of the file, once all triangles are there.
  uint64_t vertex_bytes() const { return vertex_count_ * stride_; }
  uint64_t index_bytes() const { return index_bytes_; }

  struct Vertex {
    uint32_t given = 0;            // its number among those of AddVertices()
    std::array<float, 2> place{};  // v goes down
  };
  // The triangles of a page, and those of none at the end.
  struct Part {
    std::vector<Vertex> vertices;
    std::vector<uint32_t> indices;
    Box3d bounds;
    int image = -1;  // of those that were written; -1: none
  };
  const std::map<uint32_t, Part>& parts() const { return parts_; }

  // The vertices of all parts, then their indices.
  Status WriteMesh(AtomicFile* file) const;
  // Writes the images of the pages that are used, one after the other, each up to a multiple of
  // four bytes. Those in formats that glTF does not know are left out. Errors: those of
  // Texture::load and of the file.
  Status WriteImages(const MeshHeader& header, const ImageFiles& names, AtomicFile* file);
  uint64_t image_bytes() const { return image_bytes_; }
  const std::vector<std::string>& left_out() const { return left_out_; }

  // Members of the file's JSON. The images' views begin with `first_view`, and lie from `offset` on
  // in buffer 0.
  std::string MaterialsJson(size_t first_view) const;
  std::string ViewsJson(uint64_t offset) const;  // with a comma in front of each
  // By how much the JSON may grow when the images have been written.
  size_t JsonRoom() const;

 private:
  struct Image {
    std::string media_type, name;
    uint64_t offset = 0, bytes = 0;
  };
  // One more vertex of a given one.
  struct Copy {
    uint32_t page = 0, vertex = 0, u = 0, v = 0;  // u, v: bits of floats
    friend bool operator==(const Copy&, const Copy&) = default;
  };
  struct CopyHash {
    size_t operator()(const Copy& copy) const;
  };
  struct First {
    uint32_t page = kNone, index = 0;
  };
  static constexpr uint32_t kNone = TextureCorner::kNoPage - 1;
  uint32_t IndexOf(uint32_t page, uint32_t vertex, const TextureCorner& corner, Part* part);
  uint32_t AddVertex(const Vertex& vertex, Part* part);

  size_t stride_, place_at_;
  Bytes vertices_;            // as they were given
  std::vector<First> first_;  // by given vertex: where it is; others are in copies_
  std::unordered_map<Copy, uint32_t, CopyHash> copies_;
  std::map<uint32_t, Part> parts_;
  uint64_t vertex_count_ = 0;
  uint64_t index_bytes_ = 0;
  std::vector<Image> images_;
  uint64_t image_bytes_ = 0;
  std::vector<std::string> left_out_;  // names
};

}  // namespace mtdb::internal
