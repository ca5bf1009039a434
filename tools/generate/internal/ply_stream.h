// SPDX-License-Identifier: Apache-2.0
// A sink that writes binary PLY without knowing the counts beforehand.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Writes float32 positions and uint32 indices to `path` in memory of some megabytes. Vertices go to
// a file beside it, faces to a nameless one that is appended at the end; then the header, of fixed
// size, gets its counts, and the file its name. A writer that is destroyed without a successful
// End() leaves nothing behind. Attributes are refused. Errors: kIoError, kNoSpace, kUnsupported
// (more vertices than 32-bit indices can name), kInvalidArgument; all name the path.
class PlyStreamWriter final : public MeshSink {
 public:
  explicit PlyStreamWriter(std::string path) : path_(std::move(path)) {}
  ~PlyStreamWriter() override;
  PlyStreamWriter(const PlyStreamWriter&) = delete;
  PlyStreamWriter& operator=(const PlyStreamWriter&) = delete;

  Status Begin(const MeshHeader& header) override;
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override;
  Status AddTriangles(std::span<const TriangleVertices> triangles) override;
  Status End() override;

 private:
  Status Open(const std::string& path, int* fd) const;
  Status Write(int fd, const void* bytes, size_t count) const;
  Status AppendFaces();
  Status Error(const char* action) const;

  std::string path_;
  std::string unfinished_path_;  // empty: no such file
  int vertex_fd_ = -1;
  int face_fd_ = -1;
  uint64_t vertex_count_ = 0;
  uint64_t triangle_count_ = 0;
  std::vector<char> buffer_;
};

}  // namespace mtdb::internal
