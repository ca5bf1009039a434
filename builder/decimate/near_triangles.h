// SPDX-License-Identifier: Apache-2.0
// NearTriangles: a grid over triangles, to find those near a box.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/hash.h"

namespace mtdb::internal {

// Add all, End(), ask. Finds all that come within `reach` of a small box; of a large one none, or
// of triangles that are much longer than others. Cells are keyed by hash, so that it may name
// others too.
class NearTriangles {
 public:
  explicit NearTriangles(double reach) : reach_(reach) {}

  bool empty() const { return triangles_.empty(); }
  void Add(uint32_t triangle, const Triangle3d& corners) {
    Box3d box;
    for (const Vec3d& p : corners) box.Add(p);
    triangles_.emplace_back(triangle, box);
  }
  void End() {
    double sum = 0;
    for (const auto& [triangle, box] : triangles_) sum += Length(box.max - box.min);
    cell_ = std::max(2 * reach_, sum / static_cast<double>(triangles_.size()));
    if (!(cell_ > 0)) cell_ = 1;
    for (const auto& entry : triangles_) {
      ForEachCell(entry.second, [&](uint64_t key) { cells_.emplace_back(key, entry.first); });
    }
    std::sort(cells_.begin(), cells_.end());
  }
  // May call f for one triangle several times.
  template <typename F>
  void ForEachNear(Box3d box, F&& f) const {
    const Vec3d reach{reach_, reach_, reach_};
    box.min = box.min - reach;
    box.max = box.max + reach;
    ForEachCell(box, [&](uint64_t key) {
      auto at =
          std::lower_bound(cells_.begin(), cells_.end(), std::pair<uint64_t, uint32_t>(key, 0));
      for (; at != cells_.end() && at->first == key; ++at) f(at->second);
    });
  }

 private:
  template <typename F>
  void ForEachCell(const Box3d& box, F&& f) const {
    constexpr double kMostCells = 64;
    const auto cell = [&](double x) { return std::floor(x / cell_); };
    const Vec3d first{cell(box.min.x), cell(box.min.y), cell(box.min.z)};
    const Vec3d last{cell(box.max.x), cell(box.max.y), cell(box.max.z)};
    const Vec3d count = last - first + Vec3d{1, 1, 1};
    if (!(count.x * count.y * count.z <= kMostCells)) return;
    for (double x = first.x; x <= last.x; ++x) {
      for (double y = first.y; y <= last.y; ++y) {
        for (double z = first.z; z <= last.z; ++z) f(KeyOf(x, y, z));
      }
    }
  }
  static uint64_t KeyOf(double x, double y, double z) {
    const auto mix = [](uint64_t h, double v) {
      return Mix64(h ^ static_cast<uint64_t>(static_cast<int64_t>(v)));
    };
    return mix(mix(mix(0, x), y), z);
  }

  double reach_, cell_ = 1;
  std::vector<std::pair<uint32_t, Box3d>> triangles_;
  std::vector<std::pair<uint64_t, uint32_t>> cells_;
};

}  // namespace mtdb::internal
