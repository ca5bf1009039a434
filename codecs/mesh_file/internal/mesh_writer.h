// SPDX-License-Identifier: Apache-2.0
// What the writers of all mesh file formats share: the order of calls, the counts, the file.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "codecs/mesh_file/atomic_file.h"
#include "codecs/mesh_file/internal/float_positions.h"
#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// ".ply, .obj or .off": the suffixes of formats that are written exactly.
std::string ExactSuffixes();

// Checks what arrives and hands it to the format. Every format wants both counts in the header,
// and all vertices before the first triangle: kInvalidArgument otherwise, as for a triangle whose
// vertex does not exist.
class MeshWriter : public MeshFileWriter {
 public:
  explicit MeshWriter(std::string path) : path_(std::move(path)) {}

  // Before Begin: into this open file, not into one of that path.
  void WriteInto(int descriptor) { descriptor_ = descriptor; }

  Status Begin(const MeshHeader& header) final;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) final;
  Status AddTriangles(std::span<const TriangleVertices> triangles) final;
  Status End() final;
  uint64_t bytes_written() const final { return bytes_written_; }
  double LargestRounding(const MeshHeader& header) const override {
    return FloatPositions(header).LargestRounding(header);
  }
  double rounding() const override { return positions_.rounding(); }
  std::optional<Vec3d> origin() const final {
    return positions_.has_origin() ? std::optional(positions_.origin()) : std::nullopt;
  }

 protected:
  virtual Status WriteHeader() = 0;
  virtual Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) = 0;
  virtual Status WriteTriangles(std::span<const TriangleVertices> triangles) = 0;
  virtual Status WriteEnd() { return Status::Ok(); }

  const std::string& path() const { return path_; }
  const MeshHeader& header() const { return header_; }
  uint64_t vertex_count() const { return *header_.vertex_count; }
  uint64_t triangle_count() const { return *header_.triangle_count; }
  AtomicFile& file() { return *file_; }
  // For formats of float32 positions.
  FloatPositions& float_positions() { return positions_; }
  const FloatPositions& float_positions() const { return positions_; }
  // "X Y Z", for formats of text; false when a float32 is wanted and p is too large for one.
  [[nodiscard]] bool AppendPosition(std::string* text, Vec3d p);
  Status TooLarge() const {
    return InvalidArgument(path_ + ": a position is too large for float32; write " +
                           ExactSuffixes());
  }

 private:
  std::string path_;
  int descriptor_ = -1;
  MeshHeader header_;
  FloatPositions positions_;
  std::unique_ptr<AtomicFile> file_;  // between Begin and End
  uint64_t vertices_seen_ = 0;
  uint64_t triangles_seen_ = 0;
  uint64_t bytes_written_ = 0;
};

// Where an attribute lies in a row.
struct AttributeColumn {
  ScalarType type = ScalarType::kFloat32;
  size_t offset = 0;
};
// The attribute of that name and type; nullopt when there is none.
std::optional<AttributeColumn> FindAttribute(const AttributeLayout& layout, std::string_view name,
                                             ScalarType type);

// red, green, blue and perhaps alpha of type uint8.
struct ColourColumns {
  size_t offsets[4] = {};  // in a row
  int count = 0;           // 0 (none), 3 or 4
};
ColourColumns FindColours(const AttributeLayout& layout);

// nx, ny, nz of type float32.
struct NormalColumns {
  size_t offsets[3] = {};
  bool found = false;
};
NormalColumns FindNormals(const AttributeLayout& layout);

std::unique_ptr<MeshWriter> CreatePlyWriter(const std::string& path);
std::unique_ptr<MeshWriter> CreateObjWriter(const std::string& path);
std::unique_ptr<MeshWriter> CreateOffWriter(const std::string& path);
std::unique_ptr<MeshWriter> CreateStlWriter(const std::string& path);
std::unique_ptr<MeshWriter> CreateGltfWriter(const std::string& path);
Result<std::unique_ptr<MeshWriter>> CreateDracoWriter(const std::string& path,
                                                      const MeshWriteOptions& options);

}  // namespace mtdb::internal
