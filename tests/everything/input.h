// SPDX-License-Identifier: Apache-2.0
// Input: mesh files that a step asks for, and the truth about them.
//
// Parameters of a step, all optional:
//   shape      see kShapes in shapes.cc ("sheet"); size: about so many triangles (100); shapeseed
//   place      unit, tiny, huge, utm; double: coordinates that need doubles; snap: to steps of 2^-N
//   stray      a vertex far away that no triangle uses; twins: vertices in the same place
//   spoilt     duplicate and degenerate triangles
//   flipped    such a part of the triangles is turned over
//   attr       a list of kinds, see kAttributes in input.cc; wide: so many doubles more; attrseed
//   format     a list, one for each file (the last for all others), see input_files.h ("ply")
//   files      in so many files; order: 1 names them from the last to the first
//   gzip       1: compressed; stdin: 1: the first file comes by standard input
//   weld       vertices so near become one, as a fraction of the longest side; 0: equal ones
//   apart      1: not even where the mesh was cut (--no-weld)
//   orient     1: sheets become consistent (--orient)
//   cut        so large a part of the corners have vertices of their own
//   far        a triangle reaches so many times the longest side away
#pragma once

#include <memory>
#include <optional>
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
  TriangleMesh mesh;     // vertices that others became have no triangles
  TriangleMesh surface;  // the mesh's triangles before near vertices became one; empty: the mesh
  std::optional<double> weld;  // model units
  bool keep_apart = false;
  bool orient = false;
  double moved = 0;    // by welding, at most
  InputReport report;  // without the non-manifold counts
  Box3d bounds;        // of vertices that triangles use
  mtdb::testing::MeshCheck topology;
  bool fits_float = true;  // every coordinate of every vertex
  std::shared_ptr<const DistanceTree> tree;

  // What answers must be near to.
  const TriangleMesh& original() const { return surface.triangles.empty() ? mesh : surface; }
  double longest() const;
  double diagonal() const { return Diagonal(bounds); }
};

// `parts` as several files of one object; `soup`: which of them have no shared vertices; `weld`:
// how near vertices become one; `keep_apart`: they do not where the mesh was cut either; `orient`:
// sheets become consistent.
Truth MakeTruth(const std::vector<TriangleMesh>& parts, const std::vector<bool>& soup,
                std::optional<double> weld = {}, bool keep_apart = false, bool orient = false);

// A mesh by name; empty when there is none of that name.
TriangleMesh MakeShape(const std::string& shape, int64_t size, uint64_t seed);
std::vector<std::string> ShapeNames();
std::vector<std::string> AttributeKinds();

struct Input {
  std::vector<std::string> paths;   // "-": standard input
  std::string standard_input = {};  // the file that comes by it; empty: none
  std::string format = {};          // of that, as --format says it
  Truth truth;
};
// Writes the files into `folder`, which must exist.
Input MakeInput(const Step& step, const std::string& folder);

}  // namespace mtdb::everything
