// SPDX-License-Identifier: Apache-2.0
// ShowBothSides: a decoded cluster with a slot for either side of its two-sided triangles.
#pragma once

#include <cstdint>
#include <vector>

#include "codecs/cluster/cluster.h"

namespace mtdb {

// A payload tells of a two-sided triangle once. Behind it nobody needs to know of sides: the other
// one is a triangle like others, which the same node creates and the same node, or child, removes.
//
// The sides of a listed triangle follow each other. A node has its fans one after the other, as
// before, and behind each that is two-sided its other side: the same ring, the other way round. So
// does its hole. In the star of a crumb's node the sides of a triangle follow each other. Returns
// per slot that of the other side, kNone32 where there is none.
std::vector<uint32_t> ShowBothSides(Cluster& cluster);

}  // namespace mtdb
