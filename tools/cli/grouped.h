// SPDX-License-Identifier: Apache-2.0
// Texts for people, and numbers in them: "1,234,567", "1 vertex".
#pragma once

#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <string>

#include "store/object_record.h"

namespace mtdb {

// As printf has it; at most 399 bytes.
__attribute__((format(printf, 1, 2))) inline std::string Formatted(const char* format, ...) {
  char text[400];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  return text;
}

inline std::string Grouped(uint64_t number) {
  std::string text = std::to_string(number);
  for (size_t at = text.size(); at > 3; at -= 3) text.insert(at - 3, ",");
  return text;
}

// `many`: "triangles".
inline std::string Counted(uint64_t number, const char* one, const char* many) {
  return Grouped(number) + " " + (number == 1 ? one : many);
}

// "2 triangles, 4 vertices, 1 component, 4 border edges".
inline std::string SurfaceText(const ObjectRecord& r) {
  return Counted(r.triangles, "triangle", "triangles") + ", " +
         Counted(r.vertices, "vertex", "vertices") + ", " +
         Counted(r.components, "component", "components") + ", " +
         Counted(r.boundary_edges, "border edge", "border edges");
}

}  // namespace mtdb
