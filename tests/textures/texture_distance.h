// SPDX-License-Identifier: Apache-2.0
// How far two textured surfaces are apart, in space and in the image, by search.
#pragma once

#include <random>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

// Of `samples` random points of `from`: the largest of the least values, over the points of `to` on
// the same page, of the larger of the distance and `scale` times the difference of u, v. Each least
// value is found within some parts in a thousand, above it. Points farther than `far` count as
// that.
double LargestTextureDistance(const TriangleMesh& from, const TriangleMesh& to, double scale,
                              double far, size_t samples, std::mt19937& random);

}  // namespace mtdb::testing
