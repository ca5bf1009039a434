// SPDX-License-Identifier: Apache-2.0
// What Debian 12's Emscripten lacks of C++20; included first, by tools/wasm_check only.
#pragma once

#include <bit>
#include <cstddef>
#include <memory>
#include <type_traits>

#ifndef __cpp_lib_bit_cast
namespace std {
template <typename To, typename From>
constexpr To bit_cast(const From& from) noexcept {
  return __builtin_bit_cast(To, from);
}
}  // namespace std
#endif

#ifndef __cpp_lib_smart_ptr_for_overwrite
namespace std {
template <typename T>
unique_ptr<T> make_unique_for_overwrite(size_t count) {
  return unique_ptr<T>(new remove_extent_t<T>[count]);
}
}  // namespace std
#endif
