// SPDX-License-Identifier: Apache-2.0
// LevelMesh: the one conforming mesh that all tiles of a level are parts of, in temporary files.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "store/base/vertex_meaning.h"

namespace mtdb {

// Three vertices of a level.
using LevelTriangle = std::array<uint32_t, 3>;

struct LevelVertex {
  Vec3d position;                 // where the tiles' format wants it
  Vec3f normal;                   // of any length
  std::array<uint8_t, 4> rgba{};  // sRGB
};

// A file without a name that is mapped into memory, so that the system keeps of it what there is
// room for.
class MappedFile {
 public:
  MappedFile() = default;
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  // Of so many bytes, all 0, for which the disk has room. kNoSpace, kIoError.
  Status Make(const std::string& folder, uint64_t size_bytes);
  void* data() const { return data_; }
  uint64_t size_bytes() const { return size_bytes_; }
  // Takes its pages out of this process's memory; what they hold is kept.
  void Release() const;

 private:
  void* data_ = nullptr;
  uint64_t size_bytes_ = 0;
};

// A sink for the mesh of a query. Memory: some 20 MiB, whatever the size of the mesh. Afterwards
// any thread may read vertices.
class LevelMesh final : public MeshSink {
 public:
  // `place` makes positions of the tiles' format of those of the object.
  LevelMesh(std::string tmp_directory, std::function<Vec3d(Vec3d)> place)
      : tmp_directory_(std::move(tmp_directory)), place_(std::move(place)) {}

  Status Begin(const MeshHeader& header) override;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override;
  Status AddTriangles(std::span<const TriangleVertices> triangles) override;
  Status End() override;

  bool has_colours() const { return colours_.count > 0; }
  bool has_normals() const { return normals_.found; }  // the object's own
  uint64_t triangle_count() const { return triangles_; }
  uint64_t file_bytes() const { return vertex_file_.size_bytes() + triangle_file_.size_bytes(); }
  LevelVertex& vertex(uint32_t i) const {
    return static_cast<LevelVertex*>(vertex_file_.data())[i];
  }
  Triangle3d Corners(const LevelTriangle& t) const {
    return {vertex(t[0]).position, vertex(t[1]).position, vertex(t[2]).position};
  }
  // All triangles in blocks. Errors: those of `visit`.
  Status Visit(const std::function<Status(std::span<const LevelTriangle>)>& visit) const;
  // Takes what was read so far out of memory.
  void Release() const;

 private:
  std::string tmp_directory_;
  std::function<Vec3d(Vec3d)> place_;
  MappedFile vertex_file_, triangle_file_;
  ColourAttributes colours_;
  NormalAttributes normals_;
  size_t row_bytes_ = 0;
  uint64_t vertices_ = 0, triangles_ = 0;
};

}  // namespace mtdb
