// SPDX-License-Identifier: Apache-2.0
// Faces of four corners that can be cut in one way only, so that the truth is known without knowing
// how mtdb chooses.
#pragma once

#include <cstdint>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb::everything {

using Faces = std::vector<std::vector<VertexIndex>>;

// Every triangle as a face.
Faces TriangleFaces(const TriangleMesh& mesh);
// Some triangles get a vertex inside, so that two of the three that they become are a quadrilateral
// which is concave there. Not their attributes.
void AddDarts(uint64_t seed, TriangleMesh* mesh);
// Joins neighbours, one behind the other in the mesh, to quadrilaterals where only the diagonal
// between them lies inside, or is clearly the shorter one.
Faces JoinedFaces(const TriangleMesh& mesh);

}  // namespace mtdb::everything
