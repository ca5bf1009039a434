// SPDX-License-Identifier: Apache-2.0
#include "query/json/json_value.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <optional>

#include "store/base/json_depth.h"

namespace mtdb::internal {

namespace {

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// Of a number as JSON has it, whatever the locale; infinite when it is too large.
double DoubleOf(const std::string& number) {
#ifdef __cpp_lib_to_chars
  double value = 0;
  const auto end = std::from_chars(number.data(), number.data() + number.size(), value);
  if (end.ec == std::errc::result_out_of_range) return std::strtod(number.c_str(), nullptr);
  return value;
#else  // libc++ of WebAssembly, where there is one locale
  return std::strtod(number.c_str(), nullptr);
#endif
}

// The length of the UTF-8 sequence that `text` begins with, 0 when it is none (RFC 3629).
size_t SequenceAt(std::string_view text) {
  const auto byte = [&](size_t i) {
    return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U;
  };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  if (first < 0xC2 || first > 0xF4) return 0;
  const size_t length = first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
  const unsigned low = first == 0xE0 ? 0xA0 : first == 0xF0 ? 0x90 : 0x80;
  const unsigned high = first == 0xED ? 0x9F : first == 0xF4 ? 0x8F : 0xBF;
  if (byte(1) < low || byte(1) > high) return 0;
  for (size_t i = 2; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
  }
  return length;
}

void AppendUtf8(unsigned point, std::string* text) {
  const auto add = [&](unsigned byte) { text->push_back(static_cast<char>(byte)); };
  if (point < 0x80) return add(point);
  if (point < 0x800) {
    add(0xC0 | (point >> 6));
  } else {
    if (point < 0x10000) {
      add(0xE0 | (point >> 12));
    } else {
      add(0xF0 | (point >> 18));
      add(0x80 | ((point >> 12) & 0x3F));
    }
    add(0x80 | ((point >> 6) & 0x3F));
  }
  add(0x80 | (point & 0x3F));
}

// A string as JSON; what is not UTF-8 becomes U+FFFD.
std::string Quoted(std::string_view text) {
  std::string quoted = "\"";
  while (!text.empty()) {
    const size_t length = SequenceAt(text);
    const char c = text[0];
    constexpr std::string_view kLetters = "\b\f\n\r\t\"\\", kNames = "bfnrt\"\\";
    if (length == 0) {
      quoted += "\xEF\xBF\xBD";
    } else if (const size_t at = kLetters.find(c); at != std::string_view::npos) {
      quoted += '\\';
      quoted += kNames[at];
    } else if (static_cast<unsigned char>(c) < 0x20) {
      std::array<char, 8> hex;
      std::snprintf(hex.data(), hex.size(), "\\u%04x", static_cast<unsigned>(c));
      quoted += hex.data();
    } else {
      quoted += text.substr(0, length);
    }
    text.remove_prefix(std::max<size_t>(length, 1));
  }
  return quoted + '"';
}

// The shortest text that is the same number again.
std::string Shortest(double value) {
  if (!std::isfinite(value)) return "null";
  std::array<char, 32> text{};
  for (int digits = 15; digits <= 17; ++digits) {
    std::snprintf(text.data(), text.size(), "%.*g", digits, value);
    // Of a program's own locale.
    for (char& c : text) c = c == ',' ? '.' : c;
    if (DoubleOf(text.data()) == value) break;
  }
  const std::string number = text.data();
  return number.find_first_of(".e") == std::string::npos ? number + ".0" : number;
}

}  // namespace

// Recursive descent; the text's depth was looked at before.
class JsonReader {
 public:
  explicit JsonReader(std::string_view text) : text_(text) {
    if (text_.starts_with("\xEF\xBB\xBF")) at_ = 3;  // a byte order mark
  }

  Status Read() {
    const bool is_read = ReadValue(&root_) && (SkipSpace(), at_ == text_.size());
    if (is_read) return Status::Ok();
    if (is_too_large_) return InvalidArgument("a number that is too large for JSON");
    return InvalidArgument("byte " + std::to_string(at_ + 1) + ": not JSON");
  }

  JsonValue Take() { return std::move(root_); }

 private:
  char Next() const { return at_ < text_.size() ? text_[at_] : '\0'; }
  bool Take(char c) {
    if (at_ >= text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  void SkipSpace() {
    while (at_ < text_.size() && std::string_view(" \t\n\r").find(text_[at_]) < 4) ++at_;
  }
  bool TakeWord(std::string_view word) {
    for (const char c : word) {
      if (!Take(c)) return false;
    }
    return true;
  }

  bool ReadValue(JsonValue* value) {
    SkipSpace();
    switch (Next()) {
      case '{': return ReadObject(&value->value_.emplace<JsonValue::Object>());
      case '[': return ReadArray(&value->value_.emplace<JsonValue::Array>());
      case '"': return ReadString(&value->value_.emplace<std::string>());
      case 't': value->value_ = true; return TakeWord("true");
      case 'f': value->value_ = false; return TakeWord("false");
      case 'n': return TakeWord("null");
      default: return ReadNumber(&value->value_);
    }
  }

  bool ReadArray(JsonValue::Array* list) {
    ++at_;
    SkipSpace();
    if (Take(']')) return true;
    do {
      if (!ReadValue(&list->emplace_back())) return false;
      SkipSpace();
    } while (Take(','));
    return Take(']');
  }

  // The last of several members with one name counts.
  bool ReadObject(JsonValue::Object* members) {
    ++at_;
    SkipSpace();
    if (Take('}')) return true;
    do {
      SkipSpace();
      std::string name;
      if (Next() != '"' || !ReadString(&name)) return false;
      SkipSpace();
      if (!Take(':')) return false;
      auto& member = (*members)[name];
      member = std::make_unique<JsonValue>();
      if (!ReadValue(member.get())) return false;
      SkipSpace();
    } while (Take(','));
    return Take('}');
  }

  bool ReadString(std::string* string) {
    ++at_;
    while (at_ < text_.size() && static_cast<unsigned char>(Next()) >= 0x20) {
      if (Take('"')) return true;
      if (Take('\\')) {
        if (!ReadEscaped(string)) return false;
        continue;
      }
      const size_t length = SequenceAt(text_.substr(at_));
      if (length == 0) return false;
      string->append(text_.substr(at_, length));
      at_ += length;
    }
    return false;
  }

  bool ReadEscaped(std::string* string) {
    constexpr std::string_view kNames = "bfnrt\"\\/", kLetters = "\b\f\n\r\t\"\\/";
    if (at_ < text_.size()) {
      if (const size_t which = kNames.find(text_[at_]); which != std::string_view::npos) {
        string->push_back(kLetters[which]);
        ++at_;
        return true;
      }
    }
    const std::optional<unsigned> first = ReadHex();
    if (!first || (*first >= 0xDC00 && *first < 0xE000)) return false;
    if (*first < 0xD800 || *first >= 0xE000) return AppendUtf8(*first, string), true;
    if (!Take('\\')) return false;
    const std::optional<unsigned> second = ReadHex();
    if (!second || *second < 0xDC00 || *second >= 0xE000) return false;
    AppendUtf8(0x10000 + ((*first - 0xD800) << 10) + (*second - 0xDC00), string);
    return true;
  }
  // u and four digits.
  std::optional<unsigned> ReadHex() {
    unsigned value = 0;
    if (!Take('u') || text_.size() - at_ < 4) return std::nullopt;
    const char* const from = text_.data() + at_;
    if (std::from_chars(from, from + 4, value, 16).ptr != from + 4) return std::nullopt;
    at_ += 4;
    return value;
  }

  bool TakeDigits() {
    if (!IsDigit(Next())) return false;
    while (IsDigit(Next())) ++at_;
    return true;
  }
  // Whole numbers that 64 bits hold stay whole.
  bool ReadNumber(JsonValue::Value* value) {
    const size_t from = at_;
    const bool negative = Take('-');
    if (!Take('0') && !TakeDigits()) return false;
    bool whole = true;
    if (Take('.')) {
      whole = false;
      if (!TakeDigits()) return false;
    }
    if (Take('e') || Take('E')) {
      whole = false;
      if (!Take('+')) Take('-');
      if (!TakeDigits()) return false;
    }
    const std::string number(text_.substr(from, at_ - from));
    const auto read = [&](auto& integer) {
      const auto end = std::from_chars(number.data(), number.data() + number.size(), integer);
      return end.ec == std::errc() && end.ptr == number.data() + number.size();
    };
    if (uint64_t natural = 0; whole && !negative && read(natural)) return *value = natural, true;
    if (int64_t integer = 0; whole && negative && read(integer)) return *value = integer, true;
    const double real = DoubleOf(number);
    *value = real;
    is_too_large_ = !std::isfinite(real);
    return !is_too_large_;
  }

  const std::string_view text_;
  JsonValue root_;
  size_t at_ = 0;
  bool is_too_large_ = false;
};

Result<JsonValue> JsonValue::Parse(std::string_view text, int deepest) {
  if (const size_t at = TooDeepAt(text, deepest); at != std::string_view::npos) {
    return InvalidArgument("byte " + std::to_string(at) + ": more than " + std::to_string(deepest) +
                           " braces and brackets within each other");
  }
  JsonReader reader(text);
  MTDB_RETURN_IF_ERROR(reader.Read());
  return reader.Take();
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
  if (const auto* const s = std::get_if<std::string>(&value_)) return Quoted(*s);
  if (const auto* const b = boolean()) return *b ? "true" : "false";
  if (const auto* const u = whole_number()) return std::to_string(*u);
  if (const auto* const i = std::get_if<int64_t>(&value_)) return std::to_string(*i);
  if (const auto* const d = std::get_if<double>(&value_)) return Shortest(*d);
  return "null";
}

}  // namespace mtdb::internal
