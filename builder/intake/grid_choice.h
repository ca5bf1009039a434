// SPDX-License-Identifier: Apache-2.0
// GridChoice: chooses the grid of an object from its input, and counts what the grid does to it.
#pragma once

#include <cstdint>

#include "builder/intake/input_mesh.h"
#include "builder/mesh_survey.h"

namespace mtdb::internal {

// Sets of `*survey` all that concerns edges, grids and the store, from a pass over the input's
// triangles. The options' grid is taken when they name one; otherwise:
//
// 1. The step is at most a quarter of the edges' first percentile, at 16 to 24 bits.
// 2. Up to four more bits are spent so that no triangle loses its area, and more so that no more
//    than one in 100,000 does. Triangles that are too thin for any grid ask for nothing.
// 3. Where coordinates are decimals, the step is their unit, so that they are kept as they are
//    written: that of the axis with the finest one, or, where it asks for too much, that of
//    another axis, such as the heights of a terrain; a half, a quarter ... of it, where other
//    axes need that. It may take four bits more than 1 and 2, or fewer bits.
//
// A triangle that has area in the input and loses it by rounding is counted, however thin it is; a
// grid that takes it from too many is the survey's `refusal`, which names what lies far off.
//
// Deterministic: the triangles' order and the memory do not matter. Errors: kBadInput (bounds that
// are too large for double), and those of GatherCorners().
Status ChooseGrid(const InputMesh& input, const BuildOptions& options, const SpoolSpace* space,
                  size_t memory_bytes, MeshSurvey* survey);

}  // namespace mtdb::internal
