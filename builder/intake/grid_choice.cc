// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/grid_choice.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include "builder/intake/corner_gather.h"
#include "builder/intake/far_vertices.h"
#include "store/base/geometry.h"

namespace mtdb::internal {

namespace {

constexpr int kLeastBits = 16;
constexpr int kMostBits = 24;
constexpr int kBitsForSlivers = 4;   // that all triangles may ask for
constexpr int kBitsForDecimals = 4;  // likewise the coordinates' decimals
constexpr double kStepsPerEdge = 4;
constexpr uint64_t kTrianglesPerLost = 100'000;
// Corners move by half a cell's diagonal: two of them bring a triangle no more than sqrt(3) steps
// nearer to a line.
constexpr double kSafeSteps = 1.75;
constexpr double kFlatSteps = 4;  // of the finest grid, or of the coordinates' last digits
// Of the triangles that an option's grid may collapse, a chosen one may: it was not asked for.
constexpr double kMostOfChosen = 0.2;

// Lengths, with eight classes for each factor of two of their squares.
class LengthHistogram {
 public:
  LengthHistogram() : counts_(size_t{1} << kBits) {}
  void Add(double squared) {
    if (!(squared > 0)) return;
    shortest_ = std::min(shortest_, squared);
    longest_ = std::max(longest_, squared);
    ++counts_[std::bit_cast<uint64_t>(squared) >> kShift];
    ++sum_;
  }
  EdgeLengths Lengths() const {
    if (sum_ == 0) return {};
    return {std::sqrt(shortest_), Percentile(0.01), Percentile(0.5), std::sqrt(longest_)};
  }

 private:
  static constexpr int kBits = 15;  // sign, exponent, three bits of the mantissa
  static constexpr int kShift = 64 - kBits;
  double Percentile(double part) const {
    const auto below = static_cast<uint64_t>(part * static_cast<double>(sum_ - 1));
    uint64_t seen = 0;
    for (uint64_t i = 0; i < counts_.size(); ++i) {
      seen += counts_[i];
      if (seen > below) return std::sqrt(std::max(shortest_, std::bit_cast<double>(i << kShift)));
    }
    return std::sqrt(longest_);
  }
  std::vector<uint64_t> counts_;
  uint64_t sum_ = 0;
  double shortest_ = std::numeric_limits<double>::infinity();
  double longest_ = 0;
};

struct Candidate {
  Grid grid;
  int bits = 0;
  GridReason reason = GridReason::kEdges;
  bool is_exact = false;  // the positions lie on it: nothing collapses
  uint64_t collapsed = 0;
  uint64_t asking = 0;  // of the collapsed ones, those that a grid may be expected to keep
};

std::string Short(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.3g", value);
  return text;
}

double LongestSide(const Box3d& bounds) {
  const Vec3d size = bounds.max - bounds.min;
  return std::max({size.x, size.y, size.z});
}

// A sixteenth of a step; of coarse grids less, since what lies on few points may be nearly flat,
// however far these are apart. Of terrains heights are apart as no plane's bits tell. More than
// four octaves cost voxels bits.
double ErrorUnit(const BuildOptions& options, double step, int bits) {
  constexpr int kMostFiner = 4;
  const int finer = options.height_field ? 0 : std::clamp(kLeastBits - bits, 0, kMostFiner);
  return std::ldexp(step, -4 - finer);
}

Candidate OfBits(const Box3d& bounds, int bits) {
  const double longest = LongestSide(bounds);
  Candidate c;
  c.bits = bits;
  c.grid.step = longest > 0 ? longest / static_cast<double>((1u << bits) - 1) : 1.0;
  c.grid.origin = bounds.min;
  return c;
}

// Multiples of the step, so that a grid given in model units keeps its lattice.
Result<Candidate> OfStep(const Box3d& bounds, double step) {
  Candidate c;
  c.grid.step = step;
  for (int i = 0; i < 3; ++i) c.grid.origin[i] = std::floor(bounds.min[i] / step) * step;
  // The lattice may begin up to a step before the mesh.
  const double cells = LongestSide(bounds) / step;
  if (!(cells < (1 << kMostBits))) {
    return InvalidArgument("a step of " + Short(step) + ": the mesh is more than 2^24 steps long");
  }
  c.bits = static_cast<int>(std::max(1.0, std::ceil(std::log2(cells + 1))));
  return c;
}

bool OnOneLine(Vec3i a, Vec3i b, Vec3i c) {
  const Vec3<int64_t> u{int64_t{b.x} - a.x, int64_t{b.y} - a.y, int64_t{b.z} - a.z};
  const Vec3<int64_t> v{int64_t{c.x} - a.x, int64_t{c.y} - a.y, int64_t{c.z} - a.z};
  return Cross(u, v) == Vec3<int64_t>{};
}

class GridChoice {
 public:
  GridChoice(const InputMesh& input, const BuildOptions& options, MeshSurvey* survey)
      : input_(input), options_(options), survey_(*survey), bounds_(input.bounds()) {}

  Status Choose(const SpoolSpace* space, size_t memory_bytes) {
    ListCandidates();
    MTDB_RETURN_IF_ERROR(Measure(space, memory_bytes));
    survey_.edges = lengths_.Lengths();
    survey_.collapsed_at_16_bits = candidates_[0].collapsed;
    const Candidate& advised = Best();
    survey_.advised_bits = static_cast<uint8_t>(advised.bits);
    survey_.advised_step = advised.grid.step;
    const Candidate& taken = given_ && impossible_.ok() ? candidates_.back() : advised;
    survey_.grid = taken.grid;
    survey_.grid.error_unit = ErrorUnit(options_, taken.grid.step, taken.bits);
    survey_.bits = static_cast<uint8_t>(taken.bits);
    survey_.reason = given_ ? GridReason::kGiven : taken.reason;
    survey_.collapsed_triangles = taken.collapsed;
    return Judge(taken, advised);
  }

 private:
  // First the grids of 16, 17, ... bits; then those of decimals; then the one that was asked for.
  void ListCandidates() {
    for (int bits = kLeastBits; bits <= kMostBits; ++bits) {
      candidates_.push_back(OfBits(bounds_, bits));
    }
    ListDecimals();
    given_ = options_.bits || options_.step;
    if (!given_) return;
    if (!options_.step) {
      candidates_.push_back(OfBits(bounds_, options_.bits.value_or(kLeastBits)));
      return;
    }
    const Result<Candidate> given = OfStep(bounds_, *options_.step);
    impossible_ = given.status();
    if (given.ok()) candidates_.push_back(*given);
  }

  // Of the axes' units the finest comes first.
  void ListDecimals() {
    std::vector<double> units;
    bool all = true;
    for (int axis = 0; axis < 3; ++axis) {
      const std::optional<double> unit = input_.decimals().unit(axis);
      // Below the finest grid: digits of a number that is no decimal.
      const bool counts = unit && LongestSide(bounds_) / *unit < (1 << kMostBits);
      all = all && counts;
      if (counts) units.push_back(*unit);
    }
    std::sort(units.begin(), units.end());
    units.erase(std::unique(units.begin(), units.end()), units.end());
    for (size_t i = 0; i < units.size(); ++i) AddDecimals(units[i], all && i == 0);
  }

  // `is_exact`: all coordinates are multiples of the unit.
  void AddDecimals(double unit, bool is_exact) {
    for (double step = unit;; step /= 2) {
      Result<Candidate> c = OfStep(bounds_, step);
      if (!c.ok() || c->bits > kMostBits) return;
      c->reason = is_exact ? GridReason::kDecimals : GridReason::kSomeDecimals;
      c->is_exact = is_exact;
      if (is_exact || c->bits >= kLeastBits) candidates_.push_back(*c);
      if (is_exact) return;
    }
  }

  Status Measure(const SpoolSpace* space, size_t memory_bytes) {
    for (const Candidate& c : candidates_) {
      if (!c.is_exact) largest_step_ = std::max(largest_step_, c.grid.step);
    }
    thin_ = kFlatSteps * candidates_[kMostBits - kLeastBits].grid.step;
    if (input_.is_single()) {
      const double far = std::max(LargestCoordinate(bounds_.min), LargestCoordinate(bounds_.max));
      thin_ = std::max(thin_, kFlatSteps * std::ldexp(far, -24));
    }
    const CornerTable table{&input_.vertex_spool(), input_.vertices(), input_.vertex_bytes(),
                            input_.position_bytes()};
    return GatherCorners(
        input_.triangle_spool(), table, space, memory_bytes,
        [&](const std::array<uint32_t, 3>&, const std::array<const std::byte*, 3>& corners) {
          AddTriangle({input_.Position(corners[0]), input_.Position(corners[1]),
                       input_.Position(corners[2])});
          return Status::Ok();
        });
  }

  void AddTriangle(const Triangle3d& t) {
    const Vec3d ab = t[1] - t[0];
    const Vec3d ac = t[2] - t[0];
    double longest = 0;
    for (const Vec3d edge : {ab, ac, t[2] - t[1]}) {
      const double squared = SquaredLength(edge);
      lengths_.Add(squared);
      longest = std::max(longest, squared);
    }
    const double height = std::sqrt(SquaredLength(Cross(ab, ac)) / longest);
    // What the last digits of its own coordinates may be.
    const double digits = std::ldexp(
        std::max({LargestCoordinate(t[0]), LargestCoordinate(t[1]), LargestCoordinate(t[2])}),
        input_.is_single() ? -24 : -53);
    if (!(height > kFlatSteps * digits)) {
      ++survey_.flat_triangles;
      return;
    }
    if (height > kSafeSteps * largest_step_) return;
    for (Candidate& c : candidates_) {
      if (c.is_exact || height > kSafeSteps * c.grid.step) continue;
      const bool lost =
          OnOneLine(c.grid.Quantize(t[0]), c.grid.Quantize(t[1]), c.grid.Quantize(t[2]));
      c.collapsed += lost;
      c.asking += lost && height > thin_;
    }
  }
  static double LargestCoordinate(Vec3d p) {
    return std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)});
  }

  const Candidate& Best() {
    const Candidate& plain = BestOfBits();
    for (const Candidate& c : candidates_) {
      if (c.reason != GridReason::kDecimals && c.reason != GridReason::kSomeDecimals) continue;
      const bool fine = c.is_exact || c.bits >= plain.bits;
      if (fine && c.asking <= plain.asking && c.bits <= plain.bits + kBitsForDecimals) {
        return c;
      }
    }
    return plain;
  }

  const Candidate& BestOfBits() {
    const auto of_bits = [&](int bits) -> Candidate& {
      return candidates_[static_cast<size_t>(bits - kLeastBits)];
    };
    const double step = lengths_.Lengths().percentile1 / kStepsPerEdge;
    int least = kLeastBits;
    while (least < kMostBits && of_bits(least).grid.step > step) ++least;
    of_bits(least).reason = least == kLeastBits ? GridReason::kLeastBits : GridReason::kEdges;
    int best = least;
    for (int bits = least; bits <= kMostBits; ++bits) {
      const uint64_t lost = of_bits(bits).asking;
      if (lost < of_bits(best).asking) best = bits;
      const bool few = bits > least + kBitsForSlivers &&
                       of_bits(best).asking <= input_.triangles() / kTrianglesPerLost;
      if (of_bits(best).asking == 0 || few) break;
    }
    if (best != least) of_bits(best).reason = GridReason::kSlivers;
    return of_bits(best);
  }

  bool IsFine(const Candidate& c) const {
    return c.is_exact || c.grid.step <= survey_.edges.percentile1 / kStepsPerEdge;
  }

  // Whether the grid is refused, and what lies far off where it is too coarse for the mesh.
  Status Judge(const Candidate& taken, const Candidate& advised) {
    const uint64_t solid = input_.triangles() - survey_.flat_triangles;
    const double most = static_cast<double>(solid) * options_.max_collapsed;
    const double most_of_chosen = options_.max_collapsed < 1 ? kMostOfChosen * most : most;
    const auto lost = [](const Candidate& c) { return static_cast<double>(c.collapsed); };
    const bool suits = IsFine(advised) && lost(advised) <= most_of_chosen;
    const bool refused = !impossible_.ok() || lost(taken) > (given_ ? most : most_of_chosen);
    if (refused || taken.collapsed != 0) {
      MTDB_ASSIGN_OR_RETURN(survey_.fits_float32, input_.FitsSingle());
    }
    if (refused ? !suits || !options_.step || !impossible_.ok() : !given_ && !suits) {
      MTDB_ASSIGN_OR_RETURN(survey_.far_vertices, FindFarVertices(input_, [&](const Box3d& box) {
                              if (!impossible_.ok()) return OfStep(box, *options_.step).ok();
                              const int bits = given_ && suits ? taken.bits : kMostBits;
                              return std::ldexp(LongestSide(box), -bits) <=
                                     survey_.edges.median / kStepsPerEdge;
                            }));
    }
    if (!refused) return Status::Ok();
    const bool insists = !given_ && lost(taken) <= most;
    survey_.refusal = given_ ? InvalidArgument(RefusalText(taken, solid, suits, false))
                             : BadInput(RefusalText(taken, solid, suits, insists));
    return Status::Ok();
  }

  // `suits`: a grid would that none asked for. `insists`: --bits 24 would be taken.
  std::string RefusalText(const Candidate& taken, uint64_t solid, bool suits, bool insists) const {
    const std::optional<FarVertices>& far = survey_.far_vertices;
    std::string text = impossible_.message();
    if (impossible_.ok()) {
      text = "a step of " + Short(taken.grid.step) + " leaves no area to " +
             std::to_string(taken.collapsed) + " of " + std::to_string(solid) +
             " triangles: the mesh is " + Short(LongestSide(bounds_)) +
             " long, and half of its edges are shorter than " + Short(survey_.edges.median);
    }
    if (far) text += "; " + FarVerticesText(*far);
    std::vector<std::string> ways;
    if (far) {
      const bool few = far->count < far->vertices / 10;
      ways.push_back(far->count == 1 ? "cut it away"
                     : few           ? "cut them away"
                                     : "ingest them as an object of their own");
    }
    if (given_ && suits) {
      ways.push_back("choose " + std::string(impossible_.ok() ? "a smaller" : "a larger") +
                     " step, or none: " + std::to_string(survey_.advised_bits) +
                     " bits, a step of " + Short(survey_.advised_step) + ", suit it");
    }
    if (survey_.fits_float32) ways.push_back("store it --lossless");
    if (insists) ways.push_back("say --bits 24 to lose their area");
    if (ways.empty()) ways.push_back("ingest its parts as objects of their own");
    for (size_t i = 0; i < ways.size(); ++i) text += (i == 0 ? "; " : "; or ") + ways[i];
    return text;
  }

  const InputMesh& input_;
  const BuildOptions& options_;
  MeshSurvey& survey_;
  const Box3d bounds_;
  std::vector<Candidate> candidates_;
  bool given_ = false;
  Status impossible_;  // of the step that was asked for
  double largest_step_ = 0;
  double thin_ = 0;  // triangles that are no higher ask for nothing
  LengthHistogram lengths_;
};

// Fitted to scans, sculptures and terrains, which it meets within some 15 %: a vertex takes 38.3
// bits where half of the edges are longer than 2^8.5 steps, and 2 to 3 more for each factor of two.
uint64_t EstimateStoreBytes(const MeshSurvey& survey) {
  constexpr double kUsualEdge = 8.5;  // log2 of steps
  constexpr double kBits = 38.3;
  constexpr double kLosslessBits = 76;
  double bits = kLosslessBits;
  if (survey.grid.mode == PositionMode::kGrid) {
    const double steps = std::max(1.0, survey.edges.median / survey.grid.step);
    const double beyond = std::log2(steps) - kUsualEdge;
    bits = kBits + 2.6 * beyond + 0.06 * beyond * beyond;
  }
  for (const VertexAttribute& a : survey.header.attributes.attributes) {
    const bool is_float = a.type == ScalarType::kFloat32 || a.type == ScalarType::kFloat64;
    if (a.normal_bits > 0) {
      bits += 1.4 * a.normal_bits;  // for all three
    } else if (a.step > 0) {
      bits += 10;
    } else {
      bits += (is_float ? 0.72 : 0.25) * 8 * static_cast<double>(ScalarSize(a.type));
    }
  }
  return static_cast<uint64_t>(bits / 8 * static_cast<double>(survey.vertices));
}

}  // namespace

Status ChooseGrid(const InputMesh& input, const BuildOptions& options, const SpoolSpace* space,
                  size_t memory_bytes, MeshSurvey* survey) {
  if (options.mode == PositionMode::kLossless) {
    survey->grid.mode = options.mode;
    survey->grid.error_unit = std::max(Diagonal(input.bounds()), 1e-30) * std::ldexp(1.0, -29);
    survey->bits = 32;
  } else {
    MTDB_RETURN_IF_ERROR(GridChoice(input, options, survey).Choose(space, memory_bytes));
  }
  survey->store_bytes = EstimateStoreBytes(*survey);
  return Status::Ok();
}

}  // namespace mtdb::internal
