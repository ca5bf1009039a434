// SPDX-License-Identifier: Apache-2.0
// From where a mesh is looked at: the sides that views are named after.
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "store/base/estimate_up.h"
#include "store/base/geometry.h"

namespace mtdb {

inline constexpr std::array kViewNames = {"auto",  "front", "back",   "left",
                                          "right", "top",   "bottom", "iso"};

// The direction of view, of length 1, for a name of kViewNames. The front is seen along y when z is
// up, along -z when y is; left and right are the viewer's, as seen from the front. "auto" looks
// from the front and the right, from a little above; more from the right where that side of
// `points` is much the broader one, and from higher above where they are flat.
Vec3d ViewDirection(std::string_view name, Vec3d up, std::span<const Vec3d> points);
// What is up in a picture that looks along `direction`: `up`, or where that is the same line, the
// side at the back of the front view.
Vec3d UpOfView(Vec3d direction, Vec3d up);

}  // namespace mtdb
