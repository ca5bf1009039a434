// SPDX-License-Identifier: Apache-2.0
// Numbers into rows of attributes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <string>

#include "store/base/attributes.h"

namespace mtdb::internal {

// Puts `value`, rounded and cut to what the type holds; returns what is behind it.
inline std::byte* PutScalar(double value, ScalarType type, std::byte* at) {
  const auto put = [&]<typename T>(T number) {
    if constexpr (std::numeric_limits<T>::is_integer) {
      const double whole = std::isnan(value) ? 0 : std::nearbyint(value);
      number = static_cast<T>(std::clamp(whole, static_cast<double>(std::numeric_limits<T>::min()),
                                         static_cast<double>(std::numeric_limits<T>::max())));
    } else {
      number = static_cast<T>(value);
    }
    std::memcpy(at, &number, sizeof(number));
    return at + sizeof(number);
  };
  switch (type) {
    case ScalarType::kInt8: return put(int8_t{});
    case ScalarType::kUint8: return put(uint8_t{});
    case ScalarType::kInt16: return put(int16_t{});
    case ScalarType::kUint16: return put(uint16_t{});
    case ScalarType::kInt32: return put(int32_t{});
    case ScalarType::kUint32: return put(uint32_t{});
    case ScalarType::kFloat32: return put(float{});
    case ScalarType::kFloat64: return put(double{});
  }
  return at;
}

}  // namespace mtdb::internal
