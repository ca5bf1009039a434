// SPDX-License-Identifier: Apache-2.0
// What the programs that measure packed files ask for: a camera on its way around an object.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "bench/internal/recorded_ranges.h"
#include "query/query.h"
#include "query/surface.h"
#include "store/object_record.h"
#include "store/packed/packed_reader.h"

namespace mtdb {

using BenchClock = std::chrono::steady_clock;
double SecondsSince(BenchClock::time_point begin);

// A viewer of 1920x1080 pixels at `turn` of a way around the object's middle, 0.6 diagonals away,
// as a query in JSON (docs/query.md): what is in sight, to `pixels`.
std::string ViewJson(const ObjectRecord& record, double turn, double pixels);
Query View(const ObjectRecord& record, double turn, double pixels);
// One after the other, all around within 20 seconds at 60 frames a second.
std::vector<std::string> Flight(const ObjectRecord& record, size_t frames, double pixels);

// A packed file's first object, from nothing.
struct RemoteObject {
  std::shared_ptr<RecordedRanges> ranges;
  std::shared_ptr<Surface> surface;
};
Result<RemoteObject> OpenRemote(const std::string& place, const SurfaceOptions& options = {},
                                const internal::PackedRequests& requests = {});

// The number of pixels at which the view from the flight's beginning has some `triangles`.
Result<double> PixelsFor(const Surface& surface, uint64_t triangles);

}  // namespace mtdb
