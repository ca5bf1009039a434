// SPDX-License-Identifier: Apache-2.0
// Helpers of the mesh file tests: scratch files, reading into memory, small meshes.
#pragma once

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <sstream>
#include <string>
#include <unistd.h>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"

namespace mtdb::testing {

// A folder that disappears with its contents.
class ScratchFolder {
 public:
  ScratchFolder() {
    static int next = 0;
    folder_ = std::filesystem::temp_directory_path() /
              ("mtdb_codecs_" + std::to_string(::getpid()) + "_" + std::to_string(next++));
    std::filesystem::remove_all(folder_);  // of a process of this number that was killed
    std::filesystem::create_directories(folder_);
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  std::string Write(const std::string& name, const std::string& content) const {
    std::ofstream(Path(name), std::ios::binary) << content;
    return Path(name);
  }
  size_t file_count() const {
    return static_cast<size_t>(std::distance(std::filesystem::directory_iterator(folder_), {}));
  }

 private:
  std::filesystem::path folder_;
};

inline std::string ReadBytes(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

struct ReadOutcome {
  Status status;
  TriangleMesh mesh;
  MeshReadReport report;
};

inline ReadOutcome ReadPath(const std::string& path) {
  ReadOutcome outcome;
  TriangleMeshSink sink(&outcome.mesh);
  outcome.status = ReadMeshFile(path, sink, &outcome.report);
  return outcome;
}

// Reads `content` as a file of that name.
inline ReadOutcome ReadText(const std::string& name, const std::string& content) {
  const ScratchFolder folder;
  return ReadPath(folder.Write(name, content));
}

inline ReadOutcome ReadGood(const std::string& name, const std::string& content) {
  ReadOutcome outcome = ReadText(name, content);
  INFO(outcome.status.message());
  REQUIRE(outcome.status.ok());
  return outcome;
}

// Requires kBadInput with a message of one line that names the file and has all `parts`.
inline void RequireBadInput(const std::string& name, const std::string& content,
                            std::initializer_list<const char*> parts) {
  const ReadOutcome outcome = ReadText(name, content);
  const std::string& message = outcome.status.message();
  INFO(message);
  REQUIRE(outcome.status.code() == StatusCode::kBadInput);
  REQUIRE(message.find('\n') == std::string::npos);
  REQUIRE(message.find(name + ": ") != std::string::npos);
  for (const char* part : parts) {
    INFO(part);
    REQUIRE(message.find(part) != std::string::npos);
  }
}

inline void AppendRaw(std::string* out, const void* data, size_t size, bool big_endian) {
  const char* const bytes = static_cast<const char*>(data);
  for (size_t i = 0; i < size; ++i) out->push_back(bytes[big_endian ? size - 1 - i : i]);
}
template <typename T>
void AppendValue(std::string* out, T value, bool big_endian = false) {
  AppendRaw(out, &value, sizeof(value), big_endian);
}

template <typename T>
T ValueInRow(const TriangleMesh& mesh, size_t vertex, size_t offset) {
  T value;
  std::memcpy(&value, mesh.rows.data() + vertex * mesh.header.attributes.row_bytes() + offset,
              sizeof(T));
  return value;
}

// A tetrahedron whose coordinates are float32 but not short decimals.
inline TriangleMesh Tetrahedron() {
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1.1f, 0, 0}, {0, 1.3f, 1e-7f}, {-0.7f, 0.1f, 1e6f}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  return mesh;
}

// With colours, normals and a scalar.
inline TriangleMesh ColouredTetrahedron() {
  TriangleMesh mesh = Tetrahedron();
  mesh.header.attributes.attributes = {
      {"nx", ScalarType::kFloat32},  {"ny", ScalarType::kFloat32},     {"nz", ScalarType::kFloat32},
      {"red", ScalarType::kUint8},   {"green", ScalarType::kUint8},    {"blue", ScalarType::kUint8},
      {"alpha", ScalarType::kUint8}, {"quality", ScalarType::kFloat64}};
  ByteWriter rows;
  for (int i = 0; i < 4; ++i) {
    rows.Put(0.1f * static_cast<float>(i));
    rows.Put(-0.5f);
    rows.Put(0.3f);
    for (int c = 0; c < 4; ++c) rows.Put(static_cast<uint8_t>(60 * i + 7 * c));
    rows.Put(1.0 / (i + 1));
  }
  mesh.rows = rows.Take();
  return mesh;
}

inline Status WriteMesh(const TriangleMesh& mesh, const std::string& path,
                        const MeshWriteOptions& options = {}) {
  Result<std::unique_ptr<MeshFileWriter>> writer = CreateMeshFileWriter(path, options);
  if (!writer.ok()) return writer.status();
  return SendMesh(mesh, **writer);
}

}  // namespace mtdb::testing
