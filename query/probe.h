// SPDX-License-Identifier: Apache-2.0
// Probes: the closest point of a surface, and the first hit of a ray, at an accuracy.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "query/surface.h"

namespace mtdb {

struct ProbeOptions {
  // Model units: the largest bound of a triangle that is good enough. Negative: only triangles of
  // the full resolution are.
  double error_model = -1;
  // How far away the probe looks. Closest point: a distance in model units. Ray: the largest
  // parameter t of origin + t * direction.
  double limit = std::numeric_limits<double>::infinity();
  // Lets other threads cancel the probe (kCancelled). Must outlive the probe. May be null.
  QueryControl* control = nullptr;
};

// A point of the surface.
struct ProbeHit {
  Vec3d point;
  double distance = 0;    // model units, from the point of the probe or the ray's origin
  double parameter = 0;   // ray: the t of origin + t * direction; closest point: 0
  Triangle3d triangle{};  // that the point lies on, counter-clockwise from outside
  bool front = false;     // true when the probe comes from the outside of this triangle
};

struct ProbeAnswer {
  std::optional<ProbeHit> hit;  // nullopt: nothing within the limit
  // How far away the answer holds: the cut that it was taken from is accurate up to the distance
  // `reach` from the point, or up to the parameter `reach` of the ray. At least hit->distance, or
  // hit->parameter. When there is no hit, it is the limit, or as far as the object goes.
  double reach = 0;
  // The error bound of the part of that cut within `reach`, in model units; the functions below say
  // what it promises. Means nothing without a hit.
  double error_bound = 0;
  // error_bound less error_model when rounding at ingest makes error_model impossible; else 0.
  double excess = 0;
  uint32_t queries = 0;        // how many cuts were made
  uint64_t clusters_read = 0;  // payloads that these cuts read from the source
  uint64_t bytes_read = 0;
};

// The point of the surface that is closest to `point`.
//
// What it is exactly: the closest point of the mesh of one cut, the smallest for the ball of radius
// `reach` around `point` at the constant threshold error_model. At full resolution that is the
// closest point of the whole mesh as it is stored. At any accuracy its distance differs from the
// distance to the input by at most error_bound.
//
// How: it makes cuts at falling thresholds. The closest triangle of each cut bounds the ball in
// which the next cut has to look, so that fine clusters are read only where the answer can be.
// Memory: the triangles in a ball. Errors: kInvalidArgument (numbers beyond 1e30 or NaN, a
// negative or NaN limit), those of reading clusters. Safe for many threads.
Result<ProbeAnswer> FindClosestPoint(const Surface& surface, Vec3d point,
                                     const ProbeOptions& options = {});

// The first point where a ray meets the surface, from whichever side: origin + t * direction with
// the smallest t in [0, limit]. The direction may have any length but 0.
//
// What it is exactly: the first hit of the mesh of one cut, the smallest for the part of the ray
// that lies within the object's bounds and not beyond `reach`, at the constant threshold
// error_model. At full resolution that is the first hit of the whole mesh as it is stored. At any
// accuracy the hit lies within error_bound of the input; a ray that passes the input at less than
// that distance may hit or miss it. No ray slips through between two triangles. A ray that lies in
// the plane of a triangle does not hit this triangle, but its neighbours.
//
// How: as above. The first hit of a coarse cut says how far along the ray the next cut has to look.
// When the finest cut does not meet the ray that far, another one looks at the rest. Errors:
// kInvalidArgument (also for a direction of length 0), those of reading clusters. Safe for many
// threads.
Result<ProbeAnswer> CastRay(const Surface& surface, Vec3d origin, Vec3d direction,
                            const ProbeOptions& options = {});

}  // namespace mtdb
