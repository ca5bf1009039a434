// Probes: the closest point of a surface, and the first hit of a ray, at an accuracy.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "query/surface.h"

namespace mtdb {

struct ProbeOptions {
  // Model units: triangles of at most this bound are good enough; negative: only those of the full
  // resolution are.
  double error_model = -1;
  // Nothing farther away is looked for. Closest point: a distance in model units. Ray: a parameter,
  // in lengths of its direction.
  double limit = std::numeric_limits<double>::infinity();
  // Cancels the probe from other threads (kCancelled). Must outlive it. May be null.
  QueryControl* control = nullptr;
};

// A point of the surface.
struct ProbeHit {
  Vec3d point;
  // Closest point: the distance in model units. Ray: the parameter t of origin + t * direction.
  double distance = 0;
  Triangle3d triangle{};  // which the point lies on, counter-clockwise from outside
  bool front = false;     // the probe comes from the triangle's outside
};

struct ProbeAnswer {
  std::optional<ProbeHit> hit;  // nullopt: nothing within the limit
  // How far the answer is good: the cut that it was taken from is accurate as far as `reach` from
  // the point, or up to the parameter `reach` of the ray. At least hit->distance; as far as the
  // object goes, or the limit, when there is no hit.
  double reach = 0;
  // Of the part of the surface within `reach`, in model units; see below. Means nothing without a
  // hit.
  double error_bound = 0;
  double excess =
      0;  // error_bound less error_model where rounding at ingest does not permit that; else 0
  uint32_t queries = 0;        // cuts that were made
  uint64_t clusters_read = 0;  // payloads read from the source, of all cuts
  uint64_t bytes_read = 0;
};

// The point of the surface that is closest to `point`.
//
// What it is exactly: the closest point of the mesh of one cut, the smallest for the ball of radius
// `reach` around `point` at the constant threshold error_model. At full resolution that is the
// closest point of the whole mesh as it is stored. At any accuracy its distance differs from the
// distance to the input by at most error_bound.
//
// How: cuts at falling thresholds; the closest triangle of each bounds the ball that the next one
// has to look at, so that fine clusters are read only where the answer can be. Memory: the
// triangles of a ball. Errors: kInvalidArgument (numbers that are not finite, a negative or NaN
// limit), those of reading clusters. Safe for many threads.
Result<ProbeAnswer> FindClosestPoint(const Surface& surface, Vec3d point,
                                     const ProbeOptions& options = {});

// The first point where a ray meets the surface, from whichever side: origin + t * direction with
// the smallest t in [0, limit]. The direction may have any length but 0.
//
// What it is exactly: the first hit of the mesh of one cut, the smallest for the part of the ray
// that lies within the object's bounds and not beyond `reach`, at the constant threshold
// error_model. At full resolution that is the first hit of the whole mesh as it is stored. At any
// accuracy the hit lies within error_bound of the input; what a ray grazes at a distance below that
// may be hit or missed. No ray slips through between two triangles. A triangle that the ray lies in
// is not hit, its neighbours are.
//
// How: as above; the first hit of a coarse cut says how far the next one has to look, and when the
// finest does not meet the ray there, it is asked for the rest. Errors: kInvalidArgument (a
// direction of length 0 among them), those of reading clusters. Safe for many threads.
Result<ProbeAnswer> CastRay(const Surface& surface, Vec3d origin, Vec3d direction,
                            const ProbeOptions& options = {});

}  // namespace mtdb
