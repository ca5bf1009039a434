// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: a mesh file. The first byte chooses the reader. What is read without an error
// must be a mesh: finite positions, as many rows, and no vertex out of range.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <sys/mman.h>
#include <unistd.h>

#include "codecs/mesh_file/readers/readers.h"

namespace {

using mtdb::Status;

class CheckingSink final : public mtdb::MeshSink {
 public:
  explicit CheckingSink(bool joins) : joins_(joins) {}
  Status Begin(const mtdb::MeshHeader& header) override {
    row_bytes_ = header.attributes.row_bytes();
    return Status::Ok();
  }
  Status AddVertices(std::span<const mtdb::Vec3d> positions, mtdb::ByteSpan rows) override {
    vertices_ += positions.size();
    if (rows.size() != positions.size() * row_bytes_) __builtin_trap();
    for (const mtdb::Vec3d& p : positions) {
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) __builtin_trap();
    }
    return Status::Ok();
  }
  Status AddTriangles(std::span<const mtdb::TriangleVertices> triangles) override {
    for (const mtdb::TriangleVertices& t : triangles) {
      for (const mtdb::VertexIndex v : t) most_ = std::max(most_, v + 1);
    }
    return Status::Ok();
  }
  Status End() override { return Status::Ok(); }
  bool joins_soup() const override { return joins_; }
  bool in_range() const { return most_ <= vertices_; }

 private:
  const bool joins_;
  size_t row_bytes_ = 0;
  uint64_t vertices_ = 0;
  uint64_t most_ = 0;
};

Status ReadWith(uint8_t reader, const mtdb::internal::InputFile& file, mtdb::MeshSink& sink,
                mtdb::MeshReadReport* report) {
  switch (reader % 5) {
    case 0: return mtdb::internal::ReadPly(file, {}, sink, report);
    case 1: return mtdb::internal::ReadObj(file, {}, sink, report);
    case 2: return mtdb::internal::ReadOff(file, {}, sink, report);
    case 3: return mtdb::internal::ReadBinaryStl(file, sink, report);
    default: return mtdb::internal::ReadAsciiStl(file, sink, report);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const int kDescriptor = ::memfd_create("mesh", 0);
  static const std::string kPath = "/proc/self/fd/" + std::to_string(kDescriptor);
  constexpr uint8_t kGltf = 120;  // of the first byte's lower bits
  if (size == 0) return 0;
  const auto written = static_cast<ssize_t>(size - 1);
  if (::ftruncate(kDescriptor, 0) != 0 || ::pwrite(kDescriptor, data + 1, size - 1, 0) != written) {
    __builtin_trap();
  }
  const auto file = mtdb::internal::InputFile::Open(kPath);
  if (!file.ok()) __builtin_trap();
  CheckingSink sink(data[0] >= 128);
  mtdb::MeshReadReport report;
  const bool is_gltf = (data[0] & 0x7f) >= kGltf;
  const Status status = is_gltf ? mtdb::internal::ReadGltf(**file, {}, sink, &report)
                                : ReadWith(data[0], **file, sink, &report);
  if (status.ok() && !sink.in_range()) __builtin_trap();
  if (!status.ok() && status.message().empty()) __builtin_trap();
  return 0;
}
