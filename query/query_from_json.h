// SPDX-License-Identifier: Apache-2.0
// Queries of JSON that has been read, or put together, already; query/query_json.h reads text.
#pragma once

#include "query/camera.h"
#include "query/query.h"
#include "store/base/json.h"
#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb {

// How many braces and brackets a query has within each other at most.
inline constexpr int kDeepestQuery = 64;

// As ParseQuery, ParseRegion, ParseThreshold and ParseCamera.
Result<Query> QueryFromJson(const Json& json, double diagonal);
Result<Query> QueryFromJson(const Json& json, const ObjectRecord& record);
Result<RegionPtr> RegionFromJson(const Json& json);
Result<ThresholdPtr> ThresholdFromJson(const Json& json, double diagonal);
Result<Camera> CameraFromJson(const Json& json);

}  // namespace mtdb
