// SPDX-License-Identifier: Apache-2.0
#include "query/compare/side.h"

#include <algorithm>
#include <utility>

#include "query/compare/outward.h"
#include "query/fields/promise.h"

namespace mtdb::internal {

Side::Side(const Surface& surface, const Placement& placement, bool as_stored,
           QueryControl* control)
    : surface_(surface),
      placement_(placement),
      as_stored_(as_stored),
      control_(control),
      bounds_(placement.Around(surface.record().bounds)) {}

double Side::BoundOf(uint8_t code) const {
  const ObjectRecord& record = surface_.record();
  return Common(internal::BoundOf(record.grid, code, record.rounding_error));
}

// Errors are distances from what is stored, bounds such from the input.
double Side::Common(double own_bound) const {
  const double rounding = surface_.record().rounding_error;
  if (!as_stored_) return Up(own_bound * placement_.stretch());
  if (own_bound == rounding) return 0;
  return Up((own_bound - rounding + 0x1p-50 * rounding) * placement_.stretch());
}

RegionPtr Side::OwnRegion(const BoxSetPtr& boxes, double by) const {
  if (boxes == nullptr) return nullptr;
  if (placement_.identity()) return AroundBoxes(boxes, by);
  std::vector<Box3d> own;
  own.reserve(boxes->boxes().size());
  for (const Box3d& box : boxes->boxes()) own.push_back(placement_.AroundBack(Grown(box, by)));
  return AroundBoxes(std::make_shared<BoxSet>(std::move(own)), 0);
}

// What stands for a point of the surface is at most the bound away from it, and valid where the
// point is in the region, so that its bound is at most the threshold.
Result<std::optional<Patch>> Side::Take(const BoxSetPtr& boxes, double by, double threshold,
                                        uint64_t most, Reading* reading) const {
  const double rounding = surface_.record().rounding_error;
  const double own = threshold < 0 ? -1 : threshold / placement_.stretch();
  const double reach = Up(std::max(own, rounding) * placement_.stretch());
  Query query;
  query.threshold = own < 0 ? nullptr : ConstantThreshold(own + (as_stored_ ? rounding : 0));
  query.region =
      OwnRegion(boxes, Up(by + reach + (as_stored_ ? Up(rounding * placement_.stretch()) : 0)));
  query.clip = boxes != nullptr;
  query.control = control_;
  MTDB_ASSIGN_OR_RETURN(Cut cut, surface_.Select(query));
  std::optional<Patch> patch;
  TriangleMesh mesh;
  if (cut.triangle_count() <= most) {
    TriangleMeshSink sink(&mesh);
    MTDB_RETURN_IF_ERROR(cut.Emit(sink));
    patch.emplace();
    patch->bound = Common(cut.error_bound());
    for (Vec3d& p : mesh.positions) p = placement_.At(p);
    patch->triangles.reserve(mesh.triangles.size());
    for (const TriangleVertices& t : mesh.triangles) {
      patch->triangles.push_back(
          {mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]});
    }
  }
  reading->clusters += cut.stats().clusters_read;
  reading->bytes += cut.stats().bytes_read;
  return patch;
}

}  // namespace mtdb::internal
