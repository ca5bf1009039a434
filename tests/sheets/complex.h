// SPDX-License-Identifier: Apache-2.0
// A mesh as plain vectors: what the checker of sheets reads. It shares no code with mtdb.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace mtdb::sheets {

using Point = std::array<double, 3>;
using Triangle = std::array<uint32_t, 3>;

struct Complex {
  std::vector<Point> points;
  std::vector<Triangle> triangles;
};

}  // namespace mtdb::sheets
