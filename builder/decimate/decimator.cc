// SPDX-License-Identifier: Apache-2.0
#include "builder/decimate/decimator.h"

namespace mtdb::internal {

template class Decimator<SurfaceDistance, FreeFilling>;
template class Decimator<HeightDifference, DelaunayFilling>;
template class Decimator<HeightDifference, FreeFilling>;

}  // namespace mtdb::internal
