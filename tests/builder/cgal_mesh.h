// SPDX-License-Identifier: Apache-2.0
// What CGAL says of a mesh: an oracle that shares nothing with mtdb.
#pragma once

#include <cstdint>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

struct CgalFacts {
  bool manifold = false;  // conforming, oriented, manifold with or without border; no duplicates
  // The rest only when manifold.
  bool closed = false;
  int64_t euler_characteristic = 0;
  uint64_t border_loops = 0;
  uint64_t border_edges = 0;
  uint64_t components = 0;
};

CgalFacts AskCgal(const TriangleMesh& mesh);

}  // namespace mtdb::testing
