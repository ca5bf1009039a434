// SPDX-License-Identifier: Apache-2.0
#include "query/probe.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "query/ask/probe_geometry.h"
#include "query/fields/promise.h"
#include "query/query_control.h"
#include "store/base/coordinate_limit.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kRoundUp = 1 + 1e-9;
constexpr double kFall = 16;  // of the threshold from cut to cut

Status CheckNumbers(Vec3d v, const char* name) {
  if (AreCoordinates(v)) return Status::Ok();
  return InvalidArgument(std::string(name) + ": expected numbers from -1e30 to 1e30");
}

Status CheckOptions(const ProbeOptions& options) {
  if (!(options.limit >= 0)) {
    return InvalidArgument("limit: expected a number that is not negative, found " +
                           std::to_string(options.limit));
  }
  if (std::isnan(options.error_model)) return InvalidArgument("error: expected a number");
  return Status::Ok();
}

// Thresholds from the root's down to the one asked for.
std::vector<double> FallingErrors(const ObjectRecord& record, double last) {
  std::vector<double> errors;
  double error = BoundOf(record.grid, record.error_code_max, record.rounding_error);
  // No node has an error between 0 and the unit.
  const double least = BoundOf(record.grid, 1, record.rounding_error);
  for (; error > std::max(last, least); error /= kFall) errors.push_back(error);
  errors.push_back(last);
  return errors;
}

// The triangles of a cut that meet the region.
Result<TriangleMesh> TrianglesAt(const Surface& surface, RegionPtr region, double error,
                                 QueryControl* control, ProbeAnswer* answer) {
  Query query;
  query.region = std::move(region);
  query.threshold = ConstantThreshold(error);
  query.clip = true;
  query.control = control;
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, surface.Extract(query, sink));
  ++answer->queries;
  answer->clusters_read += stats.clusters_read;
  answer->bytes_read += stats.bytes_read;
  answer->error_bound = stats.error_bound;
  answer->excess = error < 0 ? 0 : std::max(0.0, stats.error_bound - error);
  return mesh;
}

Triangle3d Corners(const TriangleMesh& mesh, const TriangleVertices& t) {
  return {mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
}

Vec3d Normal(const Triangle3d& t) { return Cross(t[1] - t[0], t[2] - t[0]); }

// By more than the rounding of a ray from `origin`.
Box3d Widened(const Box3d& box, Vec3d origin) {
  if (box.empty()) return box;
  const double by = 1e-9 * Diagonal(box) + 1e-12 * (Length(origin) + Length(box.max));
  return {box.min - Vec3d{by, by, by}, box.max + Vec3d{by, by, by}};
}

// Calls f(triangle) for each, as long as the control lets it.
template <typename F>
Status ForEachTriangle(const TriangleMesh& mesh, const QueryControl* control, F&& f) {
  constexpr size_t kPerLook = 512;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (i % kPerLook == 0 && control != nullptr && control->cancelled()) {
      return {StatusCode::kCancelled, "the probe was cancelled"};
    }
    f(Corners(mesh, mesh.triangles[i]));
  }
  return Status::Ok();
}

Result<std::optional<ProbeHit>> Closest(const TriangleMesh& mesh, Vec3d point,
                                        const QueryControl* control) {
  std::optional<ProbeHit> best;
  double best2 = kInfinity;
  MTDB_RETURN_IF_ERROR(ForEachTriangle(mesh, control, [&](const Triangle3d& t) {
    const Vec3d q = ClosestPointOfTriangle(point, t);
    const double d2 = SquaredLength(point - q);
    if (best && d2 >= best2) return;
    best2 = d2;
    best = ProbeHit{q, std::sqrt(d2), 0, t, Dot(Normal(t), point - t[0]) > 0};
  }));
  return best;
}

Result<std::optional<ProbeHit>> FirstHit(const TriangleMesh& mesh, const RayCaster& ray,
                                         Vec3d direction, double last,
                                         const QueryControl* control) {
  std::optional<ProbeHit> best;
  MTDB_RETURN_IF_ERROR(ForEachTriangle(mesh, control, [&](const Triangle3d& t) {
    const std::optional<double> hit = ray.Hit(t);
    if (!hit || *hit > last || (best && *hit >= best->parameter)) return;
    best = ProbeHit{ray.At(*hit), *hit * ray.length(), *hit, t, Dot(Normal(t), direction) < 0};
  }));
  return best;
}

// Why the next ball is large enough: some input is within error_bound of the closest point of this
// cut, hence within d + error_bound of the probe; what stands for it in the next cut is within the
// next threshold of that. Were it not, because the errors of a damaged object lie, the ball would
// meet nothing, and grows.
Result<ProbeAnswer> ProbePoint(const Surface& surface, Vec3d point, const ProbeOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckNumbers(point, "point"));
  MTDB_RETURN_IF_ERROR(CheckOptions(options));
  const ObjectRecord& record = surface.record();
  double farthest2 = 0;
  for (int i = 0; i < 3; ++i) {
    const double d = std::max(std::abs(record.bounds.min[i] - point[i]),
                              std::abs(record.bounds.max[i] - point[i]));
    farthest2 += d * d;
  }
  const double all = std::min(options.limit, std::sqrt(farthest2) * kRoundUp);
  ProbeAnswer answer;
  answer.reach = all;
  const std::vector<double> errors = FallingErrors(record, options.error_model);
  for (size_t i = 0; i + 1 < errors.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                          TrianglesAt(surface, SphereRegion(point, answer.reach), errors[i],
                                      options.control, &answer));
    MTDB_ASSIGN_OR_RETURN(const std::optional<ProbeHit> hit, Closest(mesh, point, options.control));
    if (!hit) continue;
    const double next =
        hit->distance + answer.error_bound + std::max(errors[i + 1], record.rounding_error);
    answer.reach = std::min(answer.reach, next * kRoundUp);
  }
  // Of an exact surface the reach may be 0, and rounding may put the point beside it.
  const double least = all * 1e-15;
  for (;; answer.reach = std::min(all, 2 * std::max(answer.reach, least))) {
    MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                          TrianglesAt(surface, SphereRegion(point, answer.reach), errors.back(),
                                      options.control, &answer));
    MTDB_ASSIGN_OR_RETURN(answer.hit, Closest(mesh, point, options.control));
    if (answer.hit || answer.reach >= all) return answer;
  }
}

Result<ProbeAnswer> ProbeRay(const Surface& surface, Vec3d origin, Vec3d direction,
                             const ProbeOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckNumbers(origin, "origin"));
  MTDB_RETURN_IF_ERROR(CheckNumbers(direction, "direction"));
  MTDB_RETURN_IF_ERROR(CheckOptions(options));
  const double longest =
      std::max({std::abs(direction.x), std::abs(direction.y), std::abs(direction.z)});
  if (!(longest > 0) || !std::isfinite(1 / longest)) {
    return InvalidArgument("direction: its length is 0, expected a direction");
  }
  const ObjectRecord& record = surface.record();
  ProbeAnswer answer;
  answer.reach = options.limit;
  const RayCaster ray(origin, direction);
  const std::optional<RayCaster::Interval> inside = ray.Clip(Widened(record.bounds, origin));
  if (!inside || inside->begin > options.limit) return answer;
  const double all = std::min(inside->end, options.limit);
  answer.reach = all;
  const std::vector<double> errors = FallingErrors(record, options.error_model);
  for (size_t i = 0; i + 1 < errors.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                          TrianglesAt(surface, RayRegion(ray, inside->begin, answer.reach),
                                      errors[i], options.control, &answer));
    MTDB_ASSIGN_OR_RETURN(const std::optional<ProbeHit> hit,
                          FirstHit(mesh, ray, direction, answer.reach, options.control));
    if (!hit) continue;
    // The finer surface is that far away across, and most often not much farther along the ray.
    constexpr double kAlong = 4;
    answer.reach =
        std::min(answer.reach, hit->parameter + kAlong * answer.error_bound / ray.length());
  }
  for (;; answer.reach = all) {
    MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                          TrianglesAt(surface, RayRegion(ray, inside->begin, answer.reach),
                                      errors.back(), options.control, &answer));
    MTDB_ASSIGN_OR_RETURN(answer.hit,
                          FirstHit(mesh, ray, direction, answer.reach, options.control));
    if (answer.hit || answer.reach >= all) return answer;
  }
}

}  // namespace

Result<ProbeAnswer> FindClosestPoint(const Surface& surface, Vec3d point,
                                     const ProbeOptions& options) {
  return CatchOutOfMemory([&] { return ProbePoint(surface, point, options); });
}

Result<ProbeAnswer> CastRay(const Surface& surface, Vec3d origin, Vec3d direction,
                            const ProbeOptions& options) {
  return CatchOutOfMemory([&] { return ProbeRay(surface, origin, direction, options); });
}

}  // namespace mtdb
