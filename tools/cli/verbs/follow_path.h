// SPDX-License-Identifier: Apache-2.0
// The file that `mtdb follow` takes its queries from: keyframes, and how many steps lead to each.
#pragma once

#include <string>
#include <vector>

#include "store/base/status.h"
#include "tools/request/query_options.h"

namespace mtdb {

inline constexpr size_t kMostSteps = 1'000'000;

// The queries of all steps. `text` has a JSON object a line, as docs/protocol.md has them ("mtdb
// follow"); empty lines and those that begin with # count for nothing. Errors: kInvalidArgument;
// the message begins with the line.
Result<Json::Array> ParseFollowPath(const std::string& text);

// The name of a step's file: `pattern` with the step in the place of its only %d or %03d.
// kInvalidArgument when it has no such place, or what is no name of a mesh file.
Result<std::string> StepFile(const std::string& pattern, size_t step);

}  // namespace mtdb
