// SPDX-License-Identifier: Apache-2.0
#include "store/base/json.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <optional>

#include "store/base/json_depth.h"

#ifndef __wasm__
#include <nlohmann/detail/conversions/to_chars.hpp>
#endif

namespace mtdb {

namespace {

const Json kNull;

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// Of a number as JSON has it, whatever the locale; infinite when it is too large.
double DoubleOf(const std::string& number) {
#ifdef __cpp_lib_to_chars
  double value = 0;
  const auto end = std::from_chars(number.data(), number.data() + number.size(), value);
  if (end.ec != std::errc::result_out_of_range) return value;
  // Too large, or too small: of a number without an exponent, as it has digits before its point.
  const size_t exponent = number.find_first_of("eE");
  const bool is_small = exponent != std::string::npos
                            ? number[exponent + 1] == '-'
                            : number.find_first_of("123456789") > number.find('.');
  const double size = is_small ? 0 : std::numeric_limits<double>::infinity();
  return number[0] == '-' ? -size : size;
#else  // libc++ of WebAssembly, where there is one locale
  return std::strtod(number.c_str(), nullptr);
#endif
}

// How many bytes the UTF-8 sequence has that `text` begins with (RFC 3629), and whether it is one;
// else how many could begin one, at least 1.
std::pair<size_t, bool> SequenceAt(std::string_view text) {
  const auto byte = [&](size_t i) {
    return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U;
  };
  const unsigned first = byte(0);
  if (first < 0x80) return {1, true};
  if (first < 0xC2 || first > 0xF4) return {1, false};
  const size_t length = first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
  unsigned low = first == 0xE0 ? 0xA0 : first == 0xF0 ? 0x90 : 0x80;
  unsigned high = first == 0xED ? 0x9F : first == 0xF4 ? 0x8F : 0xBF;
  for (size_t i = 1; i < length; ++i) {
    if (byte(i) < low || byte(i) > high) return {i, false};
    low = 0x80;
    high = 0xBF;
  }
  return {length, true};
}

// Of a sequence.
unsigned PointOf(std::string_view sequence) {
  const auto first = static_cast<unsigned char>(sequence[0]);
  unsigned point = sequence.size() == 1 ? first : first & (0x7FU >> sequence.size());
  for (const char c : sequence.substr(1)) point = point << 6 | (static_cast<unsigned>(c) & 0x3F);
  return point;
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

// The last of several members with one name counts, at the place of the first.
void DropRepeated(Json::Object* members) {
  std::vector<size_t> order(members->size());
  std::iota(order.begin(), order.end(), size_t{0});
  const auto name = [&](size_t i) -> const std::string& { return (*members)[i].name; };
  std::ranges::sort(order, [&](size_t a, size_t b) {
    const int compared = name(a).compare(name(b));
    return compared < 0 || (compared == 0 && a < b);
  });
  std::vector<bool> repeated(members->size());
  size_t first = 0;
  for (size_t i = 1; i < order.size(); ++i) {
    if (name(order[i]) != name(order[first])) {
      first = i;
    } else {
      (*members)[order[first]].value = std::move((*members)[order[i]].value);
      repeated[order[i]] = true;
    }
  }
  std::erase_if(*members, [&](const Json::Member& m) {
    return repeated[static_cast<size_t>(&m - members->data())];
  });
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

  Json Take() { return std::move(root_); }

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

  bool ReadValue(Json* value) {
    SkipSpace();
    switch (Next()) {
      case '{': return ReadObject(&value->value_.emplace<Json::Object>());
      case '[': return ReadArray(&value->value_.emplace<Json::Array>());
      case '"': return ReadString(&value->value_.emplace<std::string>());
      case 't': value->value_ = true; return TakeWord("true");
      case 'f': value->value_ = false; return TakeWord("false");
      case 'n': return TakeWord("null");
      default: return ReadNumber(&value->value_);
    }
  }

  bool ReadArray(Json::Array* list) {
    ++at_;
    SkipSpace();
    if (Take(']')) return true;
    do {
      if (!ReadValue(&list->emplace_back())) return false;
      SkipSpace();
    } while (Take(','));
    return Take(']');
  }

  bool ReadObject(Json::Object* members) {
    ++at_;
    SkipSpace();
    if (Take('}')) return true;
    do {
      SkipSpace();
      Json::Member& member = members->emplace_back();
      if (Next() != '"' || !ReadString(&member.name)) return false;
      SkipSpace();
      if (!Take(':') || !ReadValue(&member.value)) return false;
      SkipSpace();
    } while (Take(','));
    DropRepeated(members);
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
      const auto [length, is_valid] = SequenceAt(text_.substr(at_));
      if (!is_valid) return false;
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
  bool ReadNumber(decltype(Json::value_)* value) {
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
  Json root_;
  size_t at_ = 0;
  bool is_too_large_ = false;
};

class JsonWriter {
 public:
  explicit JsonWriter(Json::Form form) : form_(form) {}

  void Write(const Json& json) {
    std::visit([&](const auto& value) { Add(value); }, json.value_);
  }
  std::string Take() { return std::move(text_); }

 private:
  void Add(std::nullptr_t) { text_ += "null"; }
  void Add(bool value) { text_ += value ? "true" : "false"; }
  void Add(uint64_t value) { text_ += std::to_string(value); }
  void Add(int64_t value) { text_ += std::to_string(value); }
  void Add(double value) {
    if (!std::isfinite(value)) return Add(nullptr);
    std::array<char, 64> text;
#ifndef __wasm__
    // Two texts may be as short and the same number; documents hold which one nlohmann writes.
    text_.append(text.data(),
                 nlohmann::detail::to_chars(text.data(), text.data() + text.size(), value));
#else  // not in the page's engine, whose numbers nobody reads
    std::snprintf(text.data(), text.size(), "%.17g", value);
    text_ += text.data();
#endif
  }

  void Add(const std::string& string) {
    std::string_view rest = string;
    text_ += '"';
    while (!rest.empty()) {
      const auto [length, is_valid] = SequenceAt(rest);
      AddSequence(is_valid ? rest.substr(0, length) : "\xEF\xBF\xBD");
      rest.remove_prefix(length);
    }
    text_ += '"';
  }
  void AddSequence(std::string_view sequence) {
    constexpr std::string_view kLetters = "\b\f\n\r\t\"\\", kNames = "bfnrt\"\\";
    const unsigned point = PointOf(sequence);
    if (const size_t at = kLetters.find(sequence[0]); at != std::string_view::npos) {
      text_ += '\\';
      text_ += kNames[at];
    } else if (point >= 0x20 && (point < 0x7F || form_ != Json::Form::kAscii)) {
      text_ += sequence;
    } else if (point < 0x10000) {
      AddHex(point);
    } else {
      AddHex(0xD7C0 + (point >> 10));
      AddHex(0xDC00 + (point & 0x3FF));
    }
  }
  void AddHex(unsigned unit) {
    std::array<char, 16> text;
    std::snprintf(text.data(), text.size(), "\\u%04x", unit);
    text_ += text.data();
  }

  void Add(const Json::Array& elements) {
    AddEntries('[', elements, ']', [&](const Json& element) { Write(element); });
  }
  void Add(const Json::Object& members) {
    AddEntries('{', members, '}', [&](const Json::Member& member) {
      Add(member.name);
      text_ += form_ == Json::Form::kLines ? ": " : ":";
      Write(member.value);
    });
  }
  template <typename Entries, typename AddEntry>
  void AddEntries(char open, const Entries& entries, char close, AddEntry add) {
    text_ += open;
    ++depth_;
    for (const auto& entry : entries) {
      if (&entry != entries.data()) text_ += ',';
      EndLine();
      add(entry);
    }
    --depth_;
    if (!entries.empty()) EndLine();
    text_ += close;
  }
  void EndLine() {
    if (form_ == Json::Form::kLines) text_.append("\n").append(2 * depth_, ' ');
  }

  const Json::Form form_;
  size_t depth_ = 0;
  std::string text_;
};

Result<Json> Json::Parse(std::string_view text, int deepest) {
  if (const size_t at = TooDeepAt(text, deepest); at != std::string_view::npos) {
    return InvalidArgument("byte " + std::to_string(at) + ": more than " + std::to_string(deepest) +
                           " braces and brackets within each other");
  }
  JsonReader reader(text);
  MTDB_RETURN_IF_ERROR(reader.Read());
  return reader.Take();
}

Json Json::ParseObject(std::string_view text) {
  Result<Json> json = Parse(text);
  return json.ok() && json->is_object() ? *std::move(json) : Json();
}

Json::Json(Object members) : value_(std::move(members)) {}

Json::Json(std::initializer_list<Json> values) {
  const bool is_object = std::ranges::all_of(values, [](const Json& value) {
    return value.is_array() && value.size() == 2 && value[0].string() != nullptr;
  });
  if (!is_object) {
    value_ = Array(values);
    return;
  }
  Object& members = value_.emplace<Object>();
  for (const Json& value : values) members.push_back({*value[0].string(), value[1]});
}

double Json::number() const {
  if (const auto* const u = std::get_if<uint64_t>(&value_)) return static_cast<double>(*u);
  if (const auto* const i = std::get_if<int64_t>(&value_)) return static_cast<double>(*i);
  return std::get<double>(value_);
}

const Json& Json::operator[](size_t i) const {
  return is_array() && i < elements().size() ? elements()[i] : kNull;
}

Json& Json::push_back(Json value) {
  if (is_null()) value_.emplace<Array>();
  return elements().emplace_back(std::move(value));
}

Json& Json::operator[](std::string_view key) {
  if (is_null()) value_.emplace<Object>();
  const auto at = std::ranges::find(members(), key, &Member::name);
  if (at != members().end()) return at->value;
  return members().emplace_back(Member{std::string(key), {}}).value;
}

const Json& Json::operator[](std::string_view key) const {
  if (!is_object()) return kNull;
  const auto at = std::ranges::find(members(), key, &Member::name);
  return at == members().end() ? kNull : at->value;
}

bool Json::contains(std::string_view key) const { return &(*this)[key] != &kNull; }

void Json::Update(const Json& other) {
  for (const auto& [name, value] : other.members()) (*this)[name] = value;
}

Json Json::Take(std::string_view key) {
  const auto at = std::ranges::find(members(), key, &Member::name);
  if (at == members().end()) return {};
  Json value = std::move(at->value);
  members().erase(at);
  return value;
}

const std::string* Json::UnknownKey(const std::vector<const char*>& known) const {
  const std::string* first = nullptr;
  for (const auto& [name, value] : members()) {
    if (std::ranges::find(known, name) != known.end()) continue;
    if (first == nullptr || name < *first) first = &name;
  }
  return first;
}

size_t Json::size() const {
  if (is_object()) return members().size();
  return is_array() ? elements().size() : 0;
}

bool operator==(const Json& a, const Json& b) {
  if (a.value_.index() == b.value_.index()) return a.value_ == b.value_;
  return a.is_number() && b.is_number() && a.number() == b.number();
}

std::string Json::Text(Form form) const {
  JsonWriter writer(form);
  writer.Write(*this);
  return writer.Take();
}

}  // namespace mtdb
