#include "codecs/internal/hole_frame.h"

#include <algorithm>
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

HoleFrame::HoleFrame(const Patch& patch, const std::vector<Vec3i>& positions, bool boundary)
    : patch_(patch), positions_(positions) {
  const std::span<const uint32_t> ring = patch.ring();
  const auto k = static_cast<uint32_t>(ring.size());
  ring_.Gather(ring, positions);

  if (boundary) {
    for (size_t i = 0; i < 3; ++i) mean_[i] = ring_.at[i][k - 1] * 0.5f;
  } else {
    // Each ring vertex counts as often as hole triangles meet there.
    uint32_t sum[3] = {0, 0, 0};
    for (const uint32_t slot : patch.hole()) {
      for (const uint32_t v : patch.triangle(slot).corners) {
        for (int i = 0; i < 3; ++i) sum[i] += static_cast<uint32_t>(positions[v][i]);
      }
    }
    const auto count = static_cast<uint32_t>(3 * patch.hole().size());
    const float inverse = 1 / static_cast<float>(count);
    for (int i = 0; i < 3; ++i) {
      const uint32_t base = count * static_cast<uint32_t>(ring_.base[i]);
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
      p[i] = Load4(ring_.at[i] + j);
      q[i] = Load4(ring_.at[i] + j + 1);
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
  // The hole triangle above (u, v), by the areas of the three triangles that (u, v) cuts it into.
  const bool positive = normal_[n_] > 0;
  for (const uint32_t slot : patch_.hole()) {
    const auto& corners = patch_.triangle(slot).corners;
    const Vec3i& a = positions_[corners[0]];
    const Vec3i& b = positions_[corners[1]];
    const Vec3i& c = positions_[corners[2]];
    const float au = RingPoints::Offset(a[u_], u), av = RingPoints::Offset(a[v_], v);
    const float bu = RingPoints::Offset(b[u_], u), bv = RingPoints::Offset(b[v_], v);
    const float cu = RingPoints::Offset(c[u_], u), cv = RingPoints::Offset(c[v_], v);
    const float wa = bu * cv - bv * cu;
    const float wb = cu * av - cv * au;
    const float wc = au * bv - av * bu;
    const float low = std::min(std::min(wa, wb), wc);
    const float high = std::max(std::max(wa, wb), wc);
    const float area = wa + wb + wc;
    if ((positive ? low < 0 : high > 0) || area == 0) continue;
    const float bn = RingPoints::Offset(b[n_], a[n_]);
    const float cn = RingPoints::Offset(c[n_], a[n_]);
    return Shift(a[n_], Round((wb * bn + wc * cn) / area));
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
