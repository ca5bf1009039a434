// SPDX-License-Identifier: Apache-2.0
// What probe is asked for.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "store/database.h"
#include "tools/request/arguments.h"

namespace mtdb {

struct ProbeArguments {
  std::string store;
  OpenOptions open;
  std::string name;
  std::optional<Vec3d> point;                  // either this
  std::optional<Ray> ray;                      // or this
  std::vector<std::array<double, 2>> heights;  // or these, of a terrain
  std::string heights_file;                    // or those of a file; "-": standard input
  std::optional<AskedError> error;
  std::optional<double> limit;
  bool json = false;
};
// With heights.
Status ProbeHeights(const ProbeArguments& arguments);

}  // namespace mtdb
