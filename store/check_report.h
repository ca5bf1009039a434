// SPDX-License-Identifier: Apache-2.0
// CheckReport: what checks of an object found.
#pragma once

#include <string>
#include <vector>

namespace mtdb {

struct CheckReport {
  std::vector<std::string> checks;    // what was checked, a phrase each
  std::vector<std::string> failures;  // what is wrong: object, place, expected, found
  bool ok() const { return failures.empty(); }
};

}  // namespace mtdb
