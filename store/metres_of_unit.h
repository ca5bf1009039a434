// SPDX-License-Identifier: Apache-2.0
// MetresOfUnit: how units of places and of heights compare.
#pragma once

#include <array>

#include "store/object_record.h"

namespace mtdb {

// How long a unit of x and one of y are in units that heights can be compared with: 1 and 1, but of
// a terrain in degrees the metres of a degree of longitude and of latitude at the middle of its
// bounds, on a sphere.
std::array<double, 2> MetresOfUnit(const ObjectRecord& record);

}  // namespace mtdb
