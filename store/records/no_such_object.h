// SPDX-License-Identifier: Apache-2.0
// What is said when an object is not there.
#pragma once

#include <string>
#include <vector>

#include "store/base/status.h"

namespace mtdb::internal {

// kNotFound: "a.mtdb: no object dragon; it holds bunny, nefertiti". `place` names the file,
// `there` its objects.
Status NoSuchObject(const std::string& place, const std::string& name,
                    const std::vector<std::string>& there);

// The same, for anything with a record.
template <class Objects, class RecordOf>
Status NoSuchObject(const std::string& place, const std::string& name, const Objects& objects,
                    RecordOf record_of) {
  std::vector<std::string> there;
  for (const auto& object : objects) there.push_back(record_of(object).name);
  return NoSuchObject(place, name, there);
}

}  // namespace mtdb::internal
