// SPDX-License-Identifier: Apache-2.0
// What types of attributes are called in answers and messages.
#pragma once

#include <array>
#include <cstddef>

#include "store/base/attributes.h"

namespace mtdb {

inline const char* ScalarName(ScalarType type) {
  constexpr std::array<const char*, 8> kNames{"int8",  "uint8",  "int16",   "uint16",
                                              "int32", "uint32", "float32", "float64"};
  return kNames.at(static_cast<size_t>(type));
}

}  // namespace mtdb
