// Decimator: simplifies one tile by vertex removals, cheapest error first.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/internal/hole_triangulation.h"
#include "builder/internal/round_mesh.h"
#include "builder/internal/tile.h"
#include "store/base/grid.h"

namespace mtdb {

struct DecimateOptions {
  uint32_t target_triangles = 0;  // stop at this many, or when no legal removal is left
  double largest_error = 0;       // work units; removals beyond it are not made
  uint32_t degree_limit = 12;     // a removed vertex has at most this many neighbours; <= 16
};

// Removes vertices of a tile until the target is met. Topology and orientation are kept; vertices
// on the tile's seam and at non-manifold places stay; vertices of the surface's border go like
// others. Each removal carries a bound on the two-sided distance between its hole and the input
// surface (see RoundMesh). Deterministic. Reuse one object per thread: it keeps its memory.
class Decimator {
 public:
  // `grid` gives the tile's positions in work units: grid steps, or model units when lossless.
  TileResult Decimate(std::span<const TileTriangle> tile, const Grid& grid,
                      const DecimateOptions& options);

 private:
  static constexpr uint32_t kMaxDegree = HoleTriangulation::kMaxRing;

  // The triangulated hole that a removal would leave, and its error.
  struct Plan {
    uint32_t k = 0;  // ring vertices
    bool boundary = false;
    bool conservative = false;
    double error = 0;
    HoleTriangulation::Triangles triangles;
    std::array<double, kMaxDegree> errors;  // of the triangles
  };
  // The part of a plan by overlay that is dear to find again.
  struct KeptPlan {
    bool valid = false;
    std::array<std::array<uint8_t, 3>, kMaxDegree - 2> triangles;
    std::array<double, kMaxDegree - 2> edge_errors;  // of triangle t's edge (first, last); t > 0
  };
  enum class Verdict : uint8_t { kLegal, kTopology, kDegree };

  void Load(std::span<const TileTriangle> tile, const Grid& grid);
  // Fills ring_, star_. False when the vertex has too many neighbours.
  bool CollectRing(uint32_t v);
  // Fills hole_.forbidden: edges between two locked vertices and, when `existing`, edges that are
  // there.
  void MarkForbiddenEdges(bool existing);
  // True when a diagonal of the plan is an edge of the mesh already.
  bool UsesExistingEdge(const Plan& plan) const;
  bool AreAdjacent(uint32_t unlocked, uint32_t other) const;
  Verdict Evaluate(uint32_t v, Plan& plan);
  // Fills samples_ and returns the star's normal, not normalised.
  Vec3d CollectSamples(uint32_t v, bool boundary);
  // Fills the hole's ring and frame_samples_; `n` is the star's unit normal.
  void SetFrame(const Plan& plan, Vec3d n);
  bool EvaluateByOverlay(uint32_t v, Vec3d n, Plan& plan);
  // Errors of the plan's triangles, from the curves of its edges and from the samples.
  void MeasureByOverlay(Plan& plan);
  // False when the new border edge exists already, or the new triangle would close a tetrahedron.
  bool EdgesAreFree(bool boundary) const;
  // Redoes what Commit needs of an evaluation whose plan was kept: the star of `v` is as it was.
  // False when the plan is legal no more.
  bool Recall(uint32_t v, Plan& plan);
  void Keep(uint32_t v, const Plan& plan);
  bool EvaluateConservatively(uint32_t v, Vec3d n, Plan& plan);
  double BorderCurveError(uint32_t v, uint32_t from, uint32_t to) const;
  void Commit(uint32_t v, const Plan& plan);
  void Push(uint32_t v, double error);

  uint32_t Origin(uint32_t h) const { return corners_[h / 3][h % 3]; }
  static uint32_t Next(uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
  static uint32_t Previous(uint32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }
  bool IsBorderEdge(uint32_t h) const { return border_[h / 3] >> (h % 3) & 1; }

  RoundMesh round_;
  DecimateOptions options_;

  // Vertices.
  std::vector<uint32_t> vertices_;
  std::vector<Vec3i> grid_positions_;
  std::vector<Vec3d> positions_;     // work units
  std::vector<uint32_t> half_edge_;  // outgoing; of a border vertex the one on the border
  std::vector<uint8_t> locked_, fixed_, on_border_, removed_, dirty_;
  std::vector<uint8_t> careful_;       // a plan used an edge that exists: look for them first
  std::vector<uint32_t> next_sample_;  // list of removed vertices
  std::vector<Verdict> verdict_;
  std::vector<KeptPlan> kept_;     // of vertices that are not dirty
  std::vector<float> last_error_;  // where the queue holds it

  // Triangles, current and past.
  std::vector<std::array<uint32_t, 3>> corners_;
  std::vector<float> errors_;
  std::vector<uint8_t> border_, alive_, tainted_;
  std::vector<uint32_t> sample_head_;  // removed vertices that the triangle stands for
  // Half-edges.
  std::vector<uint32_t> opposite_;
  std::vector<double> curve_error_;
  std::vector<uint32_t> chain_head_;  // of border edges: removed border vertices on its curve

  // The queue: the bits of a vertex's last error above its number, the smallest on top. An entry
  // that differs from its vertex's HeapKey is void.
  uint64_t HeapKey(uint32_t v) const {
    return uint64_t{std::bit_cast<uint32_t>(last_error_[v])} << 32 | v;
  }
  static float HeapError(uint64_t key) {
    return std::bit_cast<float>(static_cast<uint32_t>(key >> 32));
  }
  std::vector<uint64_t> heap_;

  // Of the vertex under evaluation.
  std::vector<uint32_t> ring_, star_;
  std::vector<uint32_t> ring_edges_;  // half-edge of the star from ring_[j] to ring_[j + 1]
  double shape_weight_ = 0;           // of a triangle's shape beside squared errors
  std::vector<uint32_t> samples_;     // removed vertices of its star, and itself
  HoleTriangulation hole_;
  std::vector<uint32_t> ring_mark_;
  std::vector<Vec3d> frame_samples_;      // positions of samples_ in the hole's frame
  std::vector<uint8_t> sample_triangle_;  // plan triangle of each sample

  TileResult result_;
  uint32_t live_triangles_ = 0;
};

}  // namespace mtdb
