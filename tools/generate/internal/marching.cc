// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/internal/marching.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "store/base/check.h"
#include "store/base/geometry.h"

namespace mtdb::internal {
namespace {

constexpr int kNoEdge = -1;

// The corners of each face, counter-clockwise from outside the cube.
constexpr int kFaceCorners[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                    {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

int EdgeBetween(int a, int b) {
  const int axis = (a ^ b) == 1 ? 0 : (a ^ b) == 2 ? 1 : 2;
  for (int e = axis * 4; e < axis * 4 + 4; ++e) {
    if (kCubeEdgeStart[static_cast<size_t>(e)] == std::min(a, b)) return e;
  }
  return kNoEdge;
}

Vec3d EdgeMiddle(int e) {
  const int c = kCubeEdgeStart[static_cast<size_t>(e)];
  Vec3d p{static_cast<double>(c & 1), static_cast<double>(c >> 1 & 1), static_cast<double>(c >> 2)};
  p[e / 4] += 0.5;
  return p;
}

bool OnOneFace(int a, int b) {
  const Vec3d p = EdgeMiddle(a), q = EdgeMiddle(b);
  for (int i = 0; i < 3; ++i) {
    if (p[i] == q[i] && p[i] != 0.5) return true;
  }
  return false;
}

// next[e] = the crossing that follows crossing e on the surface's border with the cube.
std::array<int, 12> ContourOf(unsigned inside) {
  std::array<int, 12> next;
  next.fill(kNoEdge);
  for (const auto& corners : kFaceCorners) {
    for (int i = 0; i < 4; ++i) {
      const auto is_inside = [&](int k) { return (inside >> corners[k & 3] & 1u) != 0; };
      if (is_inside(i) || !is_inside(i + 1)) continue;
      // The contour cuts off the run of inside corners that starts here.
      int j = i + 1;
      while (is_inside(j + 1)) ++j;
      const int enter = EdgeBetween(corners[i], corners[(i + 1) & 3]);
      const int leave = EdgeBetween(corners[j & 3], corners[(j + 1) & 3]);
      next[static_cast<size_t>(enter)] = leave;
    }
  }
  return next;
}

// Triangulates a polygon of crossings by dynamic programming over its diagonals: none on a face of
// the cube, and the shortest sum.
class LoopTriangulator {
 public:
  explicit LoopTriangulator(const std::vector<int>& loop) : loop_(loop) {
    const size_t n = loop.size();
    cost_.assign(n * n, 0);
    split_.assign(n * n, 0);
    for (size_t span = 2; span < n; ++span) {
      for (size_t i = 0; i + span < n; ++i) Solve(i, i + span);
    }
  }
  double cost() const { return cost_[loop_.size() - 1]; }
  void Emit(MarchingCase* out) const { Emit(0, loop_.size() - 1, out); }

 private:
  double DiagonalCost(size_t i, size_t j) const {
    if (j == i + 1 || (i == 0 && j + 1 == loop_.size())) return 0;
    if (OnOneFace(loop_[i], loop_[j])) return std::numeric_limits<double>::infinity();
    return Length(EdgeMiddle(loop_[i]) - EdgeMiddle(loop_[j]));
  }
  void Solve(size_t i, size_t j) {
    const size_t n = loop_.size();
    double best = std::numeric_limits<double>::infinity();
    for (size_t k = i + 1; k < j; ++k) {
      const double c = cost_[i * n + k] + cost_[k * n + j];
      if (c < best) {
        best = c;
        split_[i * n + j] = k;
      }
    }
    cost_[i * n + j] = best + DiagonalCost(i, j);
  }
  void Emit(size_t i, size_t j, MarchingCase* out) const {
    if (j < i + 2) return;
    const size_t k = split_[i * loop_.size() + j];
    out->triangles[out->triangle_count++] = {static_cast<uint8_t>(loop_[i]),
                                             static_cast<uint8_t>(loop_[k]),
                                             static_cast<uint8_t>(loop_[j])};
    Emit(i, k, out);
    Emit(k, j, out);
  }

  const std::vector<int>& loop_;
  std::vector<double> cost_;
  std::vector<size_t> split_;
};

MarchingCase MakeCase(unsigned inside) {
  MarchingCase out;
  std::array<int, 12> next = ContourOf(inside);
  for (int first = 0; first < 12; ++first) {
    std::vector<int> loop;
    for (int e = first; next[static_cast<size_t>(e)] != kNoEdge;) {
      loop.push_back(e);
      e = std::exchange(next[static_cast<size_t>(e)], kNoEdge);
    }
    if (loop.empty()) continue;
    for (const int e : loop) out.edges = static_cast<uint16_t>(out.edges | 1u << e);
    const LoopTriangulator triangulator(loop);
    MTDB_CHECK(triangulator.cost() < std::numeric_limits<double>::infinity(),
               "every contour has a triangulation without diagonals on faces");
    triangulator.Emit(&out);
  }
  return out;
}

}  // namespace

const std::array<MarchingCase, 256>& MarchingCases() {
  static const std::array<MarchingCase, 256> kCases = [] {
    std::array<MarchingCase, 256> all;
    for (unsigned i = 0; i < 256; ++i) all[i] = MakeCase(i);
    return all;
  }();
  return kCases;
}

}  // namespace mtdb::internal
