// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/internal/ply_stream.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <unistd.h>

#include "store/files/guarded_file.h"
#include "store/files/posix_file.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kMaxVertices = 0xffffffffull;
constexpr size_t kHeaderBytes = 256;
constexpr size_t kCopyBytes = 1 << 20;

#pragma pack(push, 1)
struct PlyFace {
  uint8_t corner_count = 3;
  uint32_t corners[3] = {};
};
#pragma pack(pop)
static_assert(sizeof(PlyFace) == 13);

// The header, filled up to kHeaderBytes by a comment.
std::string MakeHeader(uint64_t vertex_count, uint64_t triangle_count) {
  const std::string start = "ply\nformat binary_little_endian 1.0\ncomment made by mtdb generate";
  const std::string rest = "\nelement vertex " + std::to_string(vertex_count) +
                           "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                           std::to_string(triangle_count) +
                           "\nproperty list uchar uint vertex_indices\nend_header\n";
  return start + std::string(kHeaderBytes - start.size() - rest.size(), '.') + rest;
}

}  // namespace

PlyStreamWriter::~PlyStreamWriter() {
  if (vertex_fd_ >= 0) close(vertex_fd_);
  if (face_fd_ >= 0) close(face_fd_);
  if (!unfinished_path_.empty()) unlink(unfinished_path_.c_str());
}

Status PlyStreamWriter::Error(const char* action) const {
  const int error = errno;
  const StatusCode code = FileErrorCode(error);
  const bool full = code == StatusCode::kNoSpace;
  return Status(code, path_ + ": cannot " + action + ": " + std::strerror(error) +
                          (full ? "; free some space or write elsewhere" : ""));
}

Status PlyStreamWriter::Open(const std::string& path, int* fd) const {
  *fd = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  return *fd >= 0 ? Status::Ok() : Error("create a file");
}

Status PlyStreamWriter::Write(int fd, const void* bytes, size_t count) const {
  const char* at = static_cast<const char*>(bytes);
  while (count > 0) {
    const ssize_t n = write(fd, at, count);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return Error("write");
    at += n;
    count -= static_cast<size_t>(n);
  }
  return Status::Ok();
}

Status PlyStreamWriter::Begin(const MeshHeader& header) {
  if (!header.attributes.empty() || header.double_positions) {
    return Unsupported(path_ + ": this writer takes float32 positions without attributes");
  }
  MTDB_RETURN_IF_ERROR(CheckReplaceable(path_));
  const std::string unfinished = path_ + "." + std::to_string(getpid()) + ".part";
  MTDB_RETURN_IF_ERROR(Open(unfinished, &vertex_fd_));
  unfinished_path_ = unfinished;
  const std::string faces = unfinished + ".faces";
  MTDB_RETURN_IF_ERROR(Open(faces, &face_fd_));
  unlink(faces.c_str());
  const std::string blank = MakeHeader(0, 0);
  return Write(vertex_fd_, blank.data(), blank.size());
}

Status PlyStreamWriter::AddVertices(std::span<const Vec3d> positions, ByteSpan /*rows*/) {
  vertex_count_ += positions.size();
  if (vertex_count_ > kMaxVertices) {
    return Unsupported(path_ +
                       ": more than 4294967295 vertices, which 32-bit PLY indices cannot "
                       "name; ask for fewer triangles");
  }
  buffer_.resize(positions.size() * sizeof(Vec3f));
  char* out = buffer_.data();
  for (const Vec3d& p : positions) {
    const Vec3f f{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
    std::memcpy(out, &f, sizeof(f));
    out += sizeof(f);
  }
  return Write(vertex_fd_, buffer_.data(), buffer_.size());
}

Status PlyStreamWriter::AddTriangles(std::span<const TriangleVertices> triangles) {
  triangle_count_ += triangles.size();
  buffer_.resize(triangles.size() * sizeof(PlyFace));
  char* out = buffer_.data();
  for (const TriangleVertices& t : triangles) {
    PlyFace face;
    for (size_t i = 0; i < 3; ++i) {
      if (t[i] >= kMaxVertices) return Unsupported(path_ + ": a vertex index exceeds 32 bits");
      face.corners[i] = static_cast<uint32_t>(t[i]);
    }
    std::memcpy(out, &face, sizeof(face));
    out += sizeof(face);
  }
  return Write(face_fd_, buffer_.data(), buffer_.size());
}

Status PlyStreamWriter::AppendFaces() {
  if (lseek(face_fd_, 0, SEEK_SET) < 0) return Error("read back the faces");
  buffer_.resize(kCopyBytes);
  for (;;) {
    const ssize_t n = read(face_fd_, buffer_.data(), buffer_.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return Error("read back the faces");
    if (n == 0) return Status::Ok();
    MTDB_RETURN_IF_ERROR(Write(vertex_fd_, buffer_.data(), static_cast<size_t>(n)));
  }
}

Status PlyStreamWriter::End() {
  MTDB_RETURN_IF_ERROR(AppendFaces());
  const std::string header = MakeHeader(vertex_count_, triangle_count_);
  if (lseek(vertex_fd_, 0, SEEK_SET) < 0) return Error("write the header");
  MTDB_RETURN_IF_ERROR(Write(vertex_fd_, header.data(), header.size()));
  if (::fdatasync(vertex_fd_) != 0) return Error("finish the file");
  const int fd = vertex_fd_;
  vertex_fd_ = -1;
  if (close(fd) != 0) return Error("finish the file");
  MTDB_RETURN_IF_ERROR(CheckReplaceable(path_));
  if (std::rename(unfinished_path_.c_str(), path_.c_str()) != 0) return Error("name the file");
  unfinished_path_.clear();
  return Status::Ok();
}

}  // namespace mtdb::internal
