// SPDX-License-Identifier: Apache-2.0
// Camera: a perspective viewpoint, for what is in sight and how large it looks.
#pragma once

#include <limits>

#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb {

// In model units; right-handed: `right` is direction x up. The depth of a point is its distance
// from the eye along the direction of view. Points of the picture whose depth is between `near` and
// `far` are in sight.
struct Camera {
  Vec3d eye;
  Vec3d direction{0, 1, 0};  // of view; any length above 0
  Vec3d up{0, 0, 1};         // any length above 0, not along the direction
  double vertical_fov_rad = 0.8;
  int width_px = 1200;
  int height_px = 900;
  double near = 0;  // >= 0
  double far = std::numeric_limits<double>::infinity();

  // kInvalidArgument when a value is wrong; the message says which. Functions that take a camera
  // require that this is Ok.
  Status Validate() const;

  struct Axes {  // of length 1, at right angles
    Vec3d right, up, forward;
  };
  Axes axes() const;
  // Half the height and half the width of the picture at depth 1.
  double tangent_y() const;
  double tangent_x() const;
  // The size of a pixel at depth 1.
  double pixel() const { return 2 * tangent_y() / height_px; }
};

}  // namespace mtdb
