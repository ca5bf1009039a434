// SPDX-License-Identifier: Apache-2.0
#include "query/terrain/terrain_patch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "query/compare/outward.h"
#include "query/fields/promise.h"

namespace mtdb::internal {
namespace {

// An edge of a single triangle that runs through the inside of the rectangle is a border of the
// cut: of other edges that meet the rectangle, both triangles do, and so are there.
bool HasBorderWithin(const TriangleMesh& mesh, const PlaneWindow& window) {
  using Edge = std::pair<VertexIndex, VertexIndex>;
  std::vector<Edge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const TriangleVertices& t : mesh.triangles) {
    for (size_t i = 0; i < 3; ++i) edges.push_back(std::minmax(t[i], t[(i + 1) % 3]));
  }
  std::ranges::sort(edges);
  for (size_t i = 0; i < edges.size();) {
    const bool twice = i + 1 < edges.size() && edges[i] == edges[i + 1];
    if (!twice) {
      const Vec3d a = mesh.positions[edges[i].first], b = mesh.positions[edges[i].second];
      // The part of the edge inside of all four sides, or a little outside.
      double begin = 0, end = 1;
      const auto cut = [&](double at_a, double at_b) {
        if (at_a <= 0 && at_b <= 0) end = -1;
        if (at_a < 0 && at_b > 0) begin = std::max(begin, at_a / (at_a - at_b));
        if (at_a > 0 && at_b < 0) end = std::min(end, at_a / (at_a - at_b));
      };
      cut(a.x - window.min_x, b.x - window.min_x);
      cut(window.max_x - a.x, window.max_x - b.x);
      cut(a.y - window.min_y, b.y - window.min_y);
      cut(window.max_y - a.y, window.max_y - b.y);
      if (begin <= end) return true;
    }
    i += twice ? 2 : 1;
  }
  return false;
}

bool MeetsInside(const Triangle3d& t, const PlaneWindow& window) {
  PlanePolygon part{PlaneTriangle(t)};
  part.ClipTo(window);
  return !part.empty() && part.area() > 0;
}

}  // namespace

double TerrainSide::ErrorOf(double bound) const {
  const double rounding = record().rounding_error;
  if (!as_stored_) return bound;
  return bound == rounding ? 0 : Up(bound - rounding + 0x1p-50 * rounding);
}

double TerrainSide::largest_error() const {
  return ErrorOf(BoundOf(record().grid, record().error_code_max, record().rounding_error));
}

double TerrainSide::least_error() const { return ErrorOf(record().rounding_error); }

Result<std::optional<TerrainPatch>> TerrainSide::Take(const PlaneWindow& window, double threshold,
                                                      uint64_t most) {
  const Box3d& bounds = record().bounds;
  const double aside = kOutward * LargestMagnitude(bounds);
  const double above = 1 + std::abs(bounds.min.z) + std::abs(bounds.max.z);
  Query query;
  query.region = BoxRegion({{window.min_x - aside, window.min_y - aside, bounds.min.z - above},
                            {window.max_x + aside, window.max_y + aside, bounds.max.z + above}});
  query.threshold = threshold < 0
                        ? nullptr
                        : ConstantThreshold(threshold + (as_stored_ ? record().rounding_error : 0));
  query.clip = true;
  query.control = control_;
  MTDB_ASSIGN_OR_RETURN(Cut cut, surface_.Select(query));
  std::optional<TerrainPatch> patch;
  TriangleMesh mesh;
  if (cut.triangle_count() <= most) {
    TriangleMeshSink sink(&mesh);
    MTDB_RETURN_IF_ERROR(cut.Emit(sink));
    patch.emplace();
    patch->error = ErrorOf(cut.error_bound());
    double least = bounds.max.z, largest = bounds.min.z;
    bool meets = false;
    patch->triangles.reserve(mesh.triangles.size());
    for (const TriangleVertices& t : mesh.triangles) {
      const Triangle3d corners{mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
      patch->triangles.push_back(corners);
      for (const Vec3d& p : corners) least = std::min(least, p.z), largest = std::max(largest, p.z);
      meets = meets || MeetsInside(corners, window);
    }
    patch->least_height = least - patch->error;
    patch->largest_height = largest + patch->error;
    const bool moved =
        patch->error > least_error() && record().border_moves && !mesh.triangles.empty();
    patch->may_cover_more = moved && (!meets || HasBorderWithin(mesh, window));
  }
  reading_.triangles += patch ? patch->triangles.size() : 0;
  reading_.clusters += cut.stats().clusters_read;
  reading_.bytes += cut.stats().bytes_read;
  return patch;
}

}  // namespace mtdb::internal
