// SPDX-License-Identifier: Apache-2.0
// Json against nlohmann: the same texts are JSON, mean the same, and are written alike.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "store/base/json.h"

namespace mtdb::test {
namespace {

using Theirs = nlohmann::ordered_json;

bool Same(const Json& ours, const Theirs& theirs) {
  if (theirs.is_object()) {
    if (!ours.is_object() || ours.size() != theirs.size()) return false;
    size_t i = 0;
    for (const auto& [key, value] : theirs.items()) {
      const auto& [our_key, our_value] = ours.members()[i++];
      if (our_key != key || !ours.contains(key) || !Same(our_value, value)) return false;
    }
    return true;
  }
  if (theirs.is_array()) {
    if (!ours.is_array() || ours.size() != theirs.size()) return false;
    for (size_t i = 0; i < theirs.size(); ++i) {
      if (!Same(ours[i], theirs[i])) return false;
    }
    return true;
  }
  if (theirs.is_boolean())
    return ours.boolean() != nullptr && *ours.boolean() == theirs.get<bool>();
  if (theirs.is_number()) {
    if (!ours.is_number() || ours.number() != theirs.get<double>()) return false;
    const bool natural = ours.whole_number() != nullptr;
    return natural == theirs.is_number_unsigned();
  }
  if (theirs.is_string()) return ours.string() != nullptr && *ours.string() == theirs;
  return ours.is_null();
}

// In all forms.
void CompareTexts(const Json& ours, const Theirs& theirs) {
  constexpr auto kReplace = Theirs::error_handler_t::replace;
  CHECK(ours.Text() == theirs.dump(-1, ' ', false, kReplace));
  CHECK(ours.Text(Json::Form::kAscii) == theirs.dump(-1, ' ', true, kReplace));
  CHECK(ours.Text(Json::Form::kLines) == theirs.dump(2, ' ', false, kReplace));
}

// Whether nlohmann takes it, and ours says the same.
bool Compare(const std::string& text) {
  // nlohmann's tree from texts of its own limits: numbers that are too large are errors in both.
  const Theirs theirs = Theirs::parse(text, nullptr, false);
  const auto ours = Json::Parse(text, 64);
  INFO(text);
  CHECK(ours.ok() == !theirs.is_discarded());
  if (ours.ok() && !theirs.is_discarded()) {
    CHECK(Same(*ours, theirs));
    CompareTexts(*ours, theirs);
  }
  return ours.ok();
}

std::string Join(const std::vector<std::string>& parts, std::mt19937& random) {
  std::string text;
  for (size_t n = 1 + random() % 12; n > 0; --n) text += parts[random() % parts.size()];
  return text;
}

}  // namespace

TEST_CASE("JSON is read as nlohmann reads it, text by text", "[json]") {
  for (const std::string text : {"0",
                                 "-0",
                                 "-",
                                 "01",
                                 "1.",
                                 ".5",
                                 "1.5e3",
                                 "1e+5",
                                 "1E-5",
                                 "1e",
                                 "18446744073709551615",
                                 "18446744073709551616",
                                 "-9223372036854775808",
                                 "-9223372036854775809",
                                 "1e400",
                                 "-1e400",
                                 "1e-400",
                                 "4.9e-324",
                                 "2.2250738585072014e-308",
                                 "0.1",
                                 "123456789012345678901234567890",
                                 "NaN",
                                 "Infinity",
                                 "true",
                                 "tru",
                                 "truex",
                                 "null",
                                 "nul",
                                 "[]",
                                 "[1,]",
                                 "[1 2]",
                                 "{}",
                                 "{\"a\":1,}",
                                 "{\"a\":1,\"a\":[2]}",
                                 "{a:1}",
                                 "{\"a\" : 1 }",
                                 " \t\r\n[ 1 , 2 ]\n",
                                 "\"\\u00e4\"",
                                 "\"\\ud83d\\ude00\"",
                                 "\"\\ud83d\"",
                                 "\"\\ude00\"",
                                 "\"\\ud83d\\u0041\"",
                                 "\"\\u00G0\"",
                                 "\"\\u0000\"",
                                 "\"\\x\"",
                                 "\"a\tb\"",
                                 "\"\xc3\xa4\"",
                                 "\"\xc0\x80\"",
                                 "\"\xed\xa0\x80\"",
                                 "\"\xf0\x9f\x98\x80\"",
                                 "\"\xf4\x90\x80\x80\"",
                                 "\"\xff\"",
                                 "\xef\xbb\xbf[1]",
                                 "\"",
                                 "\"\\",
                                 "[",
                                 "{",
                                 "{\"a\"",
                                 "{\"a\":",
                                 "1 2",
                                 "/*c*/1",
                                 "'a'",
                                 "+1",
                                 "0x10",
                                 "1_000"}) {
    Compare(text);
  }
}

TEST_CASE("JSON is read as nlohmann reads it, at random", "[json]") {
  const std::vector<std::string> parts{"{",          "}",     "[",        "]",       ",",
                                       ":",          "\"a\"", "\"a\":",   "\"b\": ", "1",
                                       "-2",         ".5",    "e3",       "0",       "true",
                                       "false",      "null",  " ",        "\n",      "\"",
                                       "\\u0041",    "\\",    "\xc3\xa4", "\xc3",    "[1,2,3]",
                                       "{\"c\":[]}", "[[",    "]]",       "1e5",     "1e999"};
  std::mt19937 random(17);
  for (int i = 0; i < 200'000; ++i) Compare(Join(parts, random));
  // One that is JSON, with a byte or two changed.
  const std::string whole =
      R"({"region": {"box": {"min": [-1.5, 2, 3e-2], "max": [1, 2.25, 30]}}, "threshold": {"by_region": {"inside": 0, "outside": "coarsest", "x": [true, false, null, "\u00fc\n"]}}, "max_triangles": 18446744073709551615})";
  size_t read = 0;
  for (int i = 0; i < 50'000; ++i) {
    std::string text = whole;
    for (size_t n = 1 + random() % 2; n > 0; --n) {
      const size_t at = random() % text.size();
      if (random() % 3 == 0)
        text.erase(at, 1);
      else if (random() % 2 == 0)
        text[at] = static_cast<char>(random());
      else
        text.insert(at, 1, text[random() % text.size()]);
    }
    if (Compare(text)) ++read;
  }
  CHECK(read > 3000);
}

TEST_CASE("JSON is written as nlohmann writes it", "[json]") {
  std::mt19937_64 random(5);
  const auto compare = [](double number) {
    INFO(number);
    CHECK(Json(number).Text() == Theirs(number).dump());
  };
  for (int i = 0; i < 20'000; ++i) {
    const uint64_t bits = random();
    double any = 0;
    std::memcpy(&any, &bits, sizeof(any));
    compare(any);
    const double near = std::uniform_real_distribution<double>(-1000, 1000)(random);
    compare(near);
    compare(static_cast<float>(near));
    compare(std::round(near));
  }
  for (const double number : {0.0, -0.0, 1e15, 1e16, 123456789012345.0, 1234567890123456.0, 1e-4,
                              1e-5, 5e-324, 1.7976931348623157e308}) {
    compare(number);
  }
  CHECK(Json(-5).Text() == "-5");
  CHECK(Json(uint64_t{18446744073709551615U}).Text() == "18446744073709551615");
  // Of any bytes, most of them no UTF-8.
  for (int i = 0; i < 20'000; ++i) {
    std::string text;
    for (size_t n = random() % 12; n > 0; --n) {
      constexpr std::string_view kOften = "\xE2\x82\xAC\xF0\x9F\x98\x80\xED\xA0\xC3\x7F\x1F\"\\";
      text += random() % 2 == 0 ? kOften[random() % kOften.size()] : static_cast<char>(random());
    }
    CompareTexts(Json(text), Theirs(text));
  }
}

TEST_CASE("lists in braces are objects when they are pairs of a key and a value", "[json]") {
  CHECK(Json{{"a", 1}, {"b", {{"c", nullptr}}}}.Text() == R"({"a":1,"b":{"c":null}})");
  CHECK(Json{{"a", 1}, 2}.Text() == R"([["a",1],2])");
  Json json;
  json["list"].push_back({{"x", 1.5}});
  json["list"].push_back(true);
  json.Update({{"more", Vec3d{1, 2, 3}.x}, {"list", "none"}});
  CHECK(json.Text() == R"({"list":"none","more":1.0})");
  CHECK(json.Take("list") == "none");
  CHECK(json.Take("list").is_null());
  CHECK(*Json{{"b", 1}, {"a", 1}, {"c", 1}}.UnknownKey({"c"}) == "a");
}

}  // namespace mtdb::test
