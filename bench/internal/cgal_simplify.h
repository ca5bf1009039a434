// SPDX-License-Identifier: Apache-2.0
// CGAL's edge collapses, as peers for quality.
#pragma once

#include <cstdint>
#include <optional>

#include "store/base/mesh_sink.h"

namespace mtdb {

enum class CgalMethod { kGarlandHeckbert, kLindstromTurk };

// Collapses edges until at most `triangles` are left. Nothing when the mesh is not an oriented
// manifold.
std::optional<TriangleMesh> SimplifyByCgal(const TriangleMesh& mesh, uint64_t triangles,
                                           CgalMethod method);

}  // namespace mtdb
