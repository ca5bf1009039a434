// SPDX-License-Identifier: Apache-2.0
// The options of extract and render that say what is asked for, as a query in JSON.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "query/query_json.h"
#include "store/base/json.h"
#include "store/base/status.h"
#include "tools/request/arguments.h"

namespace mtdb {

// As ParseQuery.
inline Result<Query> QueryFromJson(const Json& json, const ObjectRecord& record) {
  return ParseQuery(json.Text(), record);
}

// The value of a text that is a query. Errors: those of ParseQuery.
inline Result<Json> ParseQueryText(const std::string& text) {
  MTDB_RETURN_IF_ERROR(ParseQuery(text, 0).status());
  return Json::Parse(text);
}

// Parts of a query are as docs/query.md has them.
struct QueryOptions {
  bool full = false;
  std::optional<double> error;           // model units
  std::optional<double> error_relative;  // of the diagonal
  std::optional<double> pixels;
  Json::Array errors_at;                // thresholds by distance from a point
  std::optional<double> error_outside;  // of the regions
  std::optional<uint64_t> triangles;
  std::optional<uint64_t> max_bytes;
  std::optional<double> max_ms;
  bool normals = false;

  Json::Array regions;
  bool frustum = false;
  bool intersect = false;  // of the regions, not their union
  bool outside = false;
  bool clip = false;

  std::optional<Json> eye, target, up;  // points
  std::optional<double> fov;            // degrees
  std::optional<Extent> viewport;

  std::string file;  // with a query; then no region and no threshold

  bool has_camera() const { return eye && target; }
};

// The texts of options as parts of a query. An error is kInvalidArgument and says what was
// expected.
Result<Json> PointOption(const std::string& text);
Result<Json> BoxOption(const std::string& text);
Result<Json> SphereOption(const std::string& text);
Result<Json> HalfSpaceOption(const std::string& text);
Result<Json> PointRegionOption(const std::string& text);
Result<Json> SegmentOption(const std::string& text);
Result<Json> TubeOption(const std::string& text);
Result<Json> PrismOption(const std::string& text);
Result<Json> WedgeOption(const std::string& text);
Result<Json> ErrorAtOption(const std::string& text);

// Finds options that lack others or do not go with them. `draws`: the camera alone is of use.
// Errors are kInvalidArgument and begin with the option.
Status CheckOptions(const QueryOptions& options, bool draws);
// The camera of options that have one. Without a viewport of their own, it is `viewport`.
Json CameraOf(const QueryOptions& options, const Extent& viewport);
// What the options ask for. Reads `file`. Errors: kNotFound, kIoError, kInvalidArgument.
Result<Json> QueryOf(const QueryOptions& options, const Extent& viewport);

}  // namespace mtdb
