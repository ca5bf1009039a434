// Input: mesh files that a step asks for, and the truth about them.
//
// Parameters of a step, all optional:
//   shape      see kShapes in shapes.cc ("sheet"); size: about so many triangles (100); shapeseed
//   place      unit, tiny, huge, utm; double: coordinates that need doubles; snap: to steps of 2^-N
//   stray      a vertex far away that no triangle uses; twins: vertices in the same place
//   spoilt     duplicate and degenerate triangles
//   attr       a list of kinds, see kAttributes in input.cc; wide: so many doubles more; attrseed
//   format     a list, one for each file (the last for all others), see input_files.h ("ply")
//   files      in so many files; order: 1 names them from the last to the first
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "store/base/mesh_sink.h"
#include "store/object_record.h"
#include "tests/everything/distance.h"
#include "tests/everything/step.h"
#include "tests/support/mesh_check.h"

namespace mtdb::everything {

// What a mesh is, by the definition alone: vertices as they stand in the files, triangles less
// degenerate and duplicate ones.
struct Truth {
  TriangleMesh mesh;
  InputReport report;  // without the non-manifold counts
  Box3d bounds;        // of vertices that triangles use
  mtdb::testing::MeshCheck topology;
  bool fits_float = true;  // every coordinate of every vertex
  std::shared_ptr<const DistanceTree> tree;

  double longest() const;
  double diagonal() const { return Diagonal(bounds); }
};

// `parts` as several files of one object; `soup`: which of them have no shared vertices.
Truth MakeTruth(const std::vector<TriangleMesh>& parts, const std::vector<bool>& soup);

// A mesh by name; empty when there is none of that name.
TriangleMesh MakeShape(const std::string& shape, int64_t size, uint64_t seed);
std::vector<std::string> ShapeNames();
std::vector<std::string> AttributeKinds();

struct Input {
  std::vector<std::string> paths;
  Truth truth;
};
// Writes the files into `folder`, which must exist.
Input MakeInput(const Step& step, const std::string& folder);

}  // namespace mtdb::everything
