// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/far_vertices.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

namespace mtdb {

namespace internal {

namespace {

constexpr int kMostRounds = 12;
constexpr size_t kCells = 4096;       // of an axis
constexpr size_t kGap = kCells / 64;  // so many empty ones end a run

// The coordinates of an axis in cells.
class AxisCells {
 public:
  AxisCells(double from, double to)
      : from_(from),
        scale_(to > from ? static_cast<double>(kCells) / (to - from) : 0),
        cells_(kCells) {
    if (!std::isfinite(scale_)) scale_ = 0;
  }

  void Add(double x) {
    const double at = std::clamp((x - from_) * scale_, 0.0, static_cast<double>(kCells - 1));
    Cell& cell = cells_[static_cast<size_t>(at)];
    ++cell.count;
    cell.least = std::min(cell.least, x);
    cell.most = std::max(cell.most, x);
  }
  // Of the run with the most vertices, the first of such; all when it has few of them, as a row of
  // a lattice has.
  std::array<double, 2> LargestRun() const {
    constexpr double kLeastPart = 0.4;
    Cell best, run, all;
    size_t empty = 0;
    for (const Cell& cell : cells_) {
      if (cell.count == 0) {
        ++empty;
        continue;
      }
      if (empty >= kGap) run = Cell{};
      empty = 0;
      run.Add(cell);
      all.Add(cell);
      if (run.count > best.count) best = run;
    }
    if (static_cast<double>(best.count) < kLeastPart * static_cast<double>(all.count)) best = all;
    return {best.least, best.most};
  }

 private:
  struct Cell {
    uint64_t count = 0;
    double least = std::numeric_limits<double>::infinity();
    double most = -std::numeric_limits<double>::infinity();
    void Add(const Cell& other) {
      count += other.count;
      least = std::min(least, other.least);
      most = std::max(most, other.most);
    }
  };
  double from_, scale_;
  std::vector<Cell> cells_;
};

class Search {
 public:
  explicit Search(const InputMesh& input) : input_(input) {}

  Result<std::optional<FarVertices>> Run(const std::function<bool(const Box3d&)>& suits) {
    MTDB_RETURN_IF_ERROR(FindUsed());
    Box3d box = input_.bounds();
    for (int round = 0; round < kMostRounds && !suits(box); ++round) {
      MTDB_ASSIGN_OR_RETURN(const Box3d inner, Narrow(box));
      if (inner == box) return std::optional<FarVertices>();
      box = inner;
    }
    if (!suits(box) || box == input_.bounds()) return std::optional<FarVertices>();
    MTDB_ASSIGN_OR_RETURN(FarVertices far, Count(box));
    return std::optional(far);
  }

 private:
  template <typename F>
  Status ForEachUsed(F&& f) const {
    SpoolReader reader(&input_.vertex_spool());
    for (uint64_t v = 0; v < input_.vertices(); ++v) {
      const std::byte* bytes = reader.Next(input_.vertex_bytes());
      if (bytes == nullptr) return reader.status();
      if (used_[v]) f(v, input_.Position(bytes));
    }
    return Status::Ok();
  }

  Status FindUsed() {
    used_.assign(input_.vertices(), false);
    SpoolReader reader(&input_.triangle_spool());
    for (uint64_t left = input_.triangles(); left > 0; --left) {
      std::array<uint32_t, 3> t;
      if (!reader.Get(&t)) return reader.status();
      for (const uint32_t v : t) used_[v] = true;
    }
    return Status::Ok();
  }

  static bool Holds(const Box3d& box, Vec3d p) {
    for (int i = 0; i < 3; ++i) {
      if (p[i] < box.min[i] || p[i] > box.max[i]) return false;
    }
    return true;
  }

  Result<Box3d> Narrow(const Box3d& box) const {
    std::vector<AxisCells> axes;
    for (int i = 0; i < 3; ++i) axes.emplace_back(box.min[i], box.max[i]);
    MTDB_RETURN_IF_ERROR(ForEachUsed([&](uint64_t, Vec3d p) {
      if (!Holds(box, p)) return;
      for (int i = 0; i < 3; ++i) axes[static_cast<size_t>(i)].Add(p[i]);
    }));
    // One axis at a time, so that runs of different parts do not make a box of neither: the longest
    // that has a gap.
    std::array<int, 3> order{0, 1, 2};
    const Vec3d size = box.max - box.min;
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return size[a] > size[b]; });
    Box3d inner = box;
    for (const int i : order) {
      const auto [from, to] = axes[static_cast<size_t>(i)].LargestRun();
      if (from == box.min[i] && to == box.max[i]) continue;
      inner.min[i] = from;
      inner.max[i] = to;
      break;
    }
    Box3d left;
    MTDB_RETURN_IF_ERROR(ForEachUsed([&](uint64_t, Vec3d p) {
      if (Holds(inner, p)) left.Add(p);
    }));
    return left;
  }

  Result<FarVertices> Count(const Box3d& box) const {
    FarVertices far;
    far.others = box;
    MTDB_RETURN_IF_ERROR(ForEachUsed([&](uint64_t v, Vec3d p) {
      ++far.vertices;
      if (Holds(box, p)) return;
      if (far.count++ != 0) return;
      far.position = p;
      // Joined vertices are not numbered as the input's.
      const bool as_read = !input_.header().soup && input_.welded_vertices() == 0;
      if (as_read) far.vertex = v;
    }));
    return far;
  }

  const InputMesh& input_;
  std::vector<bool> used_;
};

}  // namespace

Result<std::optional<FarVertices>> FindFarVertices(const InputMesh& input,
                                                   const std::function<bool(const Box3d&)>& suits) {
  return Search(input).Run(suits);
}

}  // namespace internal

std::string FarVerticesText(const FarVertices& far) {
  const auto point = [](Vec3d p) {
    char text[120];
    std::snprintf(text, sizeof(text), "%.9g %.9g %.9g", p.x, p.y, p.z);
    return std::string(text);
  };
  const bool one = far.count == 1;
  std::string vertex = "vertex";
  if (far.vertex) vertex += ' ' + std::to_string(*far.vertex) + " (counted from 0)";
  std::string text = std::to_string(far.count) + " of the " + std::to_string(far.vertices) +
                     " vertices " + (one ? "lies" : "lie") + " far off the others (" +
                     point(far.others.min) + " to " + point(far.others.max) + "): ";
  if (!one) text += "the first is ";
  return text + vertex + " at " + point(far.position);
}

}  // namespace mtdb
