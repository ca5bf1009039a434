// SPDX-License-Identifier: Apache-2.0
// Placement: an affine map of a surface into the coordinates of a comparison, and back.
#pragma once

#include "query/compare.h"
#include "store/base/status.h"

namespace mtdb::internal {

class Placement {
 public:
  Placement() = default;  // the identity
  // Errors: kInvalidArgument.
  static Result<Placement> Of(const Transform& transform);

  bool identity() const { return identity_; }
  Vec3d At(Vec3d p) const { return identity_ ? p : Map(forward_, p); }
  // Around all points of a box when they are mapped, or mapped back; larger by what rounding does.
  Box3d Around(const Box3d& box) const;
  Box3d AroundBack(const Box3d& box) const;
  // No distance grows by more than this factor.
  double stretch() const { return stretch_; }

 private:
  static Vec3d Map(const Transform& m, Vec3d p);
  static Box3d Around(const Transform& m, const Box3d& box);

  bool identity_ = true;
  Transform forward_ = kIdentity, back_ = kIdentity;
  double stretch_ = 1;
};

}  // namespace mtdb::internal
