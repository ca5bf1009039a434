// SPDX-License-Identifier: Apache-2.0
// Why an object's coarsest mesh has no fewer triangles, as its builder counted.
#pragma once

#include <cstdint>
#include <string>

#include "store/object_record.h"

namespace mtdb {

// Of the coarsest mesh's vertices, why none of them could be removed any more.
struct RootReasons {
  uint64_t nonmanifold = 0;  // where chains of non-manifold edges end or meet, or parts touch
  uint64_t topology = 0;     // the surface would change its kind: last triangles of a part, borders
  uint64_t degree = 0;       // more neighbours than a node may have
  uint64_t seams = 0;        // on seams of tiles, about
  uint64_t bound = 0;        // the error would exceed what a removal may have
};
RootReasons ReasonsOf(const ObjectRecord& record);

// "no coarser mesh is stored: of the 40 vertices of the coarsest one, 38 are ...".
std::string RootReasonText(const ObjectRecord& record);

}  // namespace mtdb
