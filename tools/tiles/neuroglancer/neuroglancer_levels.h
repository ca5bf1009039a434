// SPDX-License-Identifier: Apache-2.0
// MakeNeuroglancerLevels: an object as fragments of a multi-resolution mesh for neuroglancer.
#pragma once

#include <memory>

#include "store/object_record.h"
#include "tools/tiles/neuroglancer/fragment_manifest.h"
#include "tools/tiles/tile_format.h"

namespace mtdb {

struct NeuroglancerOptions {
  Vec3d resolution{1, 1, 1};  // nanometres of a unit of x, y and z
  Vec3d moved;                // nanometres that clients add to all stored positions
  int bits = 16;              // of positions in a fragment: 10 or 16
  uint64_t tile_triangles = 50'000;
};

// A file of the folder beside the fragments: an encoded FragmentManifest.
inline constexpr char kFragmentManifest[] = "manifest";
// A fragment's name in the folder.
std::string FragmentPath(size_t level, const FragmentCell& cell);

// Level 0 is the finest one, at full resolution; the others have a quarter of the triangles of the
// level below, and cells of twice its sides. Triangles are cut at the planes between cells and, but
// on level 0, halfway between these, so that both sides agree and no triangle crosses the middle of
// a fragment, by which clients take it apart. Positions are rounded to whole numbers of the cell;
// equal corners become equal numbers in all fragments, so that a level has no cracks.
//
// Bounds are in nanometres: that of the cut, along the longest of the object's units, and half of
// the diagonal of a step of positions.
std::unique_ptr<TileFormat> MakeNeuroglancerLevels(const ObjectRecord& record,
                                                   const NeuroglancerOptions& options);

}  // namespace mtdb
