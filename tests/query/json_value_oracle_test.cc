// SPDX-License-Identifier: Apache-2.0
// JsonValue against nlohmann: the same texts are JSON, and mean the same.
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "query/json/json_value.h"

namespace mtdb::testing {
namespace {

using Json = nlohmann::json;
using internal::JsonValue;

bool Same(const JsonValue& ours, const Json& theirs) {
  if (theirs.is_object()) {
    if (!ours.is_object() || ours.size() != theirs.size()) return false;
    for (const auto& [key, value] : theirs.items()) {
      if (!ours.contains(key.c_str()) || !Same(*ours.members().at(key), value)) return false;
    }
    return true;
  }
  if (theirs.is_array()) {
    if (!ours.is_array() || ours.size() != theirs.size()) return false;
    for (size_t i = 0; i < theirs.size(); ++i) {
      if (!Same(ours.at(i), theirs[i])) return false;
    }
    return true;
  }
  if (theirs.is_boolean())
    return ours.boolean() != nullptr && *ours.boolean() == theirs.get<bool>();
  if (theirs.is_number()) {
    if (!ours.is_number() || ours.number() != theirs.get<double>()) return false;
    const bool natural = ours.whole_number() != nullptr;
    return natural == theirs.is_number_unsigned() && Json::parse(ours.Text()) == theirs;
  }
  if (theirs.is_string()) return ours.Text() == theirs.dump();
  return ours.Text() == "null" && !ours.is_object() && !ours.is_array();
}

// Whether nlohmann takes it, and ours says the same.
bool Compare(const std::string& text) {
  // nlohmann's tree from texts of its own limits: numbers that are too large are errors in both.
  const Json theirs = Json::parse(text, nullptr, false);
  const auto ours = JsonValue::Parse(text, 64);
  INFO(text);
  CHECK(ours.ok() == !theirs.is_discarded());
  if (ours.ok() && !theirs.is_discarded()) CHECK(Same(*ours, theirs));
  return ours.ok();
}

std::string Join(const std::vector<std::string>& parts, std::mt19937& random) {
  std::string text;
  for (size_t n = 1 + random() % 12; n > 0; --n) text += parts[random() % parts.size()];
  return text;
}

}  // namespace

TEST_CASE("JSON is read as nlohmann reads it, text by text", "[query][json]") {
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

TEST_CASE("JSON is read as nlohmann reads it, at random", "[query][json]") {
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

}  // namespace mtdb::testing
