// SPDX-License-Identifier: Apache-2.0
// CompareHeights: how much higher or lower one terrain is than another one, and the volumes of cut
// and fill between them, as intervals with a proof.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "query/compare.h"
#include "query/surface.h"

namespace mtdb {

// The true value is at least `low` and at most `high`.
struct ValueInterval {
  double low = 0;
  double high = 0;
  friend bool operator==(const ValueInterval&, const ValueInterval&) = default;
};

struct HeightChangeOptions {
  // "Is no height of B farther from that of A than this?" Without a width, nothing else is looked
  // for.
  std::optional<double> tolerance = {};
  // In units of height: the largest rise and fall become known to within this, and the volumes to
  // within this times the area that both terrains cover. Without tolerance and width: 1/10,000 of
  // the range of heights of both.
  std::optional<double> width = {};
  // Wall time; the answer then is what has been proved so far.
  std::optional<double> max_milliseconds = {};
  // Least x and y, largest x and y: all numbers are of this part of the plane. Nothing: all of it.
  std::optional<std::array<double, 4>> window = {};
  // True: of the terrains as they are stored. False: heights of the inputs, which were rounded when
  // they were stored. Where they cover the plane is told as it is stored in any case.
  bool as_stored = false;
  unsigned threads = 0;             // 0: as many as the machine has
  QueryControl* control = nullptr;  // may be null; must outlive the call
};

// The largest difference of heights in one direction, 0 where there is none.
struct LargestChange {
  ValueInterval height;        // in units of height
  std::optional<Vec3d> point;  // on B, where `height.low` was found; nothing while that is 0
};

// From A to B, over the places that both have. Areas are in units of x times y, volumes in these
// times units of height.
struct HeightChange {
  bool identical = false;  // copies of one object, of which nothing was read
  CompareVerdict verdict = CompareVerdict::kUndecided;  // undecided without a tolerance
  LargestChange rise, fall;                             // of B above A, and below
  ValueInterval fill_volume;                            // the volume above A and below B
  ValueInterval cut_volume;                             // below A and above B
  ValueInterval net_volume;                             // fill less cut
  ValueInterval area_both;                              // that both cover
  ValueInterval area_a, area_b;                         // that A alone covers, that B alone does
  bool out_of_time = false;
  uint64_t triangles = 0;  // of all cuts that were looked at
  uint64_t clusters_read = 0;
  uint64_t clusters_total = 0;  // of both objects
  uint64_t bytes_read = 0;
};

// Heights are compared straight up and down, not with what is nearest (query/compare.h): what earth
// moved, and where places and heights are in different units. Both objects are terrains
// (query/heights.h) in one coordinate system.
//
// How: over a rectangle of the plane a cut of A that is off by at most a, and one of B by at most
// b, are laid over each other. On each common part d, the difference of their heights, is a linear
// function, which is integrated exactly; the true one is in [d - a - b, d + a + b]. Rectangles that
// leave most in doubt are asked again, in quarters and with a quarter of the error, down to the
// full resolution. Borders that cuts simplify are looked at in full resolution.
//
// Memory: beside the caches of the surfaces some 40 MB a thread, and 300 bytes for each few
// thousand triangles that were looked at. Errors: kInvalidArgument (no terrains; different units of
// height; one in degrees and one not; numbers that are negative or NaN; an empty window),
// kCancelled, those of reading clusters. Safe for many threads.
Result<HeightChange> CompareHeights(const Surface& a, const Surface& b,
                                    const HeightChangeOptions& options = {});

}  // namespace mtdb
