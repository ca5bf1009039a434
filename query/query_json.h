// SPDX-License-Identifier: Apache-2.0
// Queries as JSON: the language of docs/query.md, which has every region, threshold and budget.
#pragma once

#include <string_view>

#include "query/camera.h"
#include "query/query.h"
#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb {

// The query that `text` (JSON in UTF-8) describes. `diagonal` is that of the object's bounds
// (ObjectRecord::diagonal()); relative errors are fractions of it. Errors: kInvalidArgument; the
// message begins with the place in the query ("region.union[1].sphere.radius: ...") or the byte in
// the text, and says what was expected and what was found. Safe on any bytes: depth, sizes and
// numbers are limited. Cost: about linear in the length of the text.
Result<Query> ParseQuery(std::string_view text, double diagonal);
// The same for an object. Of a terrain in degrees, places and directions are in degrees and heights
// in metres; what is a length (a radius, near and far, the distance of a threshold, a pixel) or an
// angle is one of metres, as long as a degree is at the middle (MetresOfUnit).
Result<Query> ParseQuery(std::string_view text, const ObjectRecord& record);

// The same for parts of a query: the value of its key "region", that of "threshold", and the camera
// of a frustum or of a threshold in pixels.
Result<RegionPtr> ParseRegion(std::string_view text);
Result<ThresholdPtr> ParseThreshold(std::string_view text, double diagonal);
Result<Camera> ParseCamera(std::string_view text);

}  // namespace mtdb
