// SPDX-License-Identifier: Apache-2.0
#include "query/internal/json_value.h"

#include <cerrno>  // which nlohmann uses and does not include everywhere
#include <nlohmann/json.hpp>

#include "store/base/json_depth.h"

namespace mtdb::internal {
// NOLINTBEGIN(readability-identifier-naming): nlohmann calls these.
class JsonBuilder {
 public:
  bool null() { return Add(nullptr); }
  bool boolean(bool value) { return Add(value); }
  bool number_integer(int64_t value) { return Add(value); }
  bool number_unsigned(uint64_t value) { return Add(value); }
  bool number_float(double value, const std::string&) { return Add(value); }
  bool string(std::string& value) { return Add(std::move(value)); }
  bool binary(nlohmann::json::binary_t&) { return false; }
  bool start_object(size_t) { return Open(JsonValue::Object()); }
  bool start_array(size_t) { return Open(JsonValue::Array()); }
  bool key(std::string& name) {
    key_ = std::move(name);
    return true;
  }
  bool end_object() { return Close(); }
  bool end_array() { return Close(); }
  bool parse_error(size_t position, const std::string&, const nlohmann::json::exception& e) {
    constexpr int kNumberOverflow = 406;
    status_ = InvalidArgument(e.id == kNumberOverflow
                                  ? "a number that is too large for JSON"
                                  : "byte " + std::to_string(position) + ": not JSON");
    return false;
  }

  const Status& status() const { return status_; }
  JsonValue Take() { return std::move(root_); }

 private:
  JsonValue& Place(JsonValue value) {
    if (open_.empty()) return root_ = std::move(value);
    if (auto* const list = std::get_if<JsonValue::Array>(&open_.back()->value_)) {
      return list->emplace_back(std::move(value));
    }
    auto& member = std::get<JsonValue::Object>(open_.back()->value_)[key_];
    member = std::make_unique<JsonValue>(std::move(value));
    return *member;
  }
  bool Add(JsonValue::Value value) {
    Place(JsonValue(std::move(value)));
    return true;
  }
  // What is around stays where it is meanwhile.
  bool Open(JsonValue::Value value) {
    open_.push_back(&Place(JsonValue(std::move(value))));
    return true;
  }
  bool Close() {
    open_.pop_back();
    return true;
  }

  JsonValue root_;
  std::vector<JsonValue*> open_;
  std::string key_;
  Status status_;
};
// NOLINTEND(readability-identifier-naming)

Result<JsonValue> JsonValue::Parse(std::string_view text, int deepest) {
  if (const size_t at = TooDeepAt(text, deepest); at != std::string_view::npos) {
    return InvalidArgument("byte " + std::to_string(at) + ": more than " + std::to_string(deepest) +
                           " braces and brackets within each other");
  }
  JsonBuilder builder;
  if (!nlohmann::json::sax_parse(text, &builder)) return builder.status();
  return builder.Take();
}

double JsonValue::number() const {
  if (const auto* const u = std::get_if<uint64_t>(&value_)) return static_cast<double>(*u);
  if (const auto* const i = std::get_if<int64_t>(&value_)) return static_cast<double>(*i);
  return std::get<double>(value_);
}

size_t JsonValue::size() const {
  if (is_object()) return members().size();
  return is_array() ? std::get<Array>(value_).size() : 0;
}

std::string JsonValue::Text() const {
  const auto text = [](const nlohmann::json& json) {
    return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  };
  if (const auto* const s = std::get_if<std::string>(&value_)) return text(*s);
  if (const auto* const b = boolean()) return text(*b);
  if (const auto* const u = whole_number()) return text(*u);
  if (const auto* const i = std::get_if<int64_t>(&value_)) return text(*i);
  if (const auto* const d = std::get_if<double>(&value_)) return text(*d);
  return "null";
}

}  // namespace mtdb::internal
