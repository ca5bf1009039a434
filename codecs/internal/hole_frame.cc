#include "codecs/internal/hole_frame.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "codecs/internal/float4.h"

namespace mtdb {

namespace {

// floor(x + 1/2), for x that is clamped to +-2^30; not a number counts as the least.
int32_t Round(float x) {
  constexpr float kLimit = 1073741824.0f;
  const float above = x > -kLimit ? x : -kLimit;
  const float up = (above < kLimit ? above : kLimit) + 0.5f;
  const auto truncated = static_cast<int32_t>(up);
  return truncated - (static_cast<float>(truncated) > up ? 1 : 0);
}

int32_t Shift(int32_t base, int32_t offset) {
  return static_cast<int32_t>(static_cast<uint32_t>(base) + static_cast<uint32_t>(offset));
}

}  // namespace

HoleFrame::HoleFrame(const Patch& patch, const std::vector<Vec3i>& positions, bool boundary) {
  const std::span<const uint32_t> ring = patch.ring();
  const auto k = static_cast<uint32_t>(ring.size());
  ring_.Gather(ring, positions);

  uint32_t sum[3] = {0, 0, 0};
  const std::span<const uint32_t> hole = patch.hole();
  hole_count_ = static_cast<uint32_t>(hole.size());
  for (uint32_t h = 0; h < hole_count_; ++h) {
    const auto& corners = patch.triangle(hole[h]).corners;
    for (size_t c = 0; c < 3; ++c) {
      const Vec3i& p = positions[corners[c]];
      for (int i = 0; i < 3; ++i) {
        hole_[i][c][h] = p[i];
        sum[i] += static_cast<uint32_t>(p[i]);
      }
    }
  }
  for (auto& axis : hole_) {
    for (auto& corner : axis) std::fill_n(corner + hole_count_, 3, 0);
  }
  if (boundary) {
    for (size_t i = 0; i < 3; ++i) mean_[i] = ring_.at[i][k - 1] * 0.5f;
  } else {
    // Each ring vertex counts as often as hole triangles meet there.
    const uint32_t times = 3 * hole_count_;
    const float inverse = 1 / static_cast<float>(times);
    for (int i = 0; i < 3; ++i) {
      const uint32_t base = times * static_cast<uint32_t>(ring_.base[i]);
      mean_[i] = static_cast<float>(static_cast<int32_t>(sum[i] - base)) * inverse;
    }
  }

  // Sums over the ring, four vertices at a time.
  const Float4 zero = {0, 0, 0, 0};
  Float4 cross[3] = {zero, zero, zero};
  Float4 sums[3] = {zero, zero, zero};
  Float4 squares[3] = {zero, zero, zero};   // xx yy zz
  Float4 products[3] = {zero, zero, zero};  // yz zx xy
  for (uint32_t j = 0; j < k; j += 4) {
    Float4 p[3];
    Float4 q[3];
    for (size_t i = 0; i < 3; ++i) {
      p[i] = Load4<Float4>(ring_.at[i] + j);
      q[i] = Load4<Float4>(ring_.at[i] + j + 1);
    }
    for (size_t i = 0; i < 3; ++i) {
      const size_t a = i == 2 ? 0 : i + 1;
      const size_t b = a == 2 ? 0 : a + 1;
      cross[i] += p[a] * q[b] - p[b] * q[a];
      sums[i] += p[i];
      squares[i] += p[i] * p[i];
      products[i] += p[a] * p[b];
    }
  }
  float size[3];
  for (size_t i = 0; i < 3; ++i) {
    normal_[i] = SumLanes(cross[i]);
    size[i] = std::abs(normal_[i]);
  }
  n_ = size[0] > size[1] ? (size[0] > size[2] ? 0 : 2) : (size[1] > size[2] ? 1 : 2);
  u_ = n_ == 2 ? 0 : n_ + 1;
  v_ = u_ == 2 ? 0 : u_ + 1;

  // Moments about the predicted point: of (p - m)(q - n), sum(pq) - m sum(q) - n sum(p) + k m n.
  const auto count = static_cast<float>(k);
  const float inverse = 1 / count;
  const float mu = mean_[u_];
  const float mv = mean_[v_];
  const float su = SumLanes(sums[u_]);
  const float sv = SumLanes(sums[v_]);
  uu_ = std::max((SumLanes(squares[u_]) - 2 * mu * su + count * mu * mu) * inverse, 0.0f);
  const float vv = (SumLanes(squares[v_]) - 2 * mv * sv + count * mv * mv) * inverse;
  const float uv = (SumLanes(products[n_]) - mu * sv - mv * su + count * mu * mv) * inverse;
  slope_ = uu_ > 0 ? uv / uu_ : 0;
  vv_ = std::max(vv - slope_ * uv, 0.0f);
}

Expectation HoleFrame::ExpectU() const { return {Shift(ring_.base[u_], Round(mean_[u_])), uu_}; }

Expectation HoleFrame::ExpectV(int32_t u) const {
  const float du = RingPoints::Offset(u, ring_.base[u_]);
  return {Shift(ring_.base[v_], Round(mean_[v_] + slope_ * (du - mean_[u_]))), vv_};
}

int32_t HoleFrame::ExpectN(int32_t u, int32_t v) const {
  // The hole triangle above (u, v), by the areas of the three triangles that (u, v) cuts it into;
  // four hole triangles at a time.
  const Word4 zero = {0, 0, 0, 0};
  const auto offset = [&](int axis, size_t corner, uint32_t h, Word4 from) {
    return ToFloat(reinterpret_cast<Int4>(Load4<Word4>(hole_[axis][corner] + h) - from));
  };
  const float sign = normal_[n_] > 0 ? 1.0f : -1.0f;
  for (uint32_t h = 0; h < hole_count_; h += 4) {
    const Word4 from_u = zero + static_cast<uint32_t>(u);
    const Word4 from_v = zero + static_cast<uint32_t>(v);
    const Float4 au = offset(u_, 0, h, from_u), av = offset(v_, 0, h, from_v);
    const Float4 bu = offset(u_, 1, h, from_u), bv = offset(v_, 1, h, from_v);
    const Float4 cu = offset(u_, 2, h, from_u), cv = offset(v_, 2, h, from_v);
    const Float4 wa = bu * cv - bv * cu;
    const Float4 wb = cu * av - cv * au;
    const Float4 wc = au * bv - av * bu;
    const Float4 area = wa + wb + wc;
    const Float4 least = Min4(Min4(wa * sign, wb * sign), wc * sign);
    const Int4 inside = (least >= 0) & (area != 0);
    const uint32_t lanes =
        static_cast<uint32_t>(inside[0] & 1) | static_cast<uint32_t>(inside[1] & 2) |
        static_cast<uint32_t>(inside[2] & 4) | static_cast<uint32_t>(inside[3] & 8);
    if (lanes == 0) continue;
    const auto lane = static_cast<uint32_t>(std::countr_zero(lanes));
    if (h + lane >= hole_count_) break;  // padding
    const int32_t an = hole_[n_][0][h + lane];
    const float bn = RingPoints::Offset(hole_[n_][1][h + lane], an);
    const float cn = RingPoints::Offset(hole_[n_][2][h + lane], an);
    return Shift(an, Round((wb[lane] * bn + wc[lane] * cn) / area[lane]));
  }
  float height = mean_[n_];
  if (normal_[n_] != 0) {
    const float du = RingPoints::Offset(u, ring_.base[u_]) - mean_[u_];
    const float dv = RingPoints::Offset(v, ring_.base[v_]) - mean_[v_];
    height -= (normal_[u_] * du + normal_[v_] * dv) / normal_[n_];
  }
  return Shift(ring_.base[n_], Round(height));
}

float HoleFrame::slant() const {
  if (normal_[n_] == 0) return 1;
  const float u = normal_[u_] / normal_[n_];
  const float v = normal_[v_] / normal_[n_];
  return std::sqrt(1 + u * u + v * v);
}

float HoleFrame::unevenness() const {
  if (normal_[n_] == 0) return 0;
  const float a = normal_[u_] / normal_[n_];
  const float b = normal_[v_] / normal_[n_];
  float sum = 0;
  for (uint32_t j = 0; j < ring_.count; ++j) {
    const float height = (ring_.at[n_][j] - mean_[n_]) + a * (ring_.at[u_][j] - mean_[u_]) +
                         b * (ring_.at[v_][j] - mean_[v_]);
    sum += height * height;
  }
  return sum / static_cast<float>(ring_.count);
}

}  // namespace mtdb
