// SPDX-License-Identifier: Apache-2.0
// FindFarVertices: what lies so far off a mesh that a grid over both is too coarse for the mesh.
#pragma once

#include <functional>
#include <optional>

#include "builder/intake/input_mesh.h"
#include "builder/mesh_survey.h"

namespace mtdb::internal {

// Looks for the box that holds most of the vertices that triangles use: along the longest axis that
// has gaps, the run of coordinates with the most vertices, between gaps of a 64th of
// the length and more; and again in that box, until it `suits`. None when no gap is left before
// that: the mesh is too long for its edges all over. Reads the vertices once a round, of which
// there are few.
Result<std::optional<FarVertices>> FindFarVertices(const InputMesh& input,
                                                   const std::function<bool(const Box3d&)>& suits);

}  // namespace mtdb::internal
