// SPDX-License-Identifier: Apache-2.0
// TileMeasure: what the error measures of surfaces in space and of height fields have in common.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "builder/disk/tile.h"
#include "builder/holes/hole.h"
#include "builder/holes/tile_mesh.h"
#include "builder/measure/filling_lanes.h"
#include "builder/measure/filling_measure.h"
#include "builder/measure/tile_surface.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// Keeps, of a tile's triangles, the errors of their edges and the removed vertices that they stand
// for; guesses the errors of diagonals. The surface that errors are measured against is the tile or
// a TileSurface; its vertices are the mesh's and others behind them.
class TileMeasure : public MeasureDefaults {
 public:
  double FirstGuess(uint32_t v) const { return kFirstGuess * heights_[v] + vertex_error(v); }
  // Of edges alone.
  double LowerBound(const Hole& hole, const Filling& filling) const;
  void End(TileResult& result) const;

 protected:
  static constexpr double kUnknown = -2;      // of a diagonal's error
  static constexpr double kFirstGuess = 0.4;  // of a vertex's error, by its height over others
  // What is known of a triangle, current or past: read together, of triangles anywhere in the tile.
  struct alignas(64) Triangle {
    std::array<double, 3> edge_errors{};
    // Of border edges: removed border vertices on the edge's curve.
    std::array<uint32_t, 3> chain_heads{kNone32, kNone32, kNone32};
    float error = 0;
    // The removed vertices that it stands for. A part of held_, which keeps those of triangles that
    // are gone for a while.
    uint32_t held_begin = 0, held_end = 0;
    bool own = false;  // of the tile's: it is one of the surface's
  };
  explicit TileMeasure(bool vertical) : vertical_(vertical) {}

  // The surface, with the mesh's vertices first.
  struct Surface {
    std::vector<std::array<uint32_t, 3>> triangles;
    std::vector<float> errors;
    std::vector<uint32_t> local;  // of TileSurface::vertices: their numbers here
  };
  Surface LoadTile(const TileMesh& mesh, std::span<const TileTriangle> tile,
                   const TileSurface* surface, const Grid& grid);
  // Of a half-edge.
  double edge_error(uint32_t h) const { return triangles_[h / 3].edge_errors[h % 3]; }
  uint32_t chain_head(uint32_t h) const { return triangles_[h / 3].chain_heads[h % 3]; }
  // What the surface around one of its vertices has accumulated.
  double vertex_error(uint32_t v) const { return vertex_errors_[v]; }
  // Finds the removed vertices of the hole's star and the one that goes, when first asked; Close()
  // before another hole.
  void GatherSamples(const Hole& hole);
  void Close() { gathered_ = false; }
  // True when the star is a part of the surface, so that diagonals cross nothing but its spokes.
  bool IsFresh(const Hole& hole) const;
  // Of such a star: diagonals that leave it get kUnknown.
  template <bool kIsVertical>
  void MeasureOverSpokes(Hole& hole) const;
  // From the samples that lie near an edge, spread.
  void GuessEdges(Hole& hole) const;
  // The largest error of edges that every filling has: the ring's, and the new border edge.
  double RimError(const Hole& hole) const;
  // Of a filling's edge, a < b.
  double EdgeError(const Hole& hole, uint32_t a, uint32_t b) const;
  // Sets the errors of a filling's triangles to those of their edges.
  void TakeEdgeErrors(const Hole& hole, Filling& filling) const;
  // The filling is in the mesh; `charges` says which triangle of it stands for which sample.
  void Add(const Hole& hole, const Filling& filling, uint32_t first, uint32_t new_chain,
           std::span<const std::pair<uint8_t, uint32_t>> charges);
  uint32_t JoinBorderChains(const Hole& hole);
  // Calls f(vertex) for the removed border vertices on a border half-edge's curve.
  template <typename F>
  void ForEachOnChain(uint32_t h, F&& f) const {
    for (uint32_t w = chain_head(h); w != kNone32; w = next_on_chain_[w]) f(w);
  }
  // Those of both border edges at a vertex that goes, and the vertex.
  template <typename F>
  void ForEachOnNewBorder(const Hole& hole, F&& f) const {
    f(hole.vertex);
    ForEachOnChain(hole.border_out, f);
    ForEachOnChain(hole.border_in, f);
  }

  const TileMesh* mesh_ = nullptr;
  std::vector<Triangle> triangles_;
  // Vertices: the mesh's, then others of the surface.
  std::vector<Vec3d> positions_;
  std::vector<double> vertex_errors_;
  std::vector<uint32_t> next_on_chain_;
  // Of the open hole.
  std::vector<uint32_t> samples_;  // removed vertices of its star, and the one that goes
  std::vector<Vec3d> points_;      // their places in the hole's frame
  SpreadPoints spread_;            // the same, when they are set

 private:
  void LoadHeld(const TileSurface& surface, std::span<const uint32_t> local);
  void MeasureVertices(const Surface& surface);
  // The samples of a triangle, the last one that was charged to it first.
  std::span<const uint32_t> HeldBy(uint32_t triangle) const {
    const Triangle& t = triangles_[triangle];
    return std::span(held_).subspan(t.held_begin, t.held_end - t.held_begin);
  }
  // Gives vertex `item[i].second` to triangle first + item[i].first.
  template <typename Items>
  void HoldIn(uint32_t first, uint32_t triangles, const Items& items);
  void FreeHeld(std::span<const uint32_t> triangles);

  bool vertical_;
  std::vector<uint32_t> held_;
  size_t held_in_use_ = 0;
  std::vector<double> heights_;      // of the mesh's vertices
  std::vector<uint32_t> opened_in_;  // the last hole that had it as a sample
  uint32_t opened_ = 0;
  bool gathered_ = false;  // the open hole's samples are known
};

}  // namespace mtdb::internal
