// SPDX-License-Identifier: Apache-2.0
// Json: JSON as a value, which is read from text and written as text.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb {

// Of an object. A template, as it has a value and is needed where a value is defined.
template <typename Value>
struct JsonMember {
  std::string name;
  Value value;
  friend bool operator==(const JsonMember&, const JsonMember&) = default;
};

// A value goes away without asking for memory, as nlohmann's do not, which end the process when
// there is none.
class Json {
 public:
  using Member = JsonMember<Json>;
  using Array = std::vector<Json>;
  using Object = std::vector<Member>;  // in the order of the text, or as they were added

  // Errors: kInvalidArgument, with the byte, for what is not JSON, has numbers beyond a double, or
  // has more than `deepest` braces and brackets within each other. Of several members with one name
  // the last one counts.
  static Result<Json> Parse(std::string_view text, int deepest = 70);
  // Null for what is no object.
  static Json ParseObject(std::string_view text);

  Json() = default;  // null
  // By assignment: when a variant's copy constructor throws, libstdc++ 12 destroys what is not
  // there.
  Json(const Json& other) { *this = other; }
  Json(Json&&) = default;
  Json& operator=(const Json&) = default;
  Json& operator=(Json&&) = default;
  Json(std::nullptr_t) {}
  Json(std::same_as<bool> auto value) : value_(value) {}
  template <std::integral T>
  requires(!std::same_as<T, bool>) Json(T value) {
    if (std::signed_integral<T> && value < 0) {
      value_ = static_cast<int64_t>(value);
    } else {
      value_ = static_cast<uint64_t>(value);
    }
  }
  Json(std::floating_point auto value) : value_(static_cast<double>(value)) {}
  Json(std::string text) : value_(std::move(text)) {}
  Json(std::string_view text) : value_(std::string(text)) {}
  Json(const char* text) : value_(std::string(text)) {}
  Json(Array elements) : value_(std::move(elements)) {}
  Json(Object members);
  template <typename T>
  Json(const std::vector<T>& values) : value_(Array(values.begin(), values.end())) {}
  template <typename T, size_t kCount>
  Json(const std::array<T, kCount>& values) : value_(Array(values.begin(), values.end())) {}
  explicit Json(const Vec3d& point) : Json(Array{point.x, point.y, point.z}) {}
  // An object when all are pairs that begin with a text, {{"key", value}, ...}; else an array.
  Json(std::initializer_list<Json> values);

  bool is_null() const { return value_.index() == 0; }
  bool is_number() const { return value_.index() >= 2 && value_.index() <= 4; }
  bool is_array() const { return std::holds_alternative<Array>(value_); }
  bool is_object() const { return std::holds_alternative<Object>(value_); }
  // Null when it is something else.
  const bool* boolean() const { return std::get_if<bool>(&value_); }
  const uint64_t* whole_number() const { return std::get_if<uint64_t>(&value_); }
  const std::string* string() const { return std::get_if<std::string>(&value_); }
  double number() const;  // of is_number()

  // elements() is for what is_array() says, and members() for what is_object() says; of other
  // values they throw std::bad_variant_access.
  // Of an array; a null becomes one by push_back().
  const Array& elements() const { return std::get<Array>(value_); }
  Array& elements() { return std::get<Array>(value_); }
  const Json& operator[](size_t i) const;  // null when there is none
  Json& push_back(Json value);

  // Of an object; a null becomes one by [], which adds what is not there. Cost: linear in the
  // members.
  const Object& members() const { return std::get<Object>(value_); }
  Object& members() { return std::get<Object>(value_); }
  Json& operator[](std::string_view key);
  const Json& operator[](std::string_view key) const;  // null when there is none
  bool contains(std::string_view key) const;
  // Sets all members of another object.
  void Update(const Json& other);
  // Takes a member away; null when there is none.
  Json Take(std::string_view key);
  // The first of the names in the alphabet that is not among the known ones; null: there is none.
  const std::string* UnknownKey(const std::vector<const char*>& known) const;

  // Entries of an array or an object; 0 of others.
  size_t size() const;

  // Numbers are equal by what they are worth, objects when their members have the same order.
  friend bool operator==(const Json& a, const Json& b);

  // On one line; on one line and in ASCII; or with a line for each entry. Numbers are short texts
  // that are the same double again, or null when they are not finite. What is not UTF-8 becomes
  // U+FFFD.
  enum class Form { kLine, kAscii, kLines };
  std::string Text(Form form = Form::kLine) const;

 private:
  friend class JsonReader;
  friend class JsonWriter;
  std::variant<std::nullptr_t, bool, uint64_t, int64_t, double, std::string, Array, Object> value_;
};

}  // namespace mtdb
