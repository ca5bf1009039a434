// SPDX-License-Identifier: Apache-2.0
// Meshes that the library owns, and meshes in the caller's arrays.
#pragma once

#include <cstdlib>
#include <memory>
#include <new>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "tools/c/mtdb.h"
#include "tools/c/mtdb_write.h"

namespace mtdb::internal {

// Memory that nobody writes before it is filled. Throws std::bad_alloc.
template <typename T>
class Filled {
 public:
  void Resize(uint64_t count) {
    data_.reset();
    if (count > SIZE_MAX / sizeof(T)) throw std::bad_alloc();
    if (count == 0) return;
    data_.reset(static_cast<T*>(::operator new(static_cast<size_t>(count) * sizeof(T))));
  }
  T* get() const { return data_.get(); }

 private:
  struct Free {
    void operator()(T* p) const { ::operator delete(p); }
  };
  std::unique_ptr<T, Free> data_;
};

}  // namespace mtdb::internal

// NOLINTNEXTLINE(readability-identifier-naming)
struct mtdb_mesh {
  mtdb::AttributeLayout attributes;
  uint64_t vertices = 0;
  uint64_t triangles = 0;
  mtdb::internal::Filled<double> positions;
  mtdb::internal::Filled<float> positions_float;
  double origin[3] = {0, 0, 0};
  double position_step = 0;  // MeshHeader's
  mtdb::internal::Filled<uint32_t> indices;
  mtdb::internal::Filled<unsigned char> rows;
  mtdb::internal::Filled<float> corners;   // of textured objects: see mtdb_mesh_view
  mtdb::internal::Filled<uint32_t> pages;  // likewise
};

namespace mtdb::internal {

// `origin` NULL: doubles. The counts of `header` must be set.
Result<std::unique_ptr<mtdb_mesh>> MakeMesh(const MeshHeader& header, const double* origin);
// Sends the mesh with its attributes.
Status Send(const mtdb_mesh& mesh, MeshSink& sink);
// The mesh as C++ has it.
Result<TriangleMesh> ToTriangleMesh(const mtdb_mesh& mesh);

// Names and types of a caller's attributes. Errors: kInvalidArgument.
Result<AttributeLayout> LayoutOf(const mtdb_attribute* attributes, size_t count);
// Sends a part of a mesh, without Begin and End. `row_bytes`: of the layout.
Status SendPart(const mtdb_input& part, size_t row_bytes, MeshSink& sink);
// Sends the whole.
Status SendInput(const mtdb_input& input, const AttributeLayout& layout, MeshSink& sink);
// Likewise, of a mesh whose header had this step.
Status SendInput(const mtdb_input& input, const AttributeLayout& layout, double position_step,
                 MeshSink& sink);

}  // namespace mtdb::internal
