// SPDX-License-Identifier: Apache-2.0
// HoleFrame for the holes of a client's mesh.
#include "codecs/coding/hole_frame.h"
#include "codecs/coding/hole_frame.inc"
#include "codecs/stream/internal/replayed_mesh.h"

namespace mtdb {

template void HoleFrame::Set(const internal::ReplayedMesh&, std::span<const uint32_t>,
                             std::span<const uint32_t>, bool, bool);
template int32_t HoleFrame::ExpectN(const internal::ReplayedMesh&, std::span<const uint32_t>,
                                    int32_t, int32_t) const;
template float HoleFrame::unevenness(const internal::ReplayedMesh&,
                                     std::span<const uint32_t>) const;

}  // namespace mtdb
