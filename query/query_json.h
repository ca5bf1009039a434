// Queries as JSON: the language of docs/query.md, which has every region, threshold and budget.
#pragma once

#include <string_view>

#include "query/camera.h"
#include "query/query.h"
#include "store/base/status.h"

namespace mtdb {

// The query that `text` (JSON in UTF-8) asks for. `diagonal` is that of the object's bounds
// (ObjectRecord::diagonal()): what relative errors are a fraction of. Errors: kInvalidArgument; the
// message begins with the place ("region.union[1].sphere.radius: ...") or the byte and says what
// was expected and found. Safe on any bytes: depth, sizes and numbers are limited. Cost: about
// linear in the length of the text.
Result<Query> ParseQuery(std::string_view text, double diagonal);

// Parts of a query: the values of its keys "region" and "threshold", and the camera of frusta and
// thresholds on the screen. Otherwise as above.
Result<RegionPtr> ParseRegion(std::string_view text);
Result<ThresholdPtr> ParseThreshold(std::string_view text, double diagonal);
Result<Camera> ParseCamera(std::string_view text);

}  // namespace mtdb
