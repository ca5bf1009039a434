// SPDX-License-Identifier: Apache-2.0
// A mesh file that must be whole, as a mesh.
#pragma once

#include <catch2/catch.hpp>
#include <string>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"

namespace mtdb::testing {

inline TriangleMesh ReadMesh(const std::string& path) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const Status status = ReadMeshFile(path, sink, nullptr);
  INFO(status.message());
  REQUIRE(status.ok());
  return mesh;
}

}  // namespace mtdb::testing
