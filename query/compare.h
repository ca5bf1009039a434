// SPDX-License-Identifier: Apache-2.0
// Compare: how far two surfaces are apart, as intervals with a proof.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "query/surface.h"

namespace mtdb {

// The true distance is at least `low` and at most `high`, in model units.
struct DistanceInterval {
  double low = 0;
  double high = std::numeric_limits<double>::infinity();
  friend bool operator==(const DistanceInterval&, const DistanceInterval&) = default;
};

// Rows of a matrix that maps points (x, y, z, 1); the last row is 0, 0, 0, 1.
using Transform = std::array<double, 16>;
inline constexpr Transform kIdentity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

struct CompareOptions {
  // "Is each point of one surface within this of the other one?" Every place is decided. Without a
  // tolerance, the largest distance alone is looked for.
  std::optional<double> tolerance = {};
  // The interval of the largest distance becomes so narrow. Without tolerance and width: 1/10,000
  // of the diagonal around both.
  std::optional<double> width = {};
  // What is farther away than this has no counterpart: how far is not looked for.
  std::optional<double> reach = {};
  // Wall time. The answer then is what has been proved so far; 0 looks at the catalog alone.
  std::optional<double> max_milliseconds = {};
  // More places of a direction are joined with those that are nearest to them.
  size_t max_places = size_t{1} << 15;
  // Asked by any thread, before the comparison holds so many bytes beside the caches of the
  // surfaces; false ends it, as time does. Null: it holds what it needs.
  std::function<bool(uint64_t bytes)> may_hold = {};
  // Which points ask, in the coordinates of A, on both surfaces; never which may answer. Null: all.
  RegionPtr region = {};
  // Maps B into the coordinates of A, in which all answers are. Must be invertible.
  Transform transform = kIdentity;
  // Which surface's points ask for the other one.
  bool a_asks = true;
  bool b_asks = true;
  // True: of the surfaces as they are stored. False: of the inputs, whose positions were rounded
  // when they were stored, so that no interval is narrower than twice what rounding displaced.
  bool as_stored = false;
  unsigned threads = 0;             // 0: as many as the machine has
  QueryControl* control = nullptr;  // may be null; must outlive the call
};

enum class CompareVerdict : uint8_t { kWithin, kExceeds, kUndecided };

// A connected part of the asking surface that is farther away than the tolerance, or may be.
// Outside of the boxes of all places everything is within it. A place of up to 1/16 of the diagonal
// is not looked into without a width: some of it exceeds the tolerance, and where it ends is left
// open.
struct ComparePlace {
  Box3d box;    // around it
  Vec3d point;  // of the asking surface, up to the bound of the cut that it was found in
  DistanceInterval distance;  // of the farthest point inside of the box
  CompareVerdict verdict = CompareVerdict::kUndecided;
  bool missing = false;  // some of it is farther away than `reach`
};

// How far points of one surface are from the other one.
struct OneSidedDistance {
  DistanceInterval distance;  // of the farthest point; 0 when nothing asks
  // Where `distance.low` was found; nothing while that is 0.
  std::optional<Vec3d> point;
  CompareVerdict verdict = CompareVerdict::kUndecided;  // without a tolerance it stays undecided
  std::vector<ComparePlace> places;                     // with a tolerance; the farthest first
};

struct Comparison {
  // Equal digests: copies of one object, of which nothing was read.
  bool identical = false;
  // The larger of the two directions that were asked for.
  DistanceInterval distance;
  CompareVerdict verdict = CompareVerdict::kUndecided;
  std::optional<OneSidedDistance> a_to_b, b_to_a;
  // Both false: what is undecided is so because of rounding, or of the width.
  bool out_of_time = false;
  bool out_of_memory = false;  // `may_hold` said no
  uint64_t triangles = 0;      // that asked, at all accuracies
  uint64_t clusters_read = 0;
  uint64_t clusters_total = 0;  // of both objects
  uint64_t bytes_read = 0;
};

// The largest distance of a point of either surface from the other one (the Hausdorff distance),
// and where it exceeds a tolerance.
//
// How: for cuts of A and B with bounds a and b, a point of the cut of A at the distance d from that
// of B stands for points of the input whose distances lie in [d - a - b, d + a + b]. What that does
// not decide is asked again at a quarter of the error, and so on down to the full resolution; so
// fine clusters are read only where there is doubt. Distances of triangles are bounded from both
// sides, and all arithmetic is rounded outwards.
//
// Memory: beside the caches of the surfaces some 100 bytes for each triangle in doubt, and up to
// some 200 MB for the parts of cuts that are looked at. Errors: kInvalidArgument (numbers that are
// negative or NaN, a matrix without an inverse, a terrain whose places and heights are in different
// units), kCancelled, those of reading clusters. Safe for many threads.
Result<Comparison> Compare(const Surface& a, const Surface& b, const CompareOptions& options = {});

// The attributes that MapDistances adds: float32, rounded outwards.
inline constexpr const char* kLowDistance = "distance_low";
inline constexpr const char* kHighDistance = "distance_high";

// Sends A at full resolution to the sink, and of each vertex the interval of its distance from B as
// two more attributes. Intervals become as narrow as the width (without one, a quarter of the
// tolerance, or 1/10,000 of the diagonal around both) and decide the tolerance, as far as rounding
// lets them; beyond the reach they stay wide. Region, time and who asks mean nothing here. Memory
// does not depend on the size of A. Errors: those of Compare and of the sink; kInvalidArgument when
// A has such attributes.
Status MapDistances(const Surface& a, const Surface& b, const CompareOptions& options,
                    MeshSink& sink);

}  // namespace mtdb
