// SPDX-License-Identifier: Apache-2.0
// Reading JSON that others may have changed: what is missing, or is of another kind, is thrown as
// UnexpectedJson, and caught where the file can be named.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

#include "store/base/json.h"

namespace mtdb {

struct UnexpectedJson : std::runtime_error {
  using std::runtime_error::runtime_error;
};

inline const Json& At(const Json& object, std::string_view key) {
  if (!object.is_object() || !object.contains(key)) {
    throw UnexpectedJson("expected a member " + std::string(key));
  }
  return object[key];
}
inline const Json& At(const Json& array, size_t i) {
  if (!array.is_array() || i >= array.size()) {
    throw UnexpectedJson("expected a list of more than " + std::to_string(i) + " elements");
  }
  return array[i];
}
inline const Json::Array& ElementsOf(const Json& array) {
  if (!array.is_array()) throw UnexpectedJson("expected a list, found " + array.Text());
  return array.elements();
}
inline double NumberOf(const Json& number) {
  if (!number.is_number()) throw UnexpectedJson("expected a number, found " + number.Text());
  return number.number();
}
inline uint64_t CountOf(const Json& number) {
  if (number.whole_number() == nullptr) {
    throw UnexpectedJson("expected a whole number, found " + number.Text());
  }
  return *number.whole_number();
}
inline bool FlagOf(const Json& flag) {
  if (flag.boolean() == nullptr)
    throw UnexpectedJson("expected true or false, found " + flag.Text());
  return *flag.boolean();
}
inline const std::string& TextOf(const Json& text) {
  if (text.string() == nullptr) throw UnexpectedJson("expected a text, found " + text.Text());
  return *text.string();
}

}  // namespace mtdb
