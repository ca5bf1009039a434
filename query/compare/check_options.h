// SPDX-License-Identifier: Apache-2.0
// What is checked of a comparison before anything is read, and what it does when nothing is said.
#pragma once

#include "query/compare.h"
#include "query/compare/side.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Errors: kInvalidArgument.
Status CheckCompareOptions(const Surface& a, const Surface& b, const CompareOptions& options);
// The width of intervals when neither width nor tolerance is given.
double StandardWidth(const Side& a, const Side& b);

}  // namespace mtdb::internal
