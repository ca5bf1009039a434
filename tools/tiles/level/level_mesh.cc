// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/level/level_mesh.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <limits>
#include <sys/mman.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "store/files/posix_file.h"

namespace mtdb {

namespace {

constexpr uint64_t kBlockTriangles = 1 << 16;
// After so many, what was mapped is let go: 10 MiB, and 12 MiB.
constexpr uint64_t kReleaseVertices = 1 << 18;
constexpr uint64_t kReleaseTriangles = 1 << 20;

}  // namespace

MappedFile::~MappedFile() {
  if (data_ != nullptr) ::munmap(data_, size_bytes_);
}

Status MappedFile::Make(const std::string& folder, uint64_t size_bytes) {
  size_bytes_ = std::max<uint64_t>(size_bytes, 1);
  const int file = OpenNamelessFile(folder, "mtdb-tiles-");
  int error = file < 0 ? errno : ::posix_fallocate(file, 0, static_cast<off_t>(size_bytes_));
  if (error == 0) {
    void* const data = ::mmap(nullptr, size_bytes_, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (data == MAP_FAILED) {
      error = errno;
    } else {
      data_ = data;
    }
  }
  if (file >= 0) ::close(file);
  if (error == 0) return Status::Ok();
  return {FileErrorCode(error),
          folder + ": a temporary file of " + std::to_string(size_bytes_) +
              " bytes cannot be made: " + std::generic_category().message(error) +
              "; --tmp names another folder"};
}

void MappedFile::Release() const {
  if (data_ != nullptr) ::madvise(data_, size_bytes_, MADV_DONTNEED);
}

Status LevelMesh::Begin(const MeshHeader& header) {
  colours_ = FindColours(header.attributes);
  normals_ = FindNormals(header.attributes);
  row_bytes_ = header.attributes.row_bytes();
  const uint64_t vertices = header.vertex_count.value_or(0);
  if (vertices > std::numeric_limits<uint32_t>::max()) {
    return InvalidArgument("a level of " + std::to_string(vertices) +
                           " vertices is too large for tiles, which count 2^32");
  }
  MTDB_RETURN_IF_ERROR(vertex_file_.Make(tmp_directory_, vertices * sizeof(LevelVertex)));
  return triangle_file_.Make(tmp_directory_,
                             header.triangle_count.value_or(0) * sizeof(LevelTriangle));
}

Status LevelMesh::AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
  for (size_t i = 0; i < positions.size(); ++i) {
    LevelVertex v{place_(positions[i]), {}, {255, 255, 255, 255}};
    const std::byte* const row = rows.data() + i * row_bytes_;
    for (size_t c = 0; c < static_cast<size_t>(colours_.count); ++c) {
      v.rgba[c] = ColourByte(row + colours_.offsets[c], colours_.type);
    }
    if (normals_.found) {
      const Vec3d n = NormalIn(row, normals_);
      v.normal = {static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)};
    }
    static_cast<LevelVertex*>(vertex_file_.data())[vertices_++] = v;
    if (vertices_ % kReleaseVertices == 0) vertex_file_.Release();
  }
  return Status::Ok();
}

Status LevelMesh::AddTriangles(std::span<const TriangleVertices> triangles) {
  auto* const to = static_cast<LevelTriangle*>(triangle_file_.data());
  for (const TriangleVertices& t : triangles) {
    to[triangles_++] = {static_cast<uint32_t>(t[0]), static_cast<uint32_t>(t[1]),
                        static_cast<uint32_t>(t[2])};
    if (triangles_ % kReleaseTriangles == 0) triangle_file_.Release();
  }
  return Status::Ok();
}

Status LevelMesh::End() {
  Release();
  return Status::Ok();
}

Status LevelMesh::Visit(const std::function<Status(std::span<const LevelTriangle>)>& visit) const {
  const auto* const all = static_cast<const LevelTriangle*>(triangle_file_.data());
  for (uint64_t begin = 0; begin < triangles_; begin += kBlockTriangles) {
    const uint64_t count = std::min(kBlockTriangles, triangles_ - begin);
    MTDB_RETURN_IF_ERROR(visit({all + begin, static_cast<size_t>(count)}));
    if ((begin + count) % kReleaseTriangles == 0) Release();
  }
  Release();
  return Status::Ok();
}

void LevelMesh::Release() const {
  vertex_file_.Release();
  triangle_file_.Release();
}

}  // namespace mtdb
