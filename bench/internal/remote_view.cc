// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/remote_view.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "query/query_json.h"
#include "store/packed/open_ranges.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr double kDistance = 0.6;  // diagonals
constexpr double kHeight = 0.2;
constexpr double kFramesAround = 1200;

}  // namespace

double SecondsSince(BenchClock::time_point begin) {
  return std::chrono::duration<double>(BenchClock::now() - begin).count();
}

std::string ViewJson(const ObjectRecord& record, double turn, double pixels) {
  const Vec3d middle = (record.bounds.min + record.bounds.max) * 0.5;
  const double angle = 2 * std::numbers::pi * turn;
  const Vec3d away{std::sin(angle), -std::cos(angle), kHeight};
  const Vec3d eye = middle + away * (kDistance * record.diagonal());
  const auto point = [](const Vec3d& p) { return nlohmann::json{p[0], p[1], p[2]}; };
  const nlohmann::json camera = {
      {"eye", point(eye)}, {"target", point(middle)}, {"fov", 45}, {"viewport", {1920, 1080}}};
  const nlohmann::json query = {
      {"region", {{"frustum", camera}}},
      {"threshold", {{"screen", {{"camera", camera}, {"pixels", pixels}}}}}};
  return query.dump();
}

Query View(const ObjectRecord& record, double turn, double pixels) {
  return ParseQuery(ViewJson(record, turn, pixels), record.diagonal()).value();
}

std::vector<std::string> Flight(const ObjectRecord& record, size_t frames, double pixels) {
  std::vector<std::string> queries(frames);
  for (size_t f = 0; f < frames; ++f) {
    queries[f] = ViewJson(record, static_cast<double>(f) / kFramesAround, pixels);
  }
  return queries;
}

Result<RemoteObject> OpenRemote(const std::string& place, const SurfaceOptions& options,
                                const PackedRequests& requests) {
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<RangeReader> inner, OpenPackedRanges(place));
  if (inner == nullptr) return InvalidArgument(place + ": not a packed file; mtdb pack makes one");
  RemoteObject object;
  object.ranges = std::make_shared<RecordedRanges>(std::move(inner));
  MTDB_ASSIGN_OR_RETURN(const auto file, PackedFile::Open(object.ranges));
  MTDB_ASSIGN_OR_RETURN(
      auto source,
      PackedSource::Open(file, file->objects()[0], object.ranges->answers_at_once(), requests));
  MTDB_ASSIGN_OR_RETURN(object.surface, Surface::Open(std::move(source), options));
  return object;
}

Result<double> PixelsFor(const Surface& surface, uint64_t triangles) {
  double low = 1e-3, high = 100;  // pixels: too many triangles, too few
  while (high / low > 1.02) {
    const double middle = std::sqrt(low * high);
    Query query = View(surface.record(), 0, middle);
    query.max_triangles = 2 * triangles;
    MTDB_ASSIGN_OR_RETURN(const Cut cut, surface.Select(query));
    (cut.triangle_count() > triangles ? low : high) = middle;
  }
  return high;
}

}  // namespace mtdb
