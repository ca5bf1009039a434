// SPDX-License-Identifier: Apache-2.0
// What the writers of all mesh file formats share: the order of calls, the counts, the file.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "codecs/mesh_file/atomic_file.h"
#include "codecs/mesh_file/mesh_file.h"
#include "codecs/mesh_file/textures/image_files.h"
#include "codecs/mesh_file/writers/float_positions.h"
#include "store/base/mesh_sink.h"
#include "store/base/vertex_meaning.h"

namespace mtdb::internal {

// ".ply, .obj or .off": the suffixes of formats that are written exactly.
std::string ExactSuffixes();

// Checks what arrives and hands it to the format. Every format wants both counts in the header,
// and all vertices before the first triangle: kInvalidArgument otherwise, as for a triangle whose
// vertex does not exist. So is a block of triangles of a textured mesh that its corners do not
// follow, where the format has texture coordinates.
class MeshWriter : public MeshFileWriter {
 public:
  explicit MeshWriter(std::string path) : path_(std::move(path)) {}

  // Before Begin: into this open file, not into one of that path.
  void WriteInto(int descriptor) { descriptor_ = descriptor; }

  Status Begin(const MeshHeader& header) final;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) final;
  Status AddTriangles(std::span<const TriangleVertices> triangles) final;
  Status AddCorners(std::span<const TextureCorner> corners) final;
  Status End() final;
  uint64_t bytes_written() const final { return bytes_written_; }
  double LargestRounding(const MeshHeader& header) const override {
    return FloatPositions(header, origin_kind()).LargestRounding(header);
  }
  double rounding() const override { return positions_.rounding(); }
  MeshWriteReport report() const final;

 protected:
  virtual Status WriteHeader() = 0;
  virtual Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) = 0;
  virtual Status WriteTriangles(std::span<const TriangleVertices> triangles) = 0;
  // Whether a format that has textures has its images in files of their own.
  virtual bool has_image_files() const { return true; }
  // Formats that have texture coordinates. Triangles of a textured mesh then come here, with three
  // corners each, and not to WriteTriangles.
  virtual bool has_textures() const { return false; }
  virtual Status WriteTexturedTriangles(std::span<const TriangleVertices> /*triangles*/,
                                        std::span<const TextureCorner> /*corners*/) {
    return Status::Ok();
  }
  virtual Status WriteEnd() { return Status::Ok(); }
  // Which origins the format has room for.
  virtual FloatOrigin origin_kind() const { return FloatOrigin::kNone; }
  // How the file has the header's positions: "float32", "float64", "decimal" or "quantised".
  virtual const char* position_type() const = 0;
  // What the writer has to say of the file, besides what all have.
  virtual void AddToReport(MeshWriteReport* /*report*/) const {}

  // In WriteHeader: which attributes the file has, by their places in the layout.
  void Carry(std::span<const size_t> attributes) {
    for (const size_t i : attributes) carried_[i] = true;
  }
  void CarryAll() { carried_.assign(carried_.size(), true); }

  const std::string& path() const { return path_; }
  const MeshHeader& header() const { return header_; }
  uint64_t vertex_count() const { return *header_.vertex_count; }
  uint64_t triangle_count() const { return *header_.triangle_count; }
  AtomicFile& file() { return *file_; }
  // Whether the file is to have texture coordinates; then images() are there from WriteHeader on.
  bool is_textured() const { return header_.textured && has_textures(); }
  // Its files are written by End(), behind WriteEnd().
  ImageFiles& images() { return *images_; }
  const ImageFiles& images() const { return *images_; }
  // Whether the file has a name, and so a folder for other files beside it.
  bool has_folder() const { return descriptor_ < 0; }
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
  Status NoCorners() const;

  std::string path_;
  int descriptor_ = -1;
  MeshHeader header_;
  FloatPositions positions_;
  std::unique_ptr<AtomicFile> file_;  // between Begin and End
  std::vector<bool> carried_;         // by attribute
  std::unique_ptr<ImageFiles> images_;
  std::vector<TriangleVertices> pending_;  // that wait for their corners
  uint64_t vertices_seen_ = 0;
  uint64_t triangles_seen_ = 0;
  uint64_t bytes_written_ = 0;
};

// The value of a colour that a text or a byte takes, and whether it had to be cut.
class ColourReader {
 public:
  ColourReader() = default;
  explicit ColourReader(const ColourAttributes& colours) : colours_(colours) {}
  int count() const { return colours_.count; }
  ScalarType type() const { return colours_.type; }
  // Those of the layout, of the first `components`.
  std::span<const size_t> indices(int components = 4) const {
    return std::span(colours_.indices)
        .first(static_cast<size_t>(std::min(components, colours_.count)));
  }
  // Of component c: from 0 to 1, and as one of 256.
  double Part(const std::byte* row, int c) { return ColourPart(At(row, c), colours_.type); }
  uint8_t Byte(const std::byte* row, int c) { return ColourByte(At(row, c), colours_.type); }
  // Whether Byte rounds.
  bool rounds() const { return count() > 0 && type() == ScalarType::kUint16; }
  bool is_float() const { return count() > 0 && type() >= ScalarType::kFloat32; }
  uint64_t cut() const { return cut_; }
  // Says what `bits` made of the colours.
  void AddToReport(const char* bits, MeshWriteReport* report) const;

 private:
  const std::byte* At(const std::byte* row, int c) {
    const std::byte* const at = row + colours_.offsets[static_cast<size_t>(c)];
    if (IsCutColour(at, colours_.type)) ++cut_;
    return at;
  }
  ColourAttributes colours_;
  uint64_t cut_ = 0;  // components outside of 0 to 1
};

std::unique_ptr<MeshWriter> CreatePlyWriter(const std::string& path,
                                            const MeshWriteOptions& options);
std::unique_ptr<MeshWriter> CreateObjWriter(const std::string& path);
std::unique_ptr<MeshWriter> CreateOffWriter(const std::string& path,
                                            const MeshWriteOptions& options);
std::unique_ptr<MeshWriter> CreateStlWriter(const std::string& path);
std::unique_ptr<MeshWriter> CreateGltfWriter(const std::string& path,
                                             const MeshWriteOptions& options);
Result<std::unique_ptr<MeshWriter>> CreateDracoWriter(const std::string& path,
                                                      const MeshWriteOptions& options);

}  // namespace mtdb::internal
