// SPDX-License-Identifier: Apache-2.0
// What the page gets of a mesh in slots: normals of vertices, and changed slots as ranges.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <vector>

namespace mtdb {

// Ranges of slots closer than this travel to the page as one: each has its price there.
inline constexpr uint32_t kGap = 256;

using Normal = std::array<int16_t, 4>;  // x, y, z in steps of 1/32767, and 0

// A set of slots, which is emptied in ascending order.
class SlotMarks {
 public:
  void Mark(uint32_t slot) {
    if (slot >= marks_.size()) marks_.resize(std::max<size_t>(slot + 1, 2 * marks_.size()));
    marks_[slot] = 1;
  }
  void MarkBelow(uint32_t slots) { marks_.assign(slots, 1); }
  bool Has(uint32_t slot) const { return slot < marks_.size() && marks_[slot] != 0; }
  // Calls f(slot) for each.
  template <typename F>
  void ForEach(F&& f) const {
    constexpr size_t kStep = 64;
    for (size_t at = 0; at < marks_.size(); at += kStep) {
      const auto from = marks_.begin() + static_cast<std::ptrdiff_t>(at);
      const size_t end = std::min(at + kStep, marks_.size());
      if (std::accumulate(from, from + static_cast<std::ptrdiff_t>(end - at), 0) == 0) continue;
      for (size_t slot = at; slot < end; ++slot) {
        if (marks_[slot] != 0) f(static_cast<uint32_t>(slot));
      }
    }
  }
  void Clear() { std::ranges::fill(marks_, uint8_t{0}); }

 private:
  std::vector<uint8_t> marks_;
};

// Of the triangles at each vertex in `touched`, times their areas, when positions are stretched so.
// Three floats a vertex.
inline void SumNormals(std::span<const float> positions, std::span<const uint32_t> indices,
                       const std::array<float, 3>& stretch, const SlotMarks& touched,
                       std::vector<float>* sums) {
  sums->resize(positions.size());
  touched.ForEach([&](uint32_t v) {
    for (size_t k = 0; k < 3; ++k) (*sums)[3 * size_t{v} + k] = 0;
  });
  const float* const p = positions.data();
  for (size_t i = 0; i + 2 < indices.size(); i += 3) {
    const uint32_t a = indices[i], b = indices[i + 1], c = indices[i + 2];
    if (a == b) continue;  // an empty slot
    if (!touched.Has(a) && !touched.Has(b) && !touched.Has(c)) continue;
    float u[3], v[3];
    for (size_t k = 0; k < 3; ++k) {
      u[k] = stretch[k] * (p[3 * size_t{b} + k] - p[3 * size_t{a} + k]);
      v[k] = stretch[k] * (p[3 * size_t{c} + k] - p[3 * size_t{a} + k]);
    }
    const float n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                        u[0] * v[1] - u[1] * v[0]};
    for (const uint32_t corner : {a, b, c}) {
      if (!touched.Has(corner)) continue;
      for (int k = 0; k < 3; ++k) (*sums)[3 * size_t{corner} + k] += n[k];
    }
  }
}

inline Normal Rounded(const float* n) {
  const double length = std::sqrt(double{n[0]} * n[0] + double{n[1]} * n[1] + double{n[2]} * n[2]);
  if (!(length > 0) || !std::isfinite(length)) return {};
  const double scale = 32767 / length;
  Normal rounded{};
  for (size_t k = 0; k < 3; ++k) {
    const double x = n[k] * scale;
    rounded[k] = static_cast<int16_t>(x < 0 ? x - 0.5 : x + 0.5);  // lround() is a call there
  }
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

// Brings the normals up to date, which are others at the vertices in `touched` at most, and appends
// the slots whose normals changed; returns how many ranges these are. The normals are the same
// whatever else is touched.
inline uint32_t UpdateNormals(std::span<const float> positions, std::span<const uint32_t> indices,
                              const std::array<float, 3>& stretch, const SlotMarks& touched,
                              std::vector<float>* sums, std::vector<Normal>* normals,
                              std::vector<uint32_t>* changes) {
  SumNormals(positions, indices, stretch, touched, sums);
  const size_t first = changes->size();
  normals->resize(positions.size() / 3);
  touched.ForEach([&](uint32_t v) {
    const Normal normal = Rounded(&(*sums)[3 * size_t{v}]);
    if (normal == (*normals)[v]) return;
    (*normals)[v] = normal;
    AddSlot(v, first, changes);
  });
  return static_cast<uint32_t>((changes->size() - first) / 2);
}

}  // namespace mtdb
