// SPDX-License-Identifier: Apache-2.0
// JsonValue: JSON text as a tree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "store/base/status.h"

namespace mtdb::internal {

// Its own reader and tree: nlohmann's tree asks for memory when it is destroyed, and ends the
// process when there is none, and its reader would be a tenth of the engine in a page.
class JsonValue {
 public:
  using Array = std::vector<JsonValue>;
  using Object = std::map<std::string, std::unique_ptr<JsonValue>>;
  using Value =
      std::variant<std::nullptr_t, bool, uint64_t, int64_t, double, std::string, Array, Object>;

  // Errors: kInvalidArgument, with the byte, for what is not JSON, has numbers beyond a double, or
  // has more than `deepest` braces and brackets within each other.
  static Result<JsonValue> Parse(std::string_view text, int deepest);

  JsonValue() = default;
  explicit JsonValue(Value value) : value_(std::move(value)) {}

  bool is_object() const { return std::holds_alternative<Object>(value_); }
  bool is_array() const { return std::holds_alternative<Array>(value_); }
  bool is_number() const { return value_.index() >= 2 && value_.index() <= 4; }
  // Null when it is something else.
  const bool* boolean() const { return std::get_if<bool>(&value_); }
  const uint64_t* whole_number() const { return std::get_if<uint64_t>(&value_); }
  double number() const;  // of is_number()

  // Entries of a list or an object; 0 of others.
  size_t size() const;
  bool contains(const char* key) const { return is_object() && members().contains(key); }
  const JsonValue& at(const char* key) const { return *members().at(key); }
  const JsonValue& at(size_t i) const { return std::get<Array>(value_).at(i); }
  const Object& members() const { return std::get<Object>(value_); }
  friend bool operator==(const JsonValue& a, const char* text) {
    const auto* const string = std::get_if<std::string>(&a.value_);
    return string != nullptr && *string == text;
  }

  // As JSON, on one line; of what is neither a list nor an object.
  std::string Text() const;

 private:
  friend class JsonReader;
  Value value_;
};

}  // namespace mtdb::internal
