// SPDX-License-Identifier: Apache-2.0
#include "codecs/coding/hole_frame.h"

#include "codecs/coding/hole_frame.inc"

namespace mtdb {

int32_t HoleFrame::ExpectU() const { return Shift(base_[u_], RoundCoordinate(mean_[u_])); }

int32_t HoleFrame::ExpectV(int32_t u) const {
  const float du = Offset(u, base_[u_]);
  const int v = axis_v();
  return Shift(base_[v], RoundCoordinate(mean_[v] + slope_v_ * (du - mean_[u_])));
}

template void HoleFrame::Set(const Patch&, std::span<const uint32_t>, std::span<const uint32_t>,
                             bool, bool);
template int32_t HoleFrame::ExpectN(const Patch&, std::span<const uint32_t>, int32_t,
                                    int32_t) const;
template float HoleFrame::unevenness(const Patch&, std::span<const uint32_t>) const;

}  // namespace mtdb
