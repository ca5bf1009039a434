#include "codecs/internal/hole_frame.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "codecs/client_mesh.h"

namespace mtdb {

namespace {

float Offset(int32_t to, int32_t from) {
  return static_cast<float>(
      static_cast<int32_t>(static_cast<uint32_t>(to) - static_cast<uint32_t>(from)));
}

// 1 / i, rounded.
constexpr auto kInverse = [] {
  std::array<float, 3 * kMaxRing + 1> inverse{};
  for (size_t i = 1; i < inverse.size(); ++i) inverse[i] = 1.0f / static_cast<float>(i);
  return inverse;
}();

}  // namespace

// Sums up the corners of at most four triangles.
template <typename Mesh>
inline Float4 HoleFrame::Gather(const Mesh& patch, std::span<const uint32_t> slots,
                                uint32_t base_vertex, Corners& corners) {
  const Word4* const points = patch.points();
  const Word4 base = points[base_vertex];
  const std::array<uint32_t, 3> none = {base_vertex, base_vertex, base_vertex};
  const std::array<uint32_t, 3>* vertices[4];
  for (size_t i = 0; i < 4; ++i) {
    vertices[i] = i < slots.size() ? &patch.triangle(slots[i]).corners : &none;
  }
  Float4 sum{};
  for (size_t c = 0; c < 3; ++c) {
    Float4 offsets[4];
    for (size_t i = 0; i < 4; ++i) {
      offsets[i] = Offset4(points[(*vertices[i])[c]], base);
      sum += offsets[i];
    }
    const Columns4 columns = Transpose(offsets[0], offsets[1], offsets[2], offsets[3]);
    Store4(corners.at[c][0], columns.x);
    Store4(corners.at[c][1], columns.y);
    Store4(corners.at[c][2], columns.z);
  }
  return sum;
}

template <typename Mesh>
void HoleFrame::Set(const Mesh& patch, std::span<const uint32_t> slots,
                    std::span<const uint32_t> ring, bool boundary) {
  base_vertex_ = ring[0];
  const Word4* const points = patch.points();
  const Word4 base = points[base_vertex_];
  Float4 sum{}, squares{}, products{}, cross{};  // products: xy yz zx; cross: its z x y
  Float4 p{}, turned{};                          // the vertex before; at first, the offset 0
  for (size_t j = 1; j < ring.size(); ++j) {
    const Float4 q = Offset4(points[ring[j]], base);
    const Float4 q_turned = Turn(q);
    sum += q;
    squares += q * q;
    products += q * q_turned;
    cross += p * q_turned - turned * q;
    p = q;
    turned = q_turned;
  }
  // Each ring vertex counts as often as hole triangles meet there.
  Float4 corners =
      Gather(patch, slots.first(std::min<size_t>(slots.size(), 4)), base_vertex_, first_corners_);
  for (size_t h = 4; h < slots.size(); ++h) {
    for (const uint32_t c : patch.triangle(slots[h]).corners) corners += Offset4(points[c], base);
  }
  const Float4 mean = boundary ? p * 0.5f : corners * kInverse[3 * slots.size()];
  const Float4 normal = Turn(cross);

  // Moments about the predicted point: of (p - m)(q - n), sum(pq) - m sum(q) - n sum(p) + k m n.
  const auto count = static_cast<float>(ring.size());
  const float inverse = kInverse[ring.size()];
  const Float4 m = count * mean;
  const Float4 mean_turned = Turn(mean);
  const Float4 variance = (squares - 2 * mean * sum + m * mean) * inverse;
  const Float4 covariance =
      (products - mean * Turn(sum) - mean_turned * sum + m * mean_turned) * inverse;

  const float x = std::abs(normal[0]);
  const float y = std::abs(normal[1]);
  const float z = std::abs(normal[2]);
  // Without branches, which would be hard to predict.
  const int longer = x > y ? 0 : 1;
  const int n = longer + (2 - longer) * static_cast<int>(!(std::max(x, y) > z));
  constexpr int kNext[] = {1, 2, 0};
  n_ = n;
  u_ = kNext[n];
  v_ = kNext[u_];
  float by_axis[3][4];
  Store4(by_axis[0], variance);
  Store4(by_axis[1], covariance);
  Store4(by_axis[2], normal);
  const float normal_n = by_axis[2][n];
  side_ = std::copysign(1.0f, normal_n);
  const Float4 slope_n = normal_n == 0 ? Float4{} : normal / normal_n;
  const Float4 slope_squares = slope_n * slope_n;
  slant_ = normal_n == 0 ? 1 : std::sqrt(slope_squares[0] + slope_squares[1] + slope_squares[2]);
  Store4(mean_, mean);
  Store4(slope_n_, slope_n);
  Store4(base_, base);
  const float uv = by_axis[1][u_];
  variance_u_ = std::max(by_axis[0][u_], 0.0f);
  slope_v_ = variance_u_ > 0 ? uv / variance_u_ : 0;
  variance_v_ = std::max(by_axis[0][axis_v()] - slope_v_ * uv, 0.0f);
}

int32_t HoleFrame::ExpectU() const { return Shift(base_[u_], RoundCoordinate(mean_[u_])); }

int32_t HoleFrame::ExpectV(int32_t u) const {
  const float du = Offset(u, base_[u_]);
  const int v = axis_v();
  return Shift(base_[v], RoundCoordinate(mean_[v] + slope_v_ * (du - mean_[u_])));
}

template <typename Mesh>
int32_t HoleFrame::ExpectN(const Mesh& patch, std::span<const uint32_t> slots, int32_t u,
                           int32_t v) const {
  const int n = axis_n();
  const float du = Offset(u, base_[u_]);
  const float dv = Offset(v, base_[axis_v()]);
  // The hole triangle above (u, v), by the areas of the three triangles that (u, v) cuts it into;
  // four hole triangles at a time.
  Corners others;
  const Corners* corners = &first_corners_;
  for (size_t h = 0;;) {
    const auto axis = [&](int corner, int i) { return Load4<Float4>(corners->at[corner][i]); };
    const Float4 au = axis(0, u_) - du, av = axis(0, axis_v()) - dv;
    const Float4 bu = axis(1, u_) - du, bv = axis(1, axis_v()) - dv;
    const Float4 cu = axis(2, u_) - du, cv = axis(2, axis_v()) - dv;
    const Float4 wa = bu * cv - bv * cu;
    const Float4 wb = cu * av - cv * au;
    const Float4 wc = au * bv - av * bu;
    const Float4 area = wa + wb + wc;
    const Int4 inside = (wa * side_ >= 0) & (wb * side_ >= 0) & (wc * side_ >= 0) & (area != 0);
    if (const uint32_t lanes = MaskBits(inside); lanes != 0) {
      const Float4 heights = (wa * axis(0, n) + wb * axis(1, n) + wc * axis(2, n)) / area;
      return Shift(base_[n], RoundCoordinate(heights[std::countr_zero(lanes)]));
    }
    h += 4;
    if (h >= slots.size()) break;
    Gather(patch, slots.subspan(h, std::min<size_t>(slots.size() - h, 4)), base_vertex_, others);
    corners = &others;
  }
  const float height =
      mean_[n] - (slope_n_[u_] * (du - mean_[u_]) + slope_n_[axis_v()] * (dv - mean_[axis_v()]));
  return Shift(base_[n], RoundCoordinate(height));
}

template <typename Mesh>
float HoleFrame::unevenness(const Mesh& patch, std::span<const uint32_t> ring) const {
  const int v = axis_v();
  const int n = axis_n();
  const auto base = Load4<Word4>(base_);
  float sum = 0;
  for (const uint32_t vertex : ring) {
    float at[4];
    Store4(at, Offset4(patch.points()[vertex], base));
    const float height =
        (at[n] - mean_[n]) + slope_n_[u_] * (at[u_] - mean_[u_]) + slope_n_[v] * (at[v] - mean_[v]);
    sum += height * height;
  }
  return sum * kInverse[ring.size()];
}

template void HoleFrame::Set(const Patch&, std::span<const uint32_t>, std::span<const uint32_t>,
                             bool);
template int32_t HoleFrame::ExpectN(const Patch&, std::span<const uint32_t>, int32_t,
                                    int32_t) const;
template float HoleFrame::unevenness(const Patch&, std::span<const uint32_t>) const;
template void HoleFrame::Set(const ClientMesh&, std::span<const uint32_t>,
                             std::span<const uint32_t>, bool);
template int32_t HoleFrame::ExpectN(const ClientMesh&, std::span<const uint32_t>, int32_t,
                                    int32_t) const;
template float HoleFrame::unevenness(const ClientMesh&, std::span<const uint32_t>) const;

}  // namespace mtdb
