// SPDX-License-Identifier: Apache-2.0
// Numbers to text: the shortest that reads back as the same value, without a locale.
#pragma once

#include <charconv>
#include <string>
#include <type_traits>

namespace mtdb::internal {

template <typename T>
requires std::is_arithmetic_v<T>
void AppendNumber(std::string* out, T value) {
  char text[32];
  const auto result = std::to_chars(text, text + sizeof(text), value);
  out->append(text, result.ptr);
}

// A coordinate, as a float32 when `single`.
inline void AppendCoordinate(std::string* out, double value, bool single) {
  if (single) {
    AppendNumber(out, static_cast<float>(value));
  } else {
    AppendNumber(out, value);
  }
}

}  // namespace mtdb::internal
