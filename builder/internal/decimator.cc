#include "builder/internal/decimator.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>

namespace mtdb {

namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr float kNotQueued = -1;
constexpr double kFirstGuess = 0.4;    // of a vertex's error, by its height over its neighbours
constexpr double kStaleGrowth = 1.08;  // of a stale error, until it is evaluated again
// How well a triangle is shaped: its squared area over the square of its summed squared edges, 1
// for an equilateral one.
double Shape(Vec3d a, Vec3d b, Vec3d c, Vec3d cross) {
  const double edges = SquaredLength(b - a) + SquaredLength(c - b) + SquaredLength(a - c);
  return edges > 0 ? 12 * SquaredLength(cross) / (edges * edges) : 0;
}
}  // namespace

void Decimator::Load(std::span<const TileTriangle> tile, const Grid& grid) {
  const auto n = static_cast<uint32_t>(tile.size());
  result_ = TileResult{};
  vertices_.clear();
  grid_positions_.clear();
  corners_.resize(n);
  errors_.resize(n);
  border_.resize(n);
  // Local vertices in order of first use.
  const size_t capacity = std::bit_ceil(6 * static_cast<size_t>(n) + 2);
  std::vector<std::pair<uint32_t, uint32_t>> table(capacity, {kNone32, 0});
  fixed_.clear();
  for (uint32_t t = 0; t < n; ++t) {
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t v = tile[t].vertices[c];
      size_t i = (v * 0x9e3779b97f4a7c15ull >> 24) & (capacity - 1);
      while (table[i].first != kNone32 && table[i].first != v) i = (i + 1) & (capacity - 1);
      if (table[i].first == kNone32) {
        table[i] = {v, static_cast<uint32_t>(vertices_.size())};
        vertices_.push_back(v);
        grid_positions_.push_back(tile[t].positions[c]);
        fixed_.push_back(0);
        result_.first_corner.push_back(3 * t + static_cast<uint32_t>(c));
      }
      corners_[t][c] = table[i].second;
      fixed_[table[i].second] |= tile[t].fixed_corners >> c & 1;
    }
    errors_[t] = tile[t].error;
    border_[t] = tile[t].border_edges;
  }
  const auto vertex_count = static_cast<uint32_t>(vertices_.size());
  positions_.resize(vertex_count);
  // Work units: grid steps, or model units when lossless.
  for (uint32_t v = 0; v < vertex_count; ++v) {
    positions_[v] = grid.mode == PositionMode::kGrid ? ToDouble(grid_positions_[v])
                                                     : grid.Position(grid_positions_[v]);
  }
  round_.Build(corners_, positions_, errors_);

  opposite_.resize(3 * n);
  curve_error_.resize(3 * n);
  chain_head_.assign(3 * n, kNone32);
  half_edge_.assign(vertex_count, kNone32);
  locked_ = fixed_;
  on_border_.assign(vertex_count, 0);
  for (uint32_t h = 0; h < 3 * n; ++h) {
    const uint32_t o = round_.opposite(h);
    opposite_[h] = o;
    curve_error_[h] = errors_[h / 3];
    if (o != kNone32) {
      curve_error_[h] = std::max<double>(curve_error_[h], errors_[o / 3]);
    }
    const uint32_t a = Origin(h);
    const uint32_t b = Origin(Next(h));
    if (o == kNone32) {
      if (IsBorderEdge(h)) {
        on_border_[a] = on_border_[b] = 1;
        half_edge_[a] = h;
      } else {
        locked_[a] = locked_[b] = 1;
      }
    }
    if (half_edge_[a] == kNone32) half_edge_[a] = h;
  }
  alive_.assign(n, 1);
  tainted_.assign(n, 0);
  sample_head_.assign(n, kNone32);
  removed_.assign(vertex_count, 0);
  dirty_.assign(vertex_count, 0);
  next_sample_.assign(vertex_count, kNone32);
  verdict_.assign(vertex_count, Verdict::kLegal);
  last_error_.assign(vertex_count, 0);
  careful_.assign(vertex_count, 0);
  kept_.resize(vertex_count);
  ring_mark_.assign(vertex_count, 0);
  heap_.clear();
  live_triangles_ = n;
}

bool Decimator::CollectRing(uint32_t v) {
  ring_.clear();
  star_.clear();
  ring_edges_.clear();
  const uint32_t first = half_edge_[v];
  uint32_t h = first;
  do {
    if (ring_.size() >= options_.degree_limit) return false;
    ring_.push_back(Origin(Next(h)));
    star_.push_back(h / 3);
    ring_edges_.push_back(Next(h));
    const uint32_t last = Previous(h);
    h = opposite_[last];
    if (h == kNone32) {  // the far end of a border vertex's fan
      if (ring_.size() >= options_.degree_limit) return false;
      ring_.push_back(Origin(last));
      break;
    }
  } while (h != first);
  return true;
}

void Decimator::MarkForbiddenEdges(bool existing) {
  const auto k = static_cast<uint32_t>(ring_.size());
  for (uint32_t i = 0; i < k; ++i) {
    for (uint32_t j = 0; j < k; ++j) {
      hole_.forbidden[i][j] = locked_[ring_[i]] && locked_[ring_[j]];
    }
  }
  if (!existing) return;
  // Every edge with an unlocked end is in the fan of that end, which is whole.
  for (uint32_t i = 0; i < k; ++i) ring_mark_[ring_[i]] = i + 1;
  for (uint32_t i = 0; i < k; ++i) {
    if (locked_[ring_[i]]) continue;
    const uint32_t first = half_edge_[ring_[i]];
    uint32_t h = first;
    do {
      if (const uint32_t j = ring_mark_[Origin(Next(h))]; j != 0) {
        hole_.forbidden[i][j - 1] = hole_.forbidden[j - 1][i] = 1;
      }
      const uint32_t last = Previous(h);
      h = opposite_[last];
      if (h == kNone32) {
        if (const uint32_t j = ring_mark_[Origin(last)]; j != 0) {
          hole_.forbidden[i][j - 1] = hole_.forbidden[j - 1][i] = 1;
        }
      }
    } while (h != first && h != kNone32);
  }
  for (uint32_t i = 0; i < k; ++i) ring_mark_[ring_[i]] = 0;
}

bool Decimator::AreAdjacent(uint32_t unlocked, uint32_t other) const {
  const uint32_t first = half_edge_[unlocked];
  uint32_t h = first;
  do {
    if (Origin(Next(h)) == other) return true;
    const uint32_t last = Previous(h);
    h = opposite_[last];
    if (h == kNone32) return Origin(last) == other;
  } while (h != first);
  return false;
}

bool Decimator::UsesExistingEdge(const Plan& plan) const {
  for (uint32_t t = 1; t < plan.k - 2; ++t) {
    const uint32_t a = ring_[plan.triangles[t][0]];
    const uint32_t b = ring_[plan.triangles[t][2]];
    if (locked_[a] ? AreAdjacent(b, a) : AreAdjacent(a, b)) return true;
  }
  return false;
}

double Decimator::BorderCurveError(uint32_t v, uint32_t from, uint32_t to) const {
  // The curve of the border edge that replaces from-v-to is the chain of border vertices removed
  // between them; the accumulated error along it is that of the vertices on it.
  const Vec3d a = positions_[from];
  const Vec3d b = positions_[to];
  double error = 0;
  const auto add = [&](uint32_t w) {
    error = std::max(error, std::sqrt(SquaredDistancePointSegment(positions_[w], a, b)) +
                                round_.vertex_error(w));
  };
  add(v);
  const uint32_t out = half_edge_[v];  // v -> ring[0]
  for (uint32_t w = chain_head_[out]; w != kNone32; w = next_sample_[w]) add(w);
  uint32_t in = Previous(out);  // walk to the last half-edge of the fan: ring[k-1] -> v
  while (opposite_[in] != kNone32) in = Previous(opposite_[in]);
  for (uint32_t w = chain_head_[in]; w != kNone32; w = next_sample_[w]) add(w);
  return error;
}

bool Decimator::EvaluateByOverlay(uint32_t v, Vec3d n, Plan& plan) {
  bool fresh = !plan.boundary && samples_.size() == 1;  // v's star is of the round's input
  for (const uint32_t t : star_) {
    if (tainted_[t]) return false;
    fresh &= t < round_.triangle_count();
  }
  for (const uint32_t w : samples_) {
    if (!round_.Faces(w, n)) return false;
  }
  if (plan.boundary && !round_.Faces(v, n)) return false;
  hole_.SetShapeCosts(shape_weight_);
  const auto measure = [&](uint32_t i, uint32_t j) {
    hole_.edge_error[i][j] = round_.CurveError(ring_[i], ring_[j], n);
  };
  if (fresh) {
    const uint32_t k = plan.k;
    std::array<double, kMaxDegree> spoke_error;
    for (uint32_t m = 0; m < k; ++m) {
      spoke_error[m] = std::max(errors_[star_[m]], errors_[star_[m == 0 ? k - 1 : m - 1]]);
    }
    hole_.MeasureEdgeErrors(frame_samples_[0], spoke_error);
    hole_.ForEachDiagonal([&](uint32_t i, uint32_t j) {
      if (hole_.edge_error[i][j] == HoleTriangulation::kUnknown) measure(i, j);
    });
    if (!hole_.Find(plan.triangles)) return false;
  } else {
    // Curves are dear: the triangulation is chosen by guesses of its edges' errors, and only the
    // curves of the edges that it uses are found. Where one of them has none, all are.
    hole_.GuessEdgeErrors(frame_samples_);
    if (!hole_.Find(plan.triangles)) return false;
    bool usable = true;
    for (uint32_t t = 1; t < plan.k - 2; ++t) {
      const auto [i, m, j] = plan.triangles[t];
      measure(i, j);
      usable &= hole_.edge_error[i][j] >= 0;
    }
    if (!usable) {
      hole_.ForEachDiagonal(measure);
      if (!hole_.Find(plan.triangles)) return false;
    }
  }
  MeasureByOverlay(plan);
  return true;
}

void Decimator::MeasureByOverlay(Plan& plan) {
  const uint32_t k = plan.k;
  const uint32_t count = k - 2;
  const auto curve = [&](uint32_t a, uint32_t b) {  // a < b, ring positions
    if (b == a + 1) return curve_error_[ring_edges_[a]];
    if (a == 0 && b == k - 1 && !plan.boundary) return curve_error_[ring_edges_[b]];
    return hole_.edge_error[a][b];
  };
  for (uint32_t t = 0; t < count; ++t) {
    const auto [i, m, j] = plan.triangles[t];
    plan.errors[t] = std::max({curve(i, m), curve(m, j), curve(i, j)});
  }
  // Each sample goes to the triangle in whose projection it lies, from the first triangle across
  // diagonals. The triangles form a tree, listed from its root, so that this ends.
  sample_triangle_.resize(samples_.size());
  for (size_t s = 0; s < samples_.size(); ++s) {
    const Vec3d p = frame_samples_[s];
    uint32_t t = 0;
    for (;;) {
      const auto [i, m, j] = plan.triangles[t];
      const auto beyond = [&](uint32_t a, uint32_t b) {
        return b >= a + 2 && hole_.IsRightOf(p, a, b);
      };
      const bool first = beyond(i, m);
      const bool second = !first && beyond(m, j);
      if (!first && !second) break;
      const uint32_t from = first ? i : m;
      const uint32_t to = first ? m : j;
      do {
        ++t;
      } while (plan.triangles[t][0] != from || plan.triangles[t][2] != to);
    }
    sample_triangle_[s] = static_cast<uint8_t>(t);
    const auto [i, m, j] = plan.triangles[t];
    const double distance =
        std::sqrt(SquaredDistancePointTriangle(p, hole_.ring[i], hole_.ring[m], hole_.ring[j]));
    plan.errors[t] = std::max(plan.errors[t], distance + round_.vertex_error(samples_[s]));
  }
  plan.error = 0;
  for (uint32_t t = 0; t < count; ++t) plan.error = std::max(plan.error, plan.errors[t]);
  plan.conservative = false;
}

bool Decimator::EvaluateConservatively(uint32_t v, Vec3d n, Plan& plan) {
  const uint32_t k = plan.k;
  double size2 = 0;
  for (uint32_t i = 0; i < k; ++i) {
    size2 = std::max(size2, SquaredLength(positions_[ring_[i]] - positions_[v]));
  }
  hole_.ForEachDiagonal([&](uint32_t i, uint32_t j) { hole_.edge_error[i][j] = 0; });
  const Vec3d pv = positions_[v];
  hole_.SetCosts([&](uint32_t i, uint32_t m, uint32_t j) {
    const Vec3d a = positions_[ring_[i]];
    const Vec3d b = positions_[ring_[m]];
    const Vec3d c = positions_[ring_[j]];
    const Vec3d cross = Cross(b - a, c - a);
    // A triangle turned away is a last resort.
    const double turned = Dot(cross, n) > 0 ? 0 : 1e6;
    return size2 * (1 - Shape(a, b, c, cross) + turned) + SquaredDistancePointTriangle(pv, a, b, c);
  });
  if (!hole_.Find(plan.triangles)) return false;

  // Star and hole by correspondence: v goes to its nearest triangle of the hole; a diagonal is
  // crossed by the spokes to the ring vertices on its far side.
  const uint32_t count = k - 2;
  double nearest = kInfinity;
  uint32_t home = 0;
  if (plan.boundary) {  // v goes to the new border edge, which is triangle 0's
    nearest = SquaredDistancePointSegment(pv, positions_[ring_[0]], positions_[ring_[k - 1]]);
  }
  for (uint32_t t = 0; t < count && !plan.boundary; ++t) {
    const auto [i, m, j] = plan.triangles[t];
    const double d = SquaredDistancePointTriangle(pv, positions_[ring_[i]], positions_[ring_[m]],
                                                  positions_[ring_[j]]);
    if (d < nearest) {
      nearest = d;
      home = t;
    }
  }
  double delta2 = nearest;
  const auto [hi, hm, hj] = plan.triangles[home];
  for (uint32_t t = 1; t < count; ++t) {  // triangle t hangs on the diagonal (i, j)
    const auto [i, m, j] = plan.triangles[t];
    const bool home_between = hi >= i && hj <= j;  // the ring positions i..j hold the home triangle
    for (uint32_t r = 0; r < k; ++r) {
      const bool between = r > i && r < j;
      if (r == i || r == j || between == home_between) continue;
      delta2 = std::max(
          delta2, SquaredDistanceSegmentSegment(pv, positions_[ring_[r]], positions_[ring_[i]],
                                                positions_[ring_[j]]));
    }
  }
  double star_error = 0;
  for (const uint32_t t : star_) {
    star_error = std::max<double>(star_error, errors_[t]);
    for (uint32_t c = 0; c < 3; ++c) star_error = std::max(star_error, curve_error_[3 * t + c]);
  }
  plan.error = std::sqrt(delta2) + star_error;
  if (plan.boundary) plan.error = std::max(plan.error, hole_.edge_error[0][k - 1]);
  plan.errors.fill(plan.error);
  sample_triangle_.resize(samples_.size());
  for (size_t s = 0; s < samples_.size(); ++s) {
    double least = kInfinity;
    for (uint32_t t = 0; t < count; ++t) {
      const auto [i, m, j] = plan.triangles[t];
      const double d = SquaredDistancePointTriangle(positions_[samples_[s]], positions_[ring_[i]],
                                                    positions_[ring_[m]], positions_[ring_[j]]);
      if (d < least) {
        least = d;
        sample_triangle_[s] = static_cast<uint8_t>(t);
      }
    }
  }
  plan.conservative = true;
  return true;
}

Decimator::Verdict Decimator::Evaluate(uint32_t v, Plan& plan) {
  if (!CollectRing(v)) return Verdict::kDegree;
  const auto k = static_cast<uint32_t>(ring_.size());
  plan.k = k;
  plan.boundary = on_border_[v];
  if (k < 3) return Verdict::kTopology;
  if (!EdgesAreFree(plan.boundary)) return Verdict::kTopology;
  if (plan.boundary) hole_.edge_error[0][k - 1] = BorderCurveError(v, ring_[k - 1], ring_[0]);
  const Vec3d normal = CollectSamples(v, plan.boundary);
  const double length = Length(normal);
  const Vec3d n = length > 0 ? normal * (1 / length) : Vec3d{0, 0, 1};
  SetFrame(plan, n);
  // How far v stands out of its ring: the scale at which shapes may matter.
  double height = 0;
  for (const uint32_t r : ring_) height += Dot(positions_[r] - positions_[v], n);
  shape_weight_ = 0.05 * height * height / (k * k) + 1e-9 * length;
  MarkForbiddenEdges(careful_[v]);
  if (!(length > 0 && EvaluateByOverlay(v, n, plan)) && !EvaluateConservatively(v, n, plan)) {
    return Verdict::kTopology;
  }
  Keep(v, plan);
  return Verdict::kLegal;
}

Vec3d Decimator::CollectSamples(uint32_t v, bool boundary) {
  samples_.clear();
  Vec3d normal{};
  for (const uint32_t t : star_) {
    for (uint32_t w = sample_head_[t]; w != kNone32; w = next_sample_[w]) samples_.push_back(w);
    normal += Cross(positions_[corners_[t][1]] - positions_[corners_[t][0]],
                    positions_[corners_[t][2]] - positions_[corners_[t][0]]);
  }
  if (!boundary) samples_.push_back(v);
  return normal;
}

void Decimator::SetFrame(const Plan& plan, Vec3d n) {
  hole_.k = plan.k;
  hole_.boundary = plan.boundary;
  const Vec3d across = std::abs(n.x) < 0.6 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
  const Vec3d y = Cross(n, across);
  const Vec3d e2 = y * (1 / Length(y));
  const Vec3d e1 = Cross(e2, n);
  const Vec3d origin = positions_[ring_[0]];
  const auto in_frame = [&](uint32_t v) {
    const Vec3d p = positions_[v] - origin;
    return Vec3d{Dot(p, e1), Dot(p, e2), Dot(p, n)};
  };
  for (uint32_t i = 0; i < plan.k; ++i) hole_.ring[i] = in_frame(ring_[i]);
  frame_samples_.clear();
  for (const uint32_t w : samples_) frame_samples_.push_back(in_frame(w));
}

void Decimator::Keep(uint32_t v, const Plan& plan) {
  KeptPlan& kept = kept_[v];
  kept.valid = !plan.conservative;
  if (!kept.valid) return;
  for (uint32_t t = 0; t < plan.k - 2; ++t) {
    kept.triangles[t] = plan.triangles[t];
    if (t > 0) kept.edge_errors[t] = hole_.edge_error[plan.triangles[t][0]][plan.triangles[t][2]];
  }
}

bool Decimator::Recall(uint32_t v, Plan& plan) {
  CollectRing(v);
  const KeptPlan& kept = kept_[v];
  plan.k = static_cast<uint32_t>(ring_.size());
  plan.boundary = on_border_[v];
  for (uint32_t t = 0; t < plan.k - 2; ++t) {
    plan.triangles[t] = kept.triangles[t];
    if (t > 0) hole_.edge_error[plan.triangles[t][0]][plan.triangles[t][2]] = kept.edge_errors[t];
  }
  // A removal elsewhere may have joined two vertices of the ring since.
  if (!EdgesAreFree(plan.boundary)) return false;
  if (plan.boundary)
    hole_.edge_error[0][plan.k - 1] = BorderCurveError(v, ring_[plan.k - 1], ring_[0]);
  const Vec3d normal = CollectSamples(v, plan.boundary);
  SetFrame(plan, normal * (1 / Length(normal)));
  MeasureByOverlay(plan);
  return true;
}

bool Decimator::EdgesAreFree(bool boundary) const {
  const auto k = static_cast<uint32_t>(ring_.size());
  if (boundary) {
    const uint32_t a = ring_[0];
    const uint32_t b = ring_[k - 1];
    return locked_[a] ? !locked_[b] && !AreAdjacent(b, a) : !AreAdjacent(a, b);
  }
  if (k > 3) return true;
  if (locked_[ring_[0]] && locked_[ring_[1]] && locked_[ring_[2]]) return false;
  for (uint32_t i = 0; i < 3; ++i) {
    const uint32_t o = opposite_[ring_edges_[i]];
    if (o != kNone32 && Origin(Previous(o)) == ring_[(i + 2) % 3]) return false;
  }
  return true;
}

void Decimator::Push(uint32_t v, double error) {
  last_error_[v] = static_cast<float>(error);
  heap_.push_back(HeapKey(v));
  std::push_heap(heap_.begin(), heap_.end(), std::greater<>());
}

void Decimator::Commit(uint32_t v, const Plan& plan) {
  const uint32_t k = plan.k;
  const uint32_t count = k - 2;
  const auto first = static_cast<uint32_t>(corners_.size());
  Removal removal;
  removal.vertex = v;
  removal.boundary = plan.boundary;
  removal.error = plan.error;
  removal.star_begin = static_cast<uint32_t>(result_.stars.size());
  removal.star_count = static_cast<uint32_t>(star_.size());
  removal.hole_begin = static_cast<uint32_t>(result_.holes.size());
  removal.hole_count = count;

  bool tainted = plan.conservative;
  for (const uint32_t t : star_) {
    tainted |= tainted_[t] != 0;
    alive_[t] = 0;
    result_.stars.push_back(t);
  }
  uint32_t new_chain = kNone32;
  if (plan.boundary) {
    // Chain of the new border edge: both old chains and v.
    const uint32_t out = half_edge_[v];
    uint32_t in = Previous(out);
    while (opposite_[in] != kNone32) in = Previous(opposite_[in]);
    new_chain = v;
    next_sample_[v] = chain_head_[out];
    uint32_t tail = v;
    while (next_sample_[tail] != kNone32) tail = next_sample_[tail];
    next_sample_[tail] = chain_head_[in];
  }

  corners_.resize(first + count);
  errors_.resize(first + count);
  border_.resize(first + count, 0);
  alive_.resize(first + count, 1);
  tainted_.resize(first + count, tainted);
  sample_head_.resize(first + count, kNone32);
  opposite_.resize(3 * (first + count), kNone32);
  curve_error_.resize(3 * (first + count), 0);
  chain_head_.resize(3 * (first + count), kNone32);
  // Diagonals meet when both of their triangles are made.
  std::array<std::array<uint32_t, kMaxDegree>, kMaxDegree> open;
  for (uint32_t t = 0; t < count; ++t) {
    const auto [i, m, j] = plan.triangles[t];
    const uint32_t id = first + t;
    corners_[id] = {ring_[i], ring_[m], ring_[j]};
    errors_[id] =
        std::nextafter(static_cast<float>(plan.errors[t]), std::numeric_limits<float>::infinity());
    result_.holes.push_back(id);
    const std::array<std::pair<uint32_t, uint32_t>, 3> edges = {
        std::pair<uint32_t, uint32_t>{i, m}, {m, j}, {j, i}};
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [a, b] = edges[c];
      const uint32_t h = 3 * id + c;
      if (b == a + 1 || (!plan.boundary && a == k - 1 && b == 0)) {
        // Ring edge a -> b: takes over what the star's half-edge had.
        const uint32_t old = ring_edges_[a];
        opposite_[h] = opposite_[old];
        if (opposite_[h] != kNone32) opposite_[opposite_[h]] = h;
        curve_error_[h] = curve_error_[old];
        chain_head_[h] = chain_head_[old];
        border_[id] |= static_cast<uint8_t>(IsBorderEdge(old) << c);
      } else if (a == k - 1 && b == 0) {
        // The new border edge.
        curve_error_[h] = hole_.edge_error[0][k - 1];
        chain_head_[h] = new_chain;
        border_[id] |= static_cast<uint8_t>(1 << c);
      } else {
        const uint32_t lo = std::min(a, b);
        const uint32_t hi = std::max(a, b);
        curve_error_[h] = plan.conservative ? plan.error : hole_.edge_error[lo][hi];
        (a > b ? open[lo][hi] : open[hi][lo]) = h;
      }
    }
  }
  // Pair the diagonals: (i, j) of a triangle runs j -> i; its parent has it as i -> j.
  for (uint32_t t = 1; t < count; ++t) {
    const auto [i, m, j] = plan.triangles[t];
    const uint32_t down = open[i][j];  // j -> i
    const uint32_t up = open[j][i];    // i -> j
    opposite_[down] = up;
    opposite_[up] = down;
  }
  // Outgoing half-edges of the ring; a border vertex keeps the one on the border.
  for (uint32_t t = 0; t < count; ++t) {
    for (uint32_t c = 0; c < 3; ++c) {
      const uint32_t a = corners_[first + t][c];
      if (!alive_[half_edge_[a] / 3]) half_edge_[a] = 3 * (first + t) + c;
    }
  }
  for (uint32_t t = 0; t < count; ++t) {
    for (uint32_t c = 0; c < 3; ++c) {
      const uint32_t h = 3 * (first + t) + c;
      if (opposite_[h] == kNone32) half_edge_[Origin(h)] = h;
    }
  }
  for (size_t s = 0; s < samples_.size(); ++s) {
    const uint32_t id = first + sample_triangle_[s];
    next_sample_[samples_[s]] = sample_head_[id];
    sample_head_[id] = samples_[s];
  }
  removed_[v] = 1;
  // The ring's errors are stale now, and mostly larger than they were: a guess keeps vertices from
  // being evaluated long before their turn.
  for (const uint32_t r : ring_) {
    if (!dirty_[r] && !locked_[r] && verdict_[r] == Verdict::kLegal) {
      Push(r, kStaleGrowth * last_error_[r]);
    }
    dirty_[r] = 1;
  }
  live_triangles_ -= static_cast<uint32_t>(star_.size()) - count;
  result_.removals.push_back(removal);
}

TileResult Decimator::Decimate(std::span<const TileTriangle> tile, const Grid& grid,
                               const DecimateOptions& options) {
  options_ = options;
  options_.degree_limit = std::min(options.degree_limit, kMaxDegree);
  Load(tile, grid);
  const auto vertex_count = static_cast<uint32_t>(vertices_.size());
  Plan plan;
  // Vertices are evaluated when their turn comes; a guess that is mostly low decides when.
  for (uint32_t v = 0; v < vertex_count; ++v) {
    if (locked_[v]) {
      ++result_.locked_vertices;
      continue;
    }
    dirty_[v] = 1;
    Push(v, kFirstGuess * round_.Height(v) + round_.vertex_error(v));
  }
  while (live_triangles_ > options_.target_triangles && !heap_.empty()) {
    std::pop_heap(heap_.begin(), heap_.end(), std::greater<>());
    const uint64_t top = heap_.back();
    heap_.pop_back();
    const auto v = static_cast<uint32_t>(top);
    if (removed_[v] || top != HeapKey(v)) continue;
    last_error_[v] = kNotQueued;  // an older entry may be the same
    if (dirty_[v] || !kept_[v].valid || !Recall(v, plan)) {
      verdict_[v] = Evaluate(v, plan);
      const bool was_dirty = dirty_[v];
      dirty_[v] = 0;
      if (verdict_[v] != Verdict::kLegal) continue;
      if (was_dirty && !heap_.empty() &&
          static_cast<float>(plan.error) > HeapError(heap_.front())) {
        Push(v, plan.error);
        continue;
      }
    }
    if (plan.error > options_.largest_error) continue;
    if (UsesExistingEdge(plan)) {
      // Rare, and found out here only: plan again without the edges that exist.
      careful_[v] = 1;
      verdict_[v] = Evaluate(v, plan);
      if (verdict_[v] == Verdict::kLegal) Push(v, plan.error);
      continue;
    }
    Commit(v, plan);
    // A neighbour that was stuck may be free now.
    for (const uint32_t r : std::vector<uint32_t>(ring_)) {
      if (locked_[r] || verdict_[r] == Verdict::kLegal) continue;
      Plan retry;
      verdict_[r] = Evaluate(r, retry);
      dirty_[r] = 0;
      if (verdict_[r] == Verdict::kLegal) Push(r, retry.error);
    }
  }
  for (uint32_t v = 0; v < vertex_count; ++v) {
    if (removed_[v] || locked_[v]) continue;
    result_.stuck_topology += verdict_[v] == Verdict::kTopology;
    result_.stuck_degree += verdict_[v] == Verdict::kDegree;
  }
  result_.vertices = vertices_;
  result_.positions = grid_positions_;
  result_.triangles = corners_;
  result_.errors = errors_;
  result_.border_edges = border_;
  result_.alive = alive_;
  result_.fixed = fixed_;
  return std::move(result_);
}

}  // namespace mtdb
