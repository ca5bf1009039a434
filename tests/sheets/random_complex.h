// SPDX-License-Identifier: Apache-2.0
// Random small complexes in which sheets end, meet and touch in all the ways that there are.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/sheets/complex.h"

namespace mtdb::sheets {

// The ways, each the main part of a complex; flaps, crumbs, two-sided patches, seams of disagreeing
// orientation, duplicates and a random order of vertices and triangles come to all of them.
enum class Shape : uint8_t {
  kBook,      // k pages at a spine
  kWall,      // a wall on a floor that ends within it: a fin
  kRoom,      // a floor and two walls: three creases and more meet in a node
  kMoebius,   // a band with half a turn
  kSeam,      // a sheet of which a part runs the other way round
  kPatch,     // a sheet of which a part is two-sided
  kTouch,     // fans that have one vertex in common
  kClosed,    // closed components, one-sided and two-sided
  kBulkhead,  // a tube with a disk across: a closed crease of three sheets
  kMixture,   // a sheet with several of these on it
};
inline constexpr uint32_t kShapes = 10;
std::string NameOf(Shape shape);

inline constexpr uint32_t kNoExtra = ~uint32_t{0};
struct RandomComplex {
  Complex complex;          // 20 to 400 triangles
  uint64_t duplicates = 0;  // of these, faces that are there already in the same orientation
  // Of each triangle, to which of the flaps and crumbs it belongs, from 0 on, or kNoExtra.
  std::vector<uint32_t> extras;
};

// Coordinates are multiples of kLatticeStep, and all positions differ. The same seed gives the same
// complex.
inline constexpr double kLatticeStep = 1.0 / 4096;
RandomComplex MakeRandomComplex(Shape shape, uint32_t seed);

}  // namespace mtdb::sheets
