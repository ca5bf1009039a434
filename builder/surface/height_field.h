// SPDX-License-Identifier: Apache-2.0
// Whether a mesh is a height field seen along z: above each place it has one height, or none.
#pragma once

#include <cstdint>
#include <queue>
#include <set>
#include <vector>

#include "builder/intake/input_mesh.h"
#include "builder/mesh_survey.h"
#include "builder/surface/corner_join.h"
#include "store/base/grid.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Makes all faces of the input look up, on survey->grid, which has linear positions of at most 25
// bits, or on a finer one where the options leave the choice and that grid folds the mesh. All must
// look up, or all down: kBadInput names the first place where one does not. Returns the largest
// slope, height by distance.
Result<double> MakeFacesLookUp(const BuildOptions& options, const SpoolSpace* space,
                               size_t memory_bytes, InputMesh* input, MeshSurvey* survey);

// The error of an edge with more than two faces.
Status OverlappingFaces(uint64_t edges);

// Whether faces that look up lie above each other. How many faces are above a place is how often
// the surface's border winds around it; so the border alone is looked at, by a line that sweeps
// from the least x to the largest (after Shamos and Hoey, 1976). Exact: positions are integers of
// at most 25 bits. Corners that lie on another edge, and edges that lie on each other, are no
// folds. Single thread.
class BorderSweep {
 public:
  // Errors beyond so many bytes: kBudgetExceeded.
  explicit BorderSweep(uint64_t memory_bytes) : memory_bytes_(memory_bytes) {}
  // The triangle's border edges.
  Status Add(const TileTriangle& triangle);
  // After the last one. kBadInput names a place with two heights.
  Status Check(const Grid& grid);

 private:
  struct Point {
    int32_t x = 0, y = 0;
    friend auto operator<=>(const Point&, const Point&) = default;
  };
  // An edge from the left to the right, that adds `winding` to the number of faces above places,
  // from its right side to its left. An event at `from`; with winding 0 it is where one ends.
  struct Edge {
    Point from, to;
    int32_t winding = 0;
    mutable int32_t above = 0;  // faces on its left side
  };
  static int64_t Side(const Point& a, const Point& b, const Point& p);
  struct Below {
    using is_transparent = void;  // NOLINT(readability-identifier-naming)
    bool operator()(const Edge& a, const Edge& b) const;
    bool operator()(const Edge& a, const Point& p) const { return Side(a.from, a.to, p) > 0; }
  };
  struct Later {
    bool operator()(const Edge& a, const Edge& b) const { return a.from > b.from; }
  };
  using Active = std::set<Edge, Below>;

  void Cancel();
  // Takes all events of the next point; the edges that begin there.
  std::vector<Edge> TakeEvents(Point* at);
  // Adds the edges that begin at a point, and looks at their neighbours. False: a fold there.
  bool Begin(std::vector<Edge> edges, Active::iterator next, int32_t faces, Point* fold);
  static bool Cross(const Edge& a, const Edge& b);
  static Point Crossing(const Edge& a, const Edge& b);

  const uint64_t memory_bytes_;
  std::vector<Edge> edges_;
  std::priority_queue<Edge, std::vector<Edge>, Later> events_;
  Active active_;  // from below to above
};

// Whether a mesh whose faces look up has no more than one height at each place; kBadInput names one
// that has two. The input is gone afterwards. `memory_bytes`: of a BorderSweep.
Status CheckHeights(InputMesh& input, const Grid& grid, const JoinOptions& join,
                    uint64_t memory_bytes);

}  // namespace mtdb::internal
