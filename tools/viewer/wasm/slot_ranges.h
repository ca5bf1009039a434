// SPDX-License-Identifier: Apache-2.0
// What the page gets of a mesh in slots: normals of vertices, and changed slots as ranges.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace mtdb {

// Ranges of slots closer than this travel to the page as one: each has its price there.
inline constexpr uint32_t kGap = 256;

using Normal = std::array<int16_t, 4>;  // x, y, z in steps of 1/32767, and 0

// Of the triangles at each vertex, times their areas, when positions are stretched so. Three floats
// a vertex.
inline void SumNormals(std::span<const float> positions, std::span<const uint32_t> indices,
                       const std::array<float, 3>& stretch, std::vector<float>* sums) {
  sums->assign(positions.size(), 0.0F);
  const float* const p = positions.data();
  for (size_t i = 0; i + 2 < indices.size(); i += 3) {
    const uint32_t a = indices[i], b = indices[i + 1], c = indices[i + 2];
    if (a == b) continue;  // an empty slot
    float u[3], v[3];
    for (size_t k = 0; k < 3; ++k) {
      u[k] = stretch[k] * (p[3 * size_t{b} + k] - p[3 * size_t{a} + k]);
      v[k] = stretch[k] * (p[3 * size_t{c} + k] - p[3 * size_t{a} + k]);
    }
    const float n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                        u[0] * v[1] - u[1] * v[0]};
    for (const uint32_t corner : {a, b, c}) {
      for (int k = 0; k < 3; ++k) (*sums)[3 * size_t{corner} + k] += n[k];
    }
  }
}

inline Normal Rounded(const float* n) {
  const double length = std::sqrt(double{n[0]} * n[0] + double{n[1]} * n[1] + double{n[2]} * n[2]);
  if (!(length > 0) || !std::isfinite(length)) return {};
  const double scale = 32767 / length;
  Normal rounded{};
  for (size_t k = 0; k < 3; ++k) rounded[k] = static_cast<int16_t>(std::lround(n[k] * scale));
  return rounded;
}

// Appends a slot to ranges in ascending order, the last of which begins at `first` or later.
inline void AddSlot(uint32_t slot, size_t first, std::vector<uint32_t>* ranges) {
  if (ranges->size() > first && slot < ranges->back() + kGap) {
    ranges->back() = slot + 1;
  } else {
    ranges->push_back(slot);
    ranges->push_back(slot + 1);
  }
}

// Brings the normals up to date, and appends the slots whose normals changed; returns how many
// ranges these are.
inline uint32_t UpdateNormals(std::span<const float> positions, std::span<const uint32_t> indices,
                              const std::array<float, 3>& stretch, std::vector<float>* sums,
                              std::vector<Normal>* normals, std::vector<uint32_t>* changes) {
  SumNormals(positions, indices, stretch, sums);
  const size_t first = changes->size();
  normals->resize(positions.size() / 3);
  for (uint32_t v = 0; v < normals->size(); ++v) {
    const Normal normal = Rounded(&(*sums)[3 * size_t{v}]);
    if (normal == (*normals)[v]) continue;
    (*normals)[v] = normal;
    AddSlot(v, first, changes);
  }
  return static_cast<uint32_t>((changes->size() - first) / 2);
}

}  // namespace mtdb
