// SPDX-License-Identifier: Apache-2.0
// Question: what a step asks of an object, in every language that there is, and what its region and
// threshold mean, point by point.
//
// Parameters of a step, all optional:
//   region     see kRegions in question.cc; none: everywhere. at: its middle, from 0,0,0 to 1,1,1
//   of
//              the object's box; r: its size, of the diagonal. region2, at2, r2: a second one;
//              combine: union (without) or intersection; outside: what lies outside of all that
//   threshold  full (without), or see ThresholdNames(); error, slope, error2: of the diagonal
//   triangles  a budget, of the object's triangles; bytes, ms: others
//   clip, normals, implicit
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "query/query.h"
#include "tests/everything/input.h"
#include "tests/everything/process.h"

namespace mtdb::everything {

using Json = nlohmann::ordered_json;

struct Question {
  Json json;
  std::optional<Arguments> options;  // the command line's, when it can say that
  Query query;
  bool implicit = false;

  bool everywhere = true;
  std::function<double(Vec3d)> depth;  // inside of the region, how deep at least; else negative
  // What a point may be off by; 0 for full resolution, infinite for anything.
  std::function<double(Vec3d)> permitted;
  double permitted_everywhere = -1;  // the same when it is one number; else negative
  bool full = false;                 // the input's own triangles in the region
  bool partly_full = false;          // and somewhere, as what is asked for is negative there
  std::optional<uint64_t> max_triangles;
  bool has_bytes = false;
  bool has_time = false;
  bool clip = false;
  bool normals = false;

  std::string text() const { return json.dump(); }
};

Question MakeQuestion(const Step& step, const Truth& truth, double diagonal);
// The step's question so many small moves before: regions and what thresholds look at lie back on
// a line, by `moves-by` of the object's size each, and with `grows` the first region is larger.
Step MovedBack(const Step& step, int64_t moves);
std::vector<std::string> RegionNames();
std::vector<std::string> ThresholdNames();

}  // namespace mtdb::everything
