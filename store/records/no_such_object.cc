// SPDX-License-Identifier: Apache-2.0
#include "store/records/no_such_object.h"

#include <algorithm>

namespace mtdb::internal {

Status NoSuchObject(const std::string& place, const std::string& name,
                    const std::vector<std::string>& there) {
  constexpr size_t kMostNamed = 5;
  if (there.empty()) return NotFound(place + ": no object " + name + "; it holds none");
  const size_t named = std::min(there.size(), kMostNamed);
  std::string names;
  for (size_t i = 0; i < named; ++i) names += (i == 0 ? "" : ", ") + there[i];
  if (named < there.size()) {
    names += " and " + std::to_string(there.size() - named) + " more; mtdb list shows all";
  }
  return NotFound(place + ": no object " + name + "; it holds " + names);
}

}  // namespace mtdb::internal
