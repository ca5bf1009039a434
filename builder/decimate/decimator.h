// SPDX-License-Identifier: Apache-2.0
// Decimator: simplifies one tile by vertex removals, cheapest error first.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "builder/decimate/removal_queue.h"
#include "builder/disk/tile.h"
#include "builder/holes/delaunay_filling.h"
#include "builder/holes/filling_rule.h"
#include "builder/holes/free_filling.h"
#include "builder/holes/hole.h"
#include "builder/holes/tile_mesh.h"
#include "builder/measure/filling_measure.h"
#include "builder/measure/height_difference.h"
#include "builder/measure/surface_distance.h"
#include "builder/measure/tile_surface.h"
#include "codecs/cluster/cluster_limits.h"
#include "store/base/grid.h"
#include "store/object_record.h"

namespace mtdb::internal {

static_assert(kMostOrder == kMostFans);

// Where removals of a tile end.
struct RemovalLimits {
  uint32_t target_triangles = 0;  // stop at this many, or when no legal removal is left
  // Stop before the first removal beyond this error when at most so many triangles are left.
  double level_error = 0;  // work units
  uint32_t level_triangles = 0;
  double largest_error = 0;    // work units; removals beyond it are not made
  double crumb_error = 0;      // work units; small parts that are farther away stay
  uint32_t degree_limit = 12;  // a removed vertex has at most this many neighbours; <= 16
};
struct DecimateOptions : RemovalLimits, MeasureOptions {};

// Removes vertices of a tile until the target is met. Topology and orientation are kept; vertices
// on the tile's seam and nodes of the graph of creases stay; vertices of the surface's border and
// of other chains of creases go like others, where the measure takes them. Each removal carries a
// bound on the error of its hole. Deterministic. One object serves one thread, for one tile after
// the other: it keeps its memory.
class TileDecimator {
 public:
  virtual ~TileDecimator() = default;
  virtual ErrorMeasure measure() const = 0;
  // `grid` gives the tile's positions in work units: grid steps, or model units when lossless.
  virtual TileResult Decimate(std::span<const TileTriangle> tile, const Grid& grid,
                              const DecimateOptions& options) = 0;
  // Guesses of the errors of all removals that the tile begins with.
  virtual std::vector<double> FirstGuesses(std::span<const TileTriangle> tile,
                                           const Grid& grid) = 0;
};

// What comes next is the queue's business, what a removal costs the measure's, which triangles fill
// its hole the rule's, and the triangles are the mesh's.
template <FillingMeasure Measure, FillingRule Rule>
class Decimator final : public TileDecimator {
 public:
  ErrorMeasure measure() const override { return Measure::kMeasure; }
  TileResult Decimate(std::span<const TileTriangle> tile, const Grid& grid,
                      const DecimateOptions& options) override;
  std::vector<double> FirstGuesses(std::span<const TileTriangle> tile, const Grid& grid) override;

 private:
  enum class Verdict : uint8_t { kLegal, kTopology, kDegree };
  struct Vertex {
    Verdict verdict = Verdict::kLegal;
    bool stale = true;     // its star has changed since it was evaluated
    bool bounded = false;  // a lower bound on its error is known, not the error itself
    bool careful = false;  // a filling used an edge that exists: look for them first
  };
  // The part of a filling that is dear to find again; of vertices that went back to the queue and
  // are not stale.
  struct KeptFilling {
    struct Part {
      Hole::Triangle triangle;
      bool valid;         // of the first one: of the filling
      double edge_error;  // of the triangle's edge (first, last); not of the first one
    };
    std::array<Part, Hole::kMaxRing - 2> parts;
    bool valid() const { return parts[0].valid; }
  };

  void Begin(std::span<const TileTriangle> tile, const Grid& grid, const MeasureOptions& options);
  uint32_t LevelTriangles(const DecimateOptions& options, const TileResult& counted) const;
  void Evaluate(uint32_t v);
  bool FillSeen(Vertex& state);
  bool MeasureBest();
  bool FillFolded();
  void Keep(uint32_t v);
  void PutBack(uint32_t v);
  void TakeKept(uint32_t v);
  bool Recall(uint32_t v);
  bool IsReady(uint32_t v);
  void Remove();
  void TellNeighbours(std::span<const uint32_t> ring);
  // Of vertices that have twins: all of these at once.
  bool HasTwins(uint32_t v) const { return mesh_.twin(v) != v; }
  bool EvaluateTwins(uint32_t v);
  bool EvaluateFan(uint32_t twin, Vertex& state);
  bool NoteNewEdges();
  bool AreReady(uint32_t v);
  void RemoveTwins(uint32_t v);

  TileMesh mesh_;
  Measure measure_;
  Rule rule_;
  RemovalQueue queue_;
  uint32_t degree_limit_ = 0;
  std::vector<Vertex> states_;
  std::vector<KeptFilling> kept_;
  std::vector<Removal> removals_;
  uint32_t open_fans_ = 0;  // at most, of all removals
  // Of the vertex under evaluation.
  Hole hole_;
  Filling filling_;
  bool textured_ = false;  // the tile
  bool measured_ = false;  // the filling's diagonals, as far as they are seen
  bool patient_ = false;   // it is measured to its end, whatever else is cheaper
  struct Twins {
    double error = 0;      // the largest of their fillings
    uint32_t corners = 0;  // of their rings
    uint32_t begin = 0;    // where the first one's ring begins, a first twin
    // That their fillings make, by first twins.
    std::vector<std::pair<uint32_t, uint32_t>> new_edges;
  };
  Twins twins_;
};

// What the builder uses: for surfaces in space, and for terrains.
using SurfaceDecimator = Decimator<SurfaceDistance, FreeFilling>;
using TerrainDecimator = Decimator<HeightDifference, DelaunayFilling>;
using FreeTerrainDecimator = Decimator<HeightDifference, FreeFilling>;
extern template class Decimator<SurfaceDistance, FreeFilling>;
extern template class Decimator<HeightDifference, DelaunayFilling>;
extern template class Decimator<HeightDifference, FreeFilling>;

template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::Begin(std::span<const TileTriangle> tile, const Grid& grid,
                                     const MeasureOptions& options) {
  textured_ = options.textured != nullptr;
  mesh_.Load(tile, grid, Measure::kMeasure == ErrorMeasure::kVertical, !textured_);
  measure_.Begin(mesh_, tile, grid, options);
}

template <FillingMeasure Measure, FillingRule Rule>
TileResult Decimator<Measure, Rule>::Decimate(std::span<const TileTriangle> tile, const Grid& grid,
                                              const DecimateOptions& options) {
  degree_limit_ = std::min(options.degree_limit, Hole::kMaxRing);
  Begin(tile, grid, options);
  const uint32_t vertices = mesh_.vertices();
  states_.assign(vertices, Vertex{});
  kept_.resize(vertices);
  queue_.Reset(vertices);
  removals_.clear();
  open_fans_ = 0;
  TileResult result;
  // Vertices are evaluated when their turn comes; a guess that is mostly low decides when.
  for (uint32_t v = 0; v < vertices; ++v) {
    if (mesh_.locked(v)) {
      ++result.locked_vertices;
      result.seam_vertices += !mesh_.fixed(v);
    } else if (mesh_.first_twin(v) == v) {
      queue_.Push(v, measure_.FirstGuess(v));
    }
  }
  const uint32_t level_triangles = LevelTriangles(options, result);
  // All triangles that ever were are slots of the cluster; a ring at a crease has one corner more
  // than its star has triangles.
  const auto has_room = [&](uint32_t corners) {  // of a hole; its triangles may be two-sided
    return mesh_.sides() + open_fans_ + corners <= kMostSlots;
  };
  while (mesh_.live_triangles() > options.target_triangles && has_room(2 * Hole::kMaxRing)) {
    const std::optional<uint32_t> v = queue_.Pop();
    if (!v) break;
    const bool twins = HasTwins(*v);
    if (!(twins ? AreReady(*v) : IsReady(*v))) continue;
    const double error = twins ? twins_.error : filling_.error;
    if (error > options.largest_error) continue;
    if (error > options.level_error && mesh_.live_triangles() <= level_triangles) break;
    if (twins) {
      if (!has_room(2 * kMostFanCorners)) continue;
      RemoveTwins(*v);
      continue;
    }
    if (mesh_.UsesExistingEdge(hole_, filling_.triangles)) {
      // Rare, and found out here only: plan again without the edges that exist.
      states_[*v].careful = true;
      Evaluate(*v);
      if (states_[*v].verdict == Verdict::kLegal) PutBack(*v);
      continue;
    }
    Remove();
  }
  for (uint32_t v = 0; v < vertices; ++v) {
    if (mesh_.removed(v) || mesh_.locked(v)) continue;
    result.stuck_topology += states_[v].verdict == Verdict::kTopology;
    result.stuck_degree += states_[v].verdict == Verdict::kDegree;
  }
  mesh_.CopyTo(result);
  result.removals = removals_;
  measure_.End(result);
  return result;
}

// Where the seam locks most vertices, the others need not make up for them: the level may end the
// tile when half of these have gone.
template <FillingMeasure Measure, FillingRule Rule>
uint32_t Decimator<Measure, Rule>::LevelTriangles(const DecimateOptions& options,
                                                  const TileResult& counted) const {
  if (2 * counted.seam_vertices <= mesh_.vertices()) return options.level_triangles;
  const auto free = static_cast<uint32_t>(mesh_.vertices() - counted.locked_vertices);
  const uint32_t triangles = mesh_.live_triangles();
  return std::max(options.level_triangles, triangles - std::min(triangles, free));
}

template <FillingMeasure Measure, FillingRule Rule>
std::vector<double> Decimator<Measure, Rule>::FirstGuesses(std::span<const TileTriangle> tile,
                                                           const Grid& grid) {
  Begin(tile, grid, {});
  std::vector<double> guesses;
  for (uint32_t v = 0; v < mesh_.vertices(); ++v) {
    if (!mesh_.locked(v)) guesses.push_back(measure_.FirstGuess(v));
  }
  return guesses;
}

// Opens the hole of `v` and fills it, when its turn has come. False when it is not legal, or went
// back to the queue since others are cheaper.
template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::IsReady(uint32_t v) {
  Vertex& state = states_[v];
  const bool was_stale = state.stale;
  const bool was_bounded = state.bounded;
  if (!was_stale && kept_[v].valid() && Recall(v)) {
    if (!was_bounded || !queue_.HasCheaperThan(filling_.error)) return true;
    state.bounded = false;
  } else {
    Evaluate(v);
    if (state.verdict != Verdict::kLegal) return false;
    const bool is_new = was_stale || was_bounded;
    if (!state.bounded && (!is_new || !queue_.HasCheaperThan(filling_.error))) return true;
  }
  PutBack(v);
  return false;
}

// Finds the error of `v`, or as much of it as is enough to see that others are cheaper.
template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::Evaluate(uint32_t v) {
  Vertex& state = states_[v];
  state.stale = state.bounded = false;
  state.verdict = Verdict::kDegree;
  if (!mesh_.OpenHole(v, degree_limit_, hole_)) return;
  state.verdict = Verdict::kTopology;
  if (!mesh_.EdgesAreFree(hole_)) return;
  measure_.Open(hole_);
  mesh_.ForbidEdges(hole_, state.careful);
  measured_ = false;
  if (measure_.Sees(hole_) && FillSeen(state)) {
    if (!state.bounded) measure_.Measure(hole_, filling_);
  } else if (!measure_.MeasuresFolds() || !FillFolded()) {
    return;
  }
  state.verdict = Verdict::kLegal;
}

// Chooses the filling and measures its diagonals. Guesses say which diagonals are worth measuring,
// until the best filling is one of measured diagonals. Stops when others are cheaper, whatever is
// found. False when none can be measured.
template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::FillSeen(Vertex& state) {
  bool measured = false;
  if constexpr (Rule::kReadsEdgeErrors) measured = measure_.PriceEdges(hole_);
  rule_.Open(hole_);
  if (!rule_.Fill(hole_, filling_.triangles)) return false;
  const auto is_dear = [&](double bound) {
    filling_.error = bound;
    return state.bounded = !patient_ && queue_.HasCheaperThan(bound);
  };
  if (!measured) {
    if (is_dear(measure_.FirstBound(hole_, filling_, queue_.cheapest()))) return true;
    if (!MeasureBest()) return false;
  }
  measured_ = true;
  is_dear(measure_.LowerBound(hole_, filling_));
  return true;
}

template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::MeasureBest() {
  Hole::PerEdge<bool> known{};
  std::array<double, Hole::kMaxRing> guesses;
  for (;;) {
    for (uint32_t t = 1; t < hole_.k - 2; ++t) {
      guesses[t] = hole_.edge_error[filling_.triangles[t][0]][filling_.triangles[t][2]];
    }
    measure_.MeasureEdges(hole_, filling_, known);
    bool dearer = false;  // than guessed; else no other filling has become better than this one
    bool measurable = true;
    for (uint32_t t = 1; t < hole_.k - 2; ++t) {
      const auto [i, m, j] = filling_.triangles[t];
      const double error = hole_.edge_error[i][j];
      measurable &= error >= 0;
      if (!std::exchange(known[i][j], true)) dearer |= error < 0 || error > guesses[t];
    }
    if (!dearer || !Rule::kReadsEdgeErrors) return measurable;
    const Hole::Triangles before = filling_.triangles;
    if (!rule_.Fill(hole_, filling_.triangles)) return false;
    if (filling_.IsOf(before, hole_.k)) return measurable;
  }
}

// Likewise where projections mean nothing.
template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::FillFolded() {
  hole_.folded = true;
  hole_.ForEachDiagonal([&](uint32_t i, uint32_t j) { hole_.edge_error[i][j] = 0; });
  rule_.Open(hole_);
  if (!rule_.Fill(hole_, filling_.triangles)) return false;
  measure_.MeasureEdges(hole_, filling_, {});
  measure_.Measure(hole_, filling_);
  return true;
}

// Puts the vertex that was evaluated into the queue.
template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::PutBack(uint32_t v) {
  queue_.Push(v, filling_.error);
  Keep(v);
}

template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::Keep(uint32_t v) {
  KeptFilling& kept = kept_[v];
  kept.parts[0] = {filling_.triangles[0], measured_, 0};
  for (uint32_t t = 1; t < hole_.k - 2; ++t) {
    const Hole::Triangle triangle = filling_.triangles[t];
    kept.parts[t] = {triangle, true, hole_.edge_error[triangle[0]][triangle[2]]};
  }
}

// Opens the hole of `v` again and fills it as it was, its star being what it was. False when the
// filling is legal no more: a removal elsewhere may have joined two vertices of the ring since.
template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::Recall(uint32_t v) {
  mesh_.OpenHole(v, degree_limit_, hole_);
  if (!mesh_.EdgesAreFree(hole_)) return false;
  TakeKept(v);
  return true;
}

// The hole of `v` is open.
template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::TakeKept(uint32_t v) {
  measure_.Open(hole_);
  const KeptFilling& kept = kept_[v];
  for (uint32_t t = 0; t < hole_.k - 2; ++t) {
    const auto& [triangle, valid, edge_error] = kept.parts[t];
    filling_.triangles[t] = triangle;
    if (t == 0) continue;
    hole_.edge_error[triangle[0]][triangle[2]] = edge_error;
  }
  measure_.Measure(hole_, filling_);
}

// Makes the removal that is open, and tells the neighbours.
template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::Remove() {
  const uint32_t first = mesh_.triangles();
  Removal removal = mesh_.Fill(hole_, filling_.triangles);
  removal.error = filling_.error;
  removals_.push_back(removal);
  open_fans_ += std::max(removal.fans, 1u);
  measure_.HandOn(hole_, filling_, first);
  // Evaluations open other holes.
  const std::vector<uint32_t> ring = hole_.ring;
  TellNeighbours(ring);
}

template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::TellNeighbours(std::span<const uint32_t> ring) {
  for (const uint32_t near : ring) {
    const uint32_t r = mesh_.first_twin(near);
    Vertex& state = states_[r];
    if (!state.stale && !mesh_.locked(r) && state.verdict == Verdict::kLegal) queue_.PushStale(r);
    state.stale = true;
  }
  // A neighbour that was stuck may be free now.
  for (const uint32_t near : ring) {
    const uint32_t r = mesh_.first_twin(near);
    if (mesh_.locked(r) || states_[r].verdict == Verdict::kLegal) continue;
    if (HasTwins(r)) {
      if (EvaluateTwins(r)) queue_.Push(r, twins_.error);
      continue;
    }
    Evaluate(r);
    if (states_[r].verdict == Verdict::kLegal) PutBack(r);
  }
}

// Fills the holes of all twins and keeps the fillings. False when that is not legal.
template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::EvaluateTwins(uint32_t v) {
  Vertex& state = states_[v];
  state.stale = state.bounded = false;
  state.verdict = Verdict::kTopology;
  twins_.error = 0;
  twins_.corners = 0;
  twins_.new_edges.clear();
  twins_.begin = kNone32;
  patient_ = true;
  bool legal = true;
  uint32_t twin = v;
  do {
    legal = EvaluateFan(twin, state);
    twin = mesh_.twin(twin);
  } while (legal && twin != v);
  patient_ = false;
  if (legal) state.verdict = Verdict::kLegal;
  return legal;
}

template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::EvaluateFan(uint32_t twin, Vertex& state) {
  if (!mesh_.OpenHole(twin, degree_limit_, hole_) ||
      (twins_.corners += hole_.k) > kMostFanCorners) {
    state.verdict = Verdict::kDegree;
    return false;
  }
  if (!mesh_.EdgesAreFree(hole_)) return false;
  measure_.Open(hole_);
  mesh_.ForbidEdges(hole_, true);
  measured_ = false;
  if (measure_.Sees(hole_) && FillSeen(state)) {
    measure_.Measure(hole_, filling_);
  } else if (!measure_.MeasuresFolds() || !FillFolded()) {
    return false;
  }
  if (!NoteNewEdges()) return false;
  twins_.error = std::max(twins_.error, filling_.error);
  Keep(twin);
  return true;
}

// False when two sheets would make the same edge.
template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::NoteNewEdges() {
  const auto edge = [&](uint32_t i, uint32_t j) {
    return std::minmax({mesh_.first_twin(hole_.ring[i]), mesh_.first_twin(hole_.ring[j])});
  };
  const std::pair<uint32_t, uint32_t> chord = edge(0, hole_.k - 1);
  if (twins_.new_edges.empty()) twins_.new_edges.emplace_back(chord);
  // A neighbour of more fans than are told apart is another vertex in each sheet.
  if (twins_.new_edges.front() != chord) return false;
  // Of a crease that small parts have left behind, two triangles run in opposite directions: a
  // reader takes such an edge for the inside of a sheet, but for seams of textures.
  const uint32_t begin = mesh_.first_twin(hole_.ring[0]);
  if (twins_.begin == kNone32) twins_.begin = begin;
  if (twins_.begin != begin && !textured_ && mesh_.twin(mesh_.twin(hole_.vertex)) == hole_.vertex) {
    return false;
  }
  for (uint32_t t = 1; t < hole_.k - 2; ++t) {
    const std::pair<uint32_t, uint32_t> made =
        edge(filling_.triangles[t][0], filling_.triangles[t][2]);
    if (std::find(twins_.new_edges.begin(), twins_.new_edges.end(), made) != twins_.new_edges.end())
      return false;
    twins_.new_edges.push_back(made);
  }
  return true;
}

// As IsReady.
template <FillingMeasure Measure, FillingRule Rule>
bool Decimator<Measure, Rule>::AreReady(uint32_t v) {
  if (!EvaluateTwins(v)) return false;
  if (!queue_.HasCheaperThan(twins_.error)) return true;
  queue_.Push(v, twins_.error);
  return false;
}

// The fillings are those that EvaluateTwins kept.
template <FillingMeasure Measure, FillingRule Rule>
void Decimator<Measure, Rule>::RemoveTwins(uint32_t v) {
  Removal removal;
  std::vector<uint32_t> rings;
  uint32_t twin = v;
  do {
    mesh_.OpenHole(twin, degree_limit_, hole_);
    TakeKept(twin);
    const uint32_t first = mesh_.triangles();
    if (twin == v) {
      removal = mesh_.Fill(hole_, filling_.triangles);
    } else {
      mesh_.Fill(hole_, filling_.triangles, removal);
    }
    removal.error = std::max(removal.error, filling_.error);
    measure_.HandOn(hole_, filling_, first);
    rings.insert(rings.end(), hole_.ring.begin(), hole_.ring.end());
    twin = mesh_.twin(twin);
  } while (twin != v);
  removals_.push_back(removal);
  open_fans_ += std::max(removal.fans, 1u);
  TellNeighbours(rings);
}

}  // namespace mtdb::internal
