// SPDX-License-Identifier: Apache-2.0
// TilePlacement: from an object's coordinates to the metres of a tile set, and onto the globe.
#pragma once

#include <optional>

#include "store/base/json.h"
#include "store/object_record.h"
#include "tools/tiles/level/level_mesh.h"
#include "tools/tiles/places/geodesy.h"

namespace mtdb {

// A terrain whose x and y are longitude and latitude.
bool IsInDegrees(const ObjectRecord& record);
// What a unit of the object's lengths, of a terrain in degrees of its heights, is in metres; 1
// where nobody said it.
double MetresOf(const ObjectRecord& record);

// Most objects keep their axes and become metres; a terrain in degrees becomes east, north and up
// of its middle, in metres, on the ellipsoid. All positions of a level become points of a lattice,
// whose steps are powers of two of the object's grid, where it has one.
class TilePlacement {
 public:
  // `at`: see ThreeDTilesOptions; not of a terrain in degrees.
  TilePlacement(const ObjectRecord& record, const std::optional<GlobePlace>& at);

  Vec3d Place(Vec3d p) const;
  // Back again, up to rounding.
  Vec3d Unplace(Vec3d p) const;
  const Box3d& bounds() const { return bounds_; }  // around all places
  double metres() const { return metres_; }        // of a unit of errors
  Vec3d origin() const { return origin_; }         // of all lattices
  // The largest step that moves no position by more than `rounding`, or the smallest there is.
  double StepFor(double rounding) const;
  // Whether places lie on the lattice of this step.
  bool IsExact(double step) const { return on_grid_ && step == least_step_; }
  // How far the plane triangles of the mesh are at most from the curved ones that the object's are
  // on the globe; 0 but of a terrain in degrees.
  double Bend(const LevelMesh& mesh) const;
  // The root's matrix, column by column; none: it is the unit.
  std::optional<Json> Transform() const;

 private:
  Box3d PlacedBounds(const Box3d& box) const;

  bool in_degrees_;
  double metres_ = 1;
  std::optional<LocalFrame> frame_;  // on the globe
  std::optional<GlobePlace> at_;
  Vec3d up_{0, 0, 1};
  double latitude_ = 0;  // in degrees: the farthest from the equator
  Box3d bounds_;
  Vec3d origin_;
  bool on_grid_ = false;
  double least_step_ = 1;
};

}  // namespace mtdb
