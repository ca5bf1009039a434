// Queries as JSON: the language of --query, specified in docs/query.md.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "query/query.h"
#include "store/base/status.h"

namespace mtdb {

using QueryJson = nlohmann::ordered_json;

// All errors are kInvalidArgument, begin with the place ("region.union[1].sphere.radius") and say
// what was expected and found. Safe on any input: depth, sizes and numbers are limited.

// Text as JSON that has passed for depth and syntax.
Result<QueryJson> ParseQueryText(const std::string& text);
// `diagonal` is the object's: what relative errors are a fraction of.
Result<Query> QueryFromJson(const QueryJson& json, double diagonal);
// Parts of a query; `path` begins the messages.
Result<RegionPtr> RegionFromJson(const QueryJson& json, const std::string& path);
Result<ThresholdPtr> ThresholdFromJson(const QueryJson& json, const std::string& path,
                                       double diagonal);
Result<Camera> CameraFromJson(const QueryJson& json, const std::string& path);

}  // namespace mtdb
