// SPDX-License-Identifier: Apache-2.0
// GeoidOver: how far the sea's level is from the ellipsoid, about.
#pragma once

#include "tools/tiles/places/globe_grid.h"

namespace mtdb {

// Metres above the ellipsoid.
struct GeoidRange {
  int low = 0, high = 0;
};

// The least and the largest height of the geoid EGM96 in the cells of ten degrees that the
// rectangle meets, in whole metres: the geoid is between them everywhere in the rectangle. It says
// by how much heights are off that are above the sea and are taken for heights above the ellipsoid.
GeoidRange GeoidOver(const GlobeRectangle& rectangle);

}  // namespace mtdb
