// SPDX-License-Identifier: Apache-2.0
// A threshold from a grid of errors.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "query/fields/rounding.h"
#include "query/fields/work_meter.h"
#include "query/threshold.h"
#include "store/base/check.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A pyramid of grids, each of half the resolution and with the smallest errors of the one below.
class OfGrid final : public Threshold {
 public:
  explicit OfGrid(GridField field) : origin_(field.origin), cell_size_(field.cell_size) {
    Vec3d end = origin_;
    for (int i = 0; i < 3; ++i) end[i] += cell_size_[i] * field.counts[static_cast<size_t>(i)];
    scale_ = std::max(LargestCoordinate(origin_), LargestCoordinate(end));
    levels_.push_back({field.counts, std::move(field.errors)});
    while (levels_.back().errors.size() > 1) levels_.push_back(Halved(levels_.back()));
  }

  double Min(const Triangle3d& t, double distance) const override {
    Search search{t, Around(t), distance + Rounding(t, distance, scale_), kInfinity};
    // Begins at the finest level at which the neighbourhood is about as small as a cell.
    size_t level = 0;
    while (level + 1 < levels_.size() && !AsSmallAsCells(level, search)) ++level;
    Index begin, end;
    for (int i = 0; i < 3; ++i) {
      begin[static_cast<size_t>(i)] = CellAt(level, i, search.around.min[i] - search.limit);
      end[static_cast<size_t>(i)] = CellAt(level, i, search.around.max[i] + search.limit);
    }
    Index at;
    for (at[2] = begin[2]; at[2] <= end[2]; ++at[2]) {
      for (at[1] = begin[1]; at[1] <= end[1]; ++at[1]) {
        for (at[0] = begin[0]; at[0] <= end[0]; ++at[0]) Visit(level, at, search);
      }
    }
    return search.least;
  }

 private:
  using Index = std::array<uint32_t, 3>;
  struct Level {
    Index counts;
    std::vector<double> errors;
    double At(const Index& at) const {
      return errors[(size_t{at[2]} * counts[1] + at[1]) * counts[0] + at[0]];
    }
  };
  struct Search {
    const Triangle3d& t;
    Box3d around;
    double limit;
    double least;
  };

  bool AsSmallAsCells(size_t level, const Search& search) const {
    const Vec3d size = search.around.max - search.around.min;
    for (int i = 0; i < 3; ++i) {
      if (size[i] + 2 * search.limit > std::ldexp(cell_size_[i], static_cast<int>(level)) &&
          levels_[level].counts[static_cast<size_t>(i)] > 1) {
        return false;
      }
    }
    return true;
  }

  // The cell along an axis in which a coordinate is, or the one at the border beyond which it is.
  uint32_t CellAt(size_t level, int axis, double x) const {
    const double at = (x - origin_[axis]) / std::ldexp(cell_size_[axis], static_cast<int>(level));
    const double last = levels_[level].counts[static_cast<size_t>(axis)] - 1;
    return static_cast<uint32_t>(std::clamp(std::floor(at), 0.0, last));
  }

  // Calls `visit` for the up to eight cells of `below` that make up a cell of the level above.
  template <typename F>
  static void ForEachPart(const Level& below, const Index& at, F&& visit) {
    for (uint32_t c = 0; c < 8; ++c) {
      const Index part{2 * at[0] + (c & 1), 2 * at[1] + (c >> 1 & 1), 2 * at[2] + (c >> 2)};
      if (part[0] < below.counts[0] && part[1] < below.counts[1] && part[2] < below.counts[2]) {
        visit(part);
      }
    }
  }

  static Level Halved(const Level& below) {
    Level level;
    for (size_t i = 0; i < 3; ++i) level.counts[i] = (below.counts[i] + 1) / 2;
    Index at;
    for (at[2] = 0; at[2] < level.counts[2]; ++at[2]) {
      for (at[1] = 0; at[1] < level.counts[1]; ++at[1]) {
        for (at[0] = 0; at[0] < level.counts[0]; ++at[0]) {
          double least = kInfinity;
          ForEachPart(below, at,
                      [&](const Index& part) { least = std::min(least, below.At(part)); });
          level.errors.push_back(least);
        }
      }
    }
    return level;
  }

  // Without bound where the grid ends.
  Box3d CellBox(size_t level, const Index& at) const {
    Box3d box;
    for (int i = 0; i < 3; ++i) {
      const auto axis = static_cast<size_t>(i);
      const uint64_t begin = uint64_t{at[axis]} << level;
      const uint64_t end = (uint64_t{at[axis]} + 1) << level;
      const uint64_t count = levels_[0].counts[axis];
      box.min[i] =
          begin == 0 ? -kInfinity : origin_[i] + cell_size_[i] * static_cast<double>(begin);
      box.max[i] = end >= count ? kInfinity : origin_[i] + cell_size_[i] * static_cast<double>(end);
    }
    return box;
  }

  void Visit(size_t level, const Index& at, Search& search) const {
    if (!SpendSteps(1)) return;
    const double least = levels_[level].At(at);
    if (least >= search.least) return;
    const Box3d box = CellBox(level, at);
    const double limit2 = search.limit * search.limit;
    if (SquaredDistanceBoxBox(box, search.around) > limit2) return;
    if (level == 0) {
      const auto near = [&](Vec3d p) { return SquaredDistancePointBox(p, box) <= limit2; };
      if (std::any_of(search.t.begin(), search.t.end(), near) ||
          SquaredDistanceTriangleBox(search.t, box) <= limit2) {
        search.least = least;
      }
      return;
    }
    // The smallest first: it makes the others unnecessary.
    const Level& below = levels_[level - 1];
    std::array<std::pair<double, Index>, 8> parts;
    size_t count = 0;
    ForEachPart(below, at, [&](const Index& part) {
      size_t i = count++;
      for (; i > 0 && below.At(part) < parts[i - 1].first; --i) parts[i] = parts[i - 1];
      parts[i] = {below.At(part), part};
    });
    for (size_t i = 0; i < count; ++i) Visit(level - 1, parts[i].second, search);
  }

  Vec3d origin_;
  Vec3d cell_size_;
  double scale_;
  std::vector<Level> levels_;  // the finest first
};

}  // namespace

ThresholdPtr GridThreshold(GridField field) {
  uint64_t cells = 1;
  for (const uint32_t count : field.counts) {
    MTDB_CHECK(count >= 1 && cells <= field.errors.size() / count,
               "a grid needs an error for each cell");
    cells *= count;
  }
  MTDB_CHECK(cells == field.errors.size(), "a grid needs an error for each cell");
  for (int i = 0; i < 3; ++i) {
    MTDB_CHECK(field.cell_size[i] > 0 && std::isfinite(field.cell_size[i]) &&
                   std::isfinite(field.origin[i]),
               "a grid needs a finite origin and cells of positive size");
  }
  return std::make_shared<OfGrid>(std::move(field));
}

}  // namespace mtdb
