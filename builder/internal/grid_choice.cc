// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/grid_choice.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include "builder/internal/corner_gather.h"
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
constexpr double kFlatSteps = 4;  // of the finest grid

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
};

double LongestSide(const Box3d& bounds) {
  const Vec3d size = bounds.max - bounds.min;
  return std::max({size.x, size.y, size.z});
}

Candidate OfBits(const Box3d& bounds, int bits) {
  const double longest = LongestSide(bounds);
  Candidate c;
  c.bits = bits;
  c.grid.step = longest > 0 ? longest / static_cast<double>((1u << bits) - 1) : 1.0;
  c.grid.origin = bounds.min;
  c.grid.error_unit = c.grid.step / 16;
  return c;
}

// Multiples of the step, so that a grid given in model units keeps its lattice.
Result<Candidate> OfStep(const Box3d& bounds, double step) {
  Candidate c;
  c.grid.step = step;
  c.grid.error_unit = step / 16;
  for (int i = 0; i < 3; ++i) c.grid.origin[i] = std::floor(bounds.min[i] / step) * step;
  // The lattice may begin up to a step before the mesh.
  const double cells = LongestSide(bounds) / step;
  if (!(cells < (1 << kMostBits))) {
    return InvalidArgument(
        "--step: the mesh is more than 2^24 steps long; choose a larger step, or "
        "store it --lossless");
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
  GridChoice(const InputSpool& input, const BuildOptions& options, MeshSurvey* survey)
      : input_(input), options_(options), survey_(*survey), bounds_(input.bounds()) {}

  Status Choose(const SpoolSpace* space, size_t memory_bytes) {
    MTDB_RETURN_IF_ERROR(ListCandidates());
    MTDB_RETURN_IF_ERROR(Measure(space, memory_bytes));
    survey_.edges = lengths_.Lengths();
    survey_.collapsed_at_16_bits = candidates_[0].collapsed;
    const Candidate& advised = Best();
    survey_.advised_bits = static_cast<uint8_t>(advised.bits);
    survey_.advised_step = advised.grid.step;
    const Candidate& taken = given_ ? candidates_.back() : advised;
    survey_.grid = taken.grid;
    survey_.bits = static_cast<uint8_t>(taken.bits);
    survey_.reason = given_ ? GridReason::kGiven : taken.reason;
    survey_.collapsed_triangles = taken.collapsed;
    return given_ ? CheckGiven(taken) : Status::Ok();
  }

 private:
  // First the grids of 16, 17, ... bits; then those of decimals; then the one that was asked for.
  Status ListCandidates() {
    for (int bits = kLeastBits; bits <= kMostBits; ++bits) {
      candidates_.push_back(OfBits(bounds_, bits));
    }
    ListDecimals();
    given_ = options_.bits || options_.step;
    if (!given_) return Status::Ok();
    Candidate given = OfBits(bounds_, options_.bits.value_or(kLeastBits));
    if (options_.step) {
      MTDB_ASSIGN_OR_RETURN(given, OfStep(bounds_, *options_.step));
    }
    candidates_.push_back(given);
    return Status::Ok();
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
    const Vec3d far{std::max(std::abs(bounds_.min.x), std::abs(bounds_.max.x)),
                    std::max(std::abs(bounds_.min.y), std::abs(bounds_.max.y)),
                    std::max(std::abs(bounds_.min.z), std::abs(bounds_.max.z))};
    flat_ = kFlatSteps * candidates_[kMostBits - kLeastBits].grid.step;
    if (input_.is_single()) {
      flat_ = std::max(flat_, kFlatSteps * std::ldexp(std::max({far.x, far.y, far.z}), -24));
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
    if (!(height > flat_)) {
      ++survey_.flat_triangles;
      return;
    }
    if (height > kSafeSteps * largest_step_) return;
    for (Candidate& c : candidates_) {
      if (c.is_exact || height > kSafeSteps * c.grid.step) continue;
      c.collapsed += OnOneLine(c.grid.Quantize(t[0]), c.grid.Quantize(t[1]), c.grid.Quantize(t[2]));
    }
  }

  const Candidate& Best() {
    const Candidate& plain = BestOfBits();
    for (const Candidate& c : candidates_) {
      if (c.reason != GridReason::kDecimals && c.reason != GridReason::kSomeDecimals) continue;
      const bool fine = c.is_exact || c.bits >= plain.bits;
      if (fine && c.collapsed <= plain.collapsed && c.bits <= plain.bits + kBitsForDecimals) {
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
      const uint64_t lost = of_bits(bits).collapsed;
      if (lost < of_bits(best).collapsed) best = bits;
      const bool few = bits > least + kBitsForSlivers &&
                       of_bits(best).collapsed <= input_.triangles() / kTrianglesPerLost;
      if (of_bits(best).collapsed == 0 || few) break;
    }
    if (best != least) of_bits(best).reason = GridReason::kSlivers;
    return of_bits(best);
  }

  Status CheckGiven(const Candidate& given) const {
    const uint64_t solid = input_.triangles() - survey_.flat_triangles;
    if (static_cast<double>(given.collapsed) <=
        options_.max_collapsed * static_cast<double>(solid)) {
      return Status::Ok();
    }
    char numbers[200];
    std::snprintf(numbers, sizeof(numbers),
                  "the mesh is %.3g long, and half of its edges are shorter than %.3g; choose a "
                  "smaller step, or none: %d bits, a step of %.3g, suit it",
                  LongestSide(bounds_), survey_.edges.median, survey_.advised_bits,
                  survey_.advised_step);
    return InvalidArgument("a step of " + Short(given.grid.step) + " leaves no area to " +
                           std::to_string(given.collapsed) + " of " + std::to_string(solid) +
                           " triangles: " + numbers);
  }
  static std::string Short(double value) {
    char text[32];
    std::snprintf(text, sizeof(text), "%.3g", value);
    return text;
  }

  const InputSpool& input_;
  const BuildOptions& options_;
  MeshSurvey& survey_;
  const Box3d bounds_;
  std::vector<Candidate> candidates_;
  bool given_ = false;
  double largest_step_ = 0;
  double flat_ = 0;  // triangles that are no higher are flat
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

Status ChooseGrid(const InputSpool& input, const BuildOptions& options, const SpoolSpace* space,
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
