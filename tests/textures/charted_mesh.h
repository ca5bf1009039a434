// SPDX-License-Identifier: Apache-2.0
// Bodies whose surface is cut into charts, as programs for photogrammetry cut it.
#pragma once

#include <cstdint>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

// What parts charts.
enum class Charting : uint32_t {
  kViews,      // each triangle lies in the chart of the axis that it looks along
  kPatches,    // squares of the grid that it is made from
  kSlit,       // one chart, cut open along a line that ends inside of the surface
  kTriangles,  // each triangle is a chart
};
inline constexpr uint32_t kChartings = 4;
const char* NameOf(Charting charting);

// A wavy torus (or, of kSlit, a wavy sheet) of columns x rows squares, two triangles each, on two
// pages. `stretch` in 0..1: how unevenly charts stretch the image.
TriangleMesh MakeCharted(Charting charting, uint32_t columns, uint32_t rows, double stretch,
                         uint32_t seed);

}  // namespace mtdb::testing
