// SPDX-License-Identifier: Apache-2.0
// TooDeepAt: where a JSON text nests deeper than its reader's recursion should go.
#pragma once

#include <cstddef>
#include <string_view>

namespace mtdb {

// The byte of the first brace or bracket that has `deepest` others around it, or npos. Of a text
// that is not JSON some byte, or npos.
inline size_t TooDeepAt(std::string_view json, int deepest) {
  int depth = 0;
  bool quoted = false;
  for (size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (quoted && c == '\\') {
      ++i;
    } else if (c == '"') {
      quoted = !quoted;
    } else if (!quoted && (c == '{' || c == '[')) {
      if (++depth > deepest) return i;
    } else if (!quoted && (c == '}' || c == ']')) {
      --depth;
    }
  }
  return std::string_view::npos;
}

}  // namespace mtdb
