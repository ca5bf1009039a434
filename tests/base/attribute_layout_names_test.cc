// SPDX-License-Identifier: Apache-2.0
#include <catch2/catch.hpp>
#include <random>
#include <string>

#include "store/base/attribute_layout.h"

namespace mtdb {
namespace {

AttributeLayout Named(std::initializer_list<std::string> names) {
  AttributeLayout layout;
  for (const std::string& name : names) layout.attributes.push_back({name, ScalarType::kInt8});
  return layout;
}

TEST_CASE("An attribute has a name of printable UTF-8 that no other and no coordinate has") {
  CHECK(AttributeNamesFault({}).empty());
  CHECK(AttributeNamesFault(Named({"red", "X", "two words", "\xc3\xa9", "\xf0\x9f\x98\x80", "\""}))
            .empty());
  CHECK(AttributeNamesFault(Named({std::string(255, 'a')})).empty());
  for (const std::string& bad :
       {std::string(), std::string("x"), std::string("y"), std::string("z"), std::string("a\nb"),
        std::string("a\tb"), std::string("a\0b", 3), std::string("\x7f"), std::string(" a"),
        std::string("a "), std::string("\xff"), std::string("\xc3"), std::string("\xc0\x80"),
        std::string("\xc2\x85"), std::string("\xe2\x80\xa8"), std::string("\xed\xa0\x80"),
        std::string("\xe0\x80\x80"), std::string("\xf4\x90\x80\x80"), std::string(256, 'a')}) {
    CAPTURE(bad);
    CHECK_THAT(AttributeNamesFault(Named({"fine", bad})), Catch::StartsWith("attribute 1: "));
    CHECK(AttributeNamesFault(Named({UsableAttributeName(bad, {})})).empty());
  }
  CHECK_THAT(AttributeNamesFault(Named({"a", "b", "a"})), Catch::Contains("another"));
}

TEST_CASE("Any bytes become names that may be used beside each other") {
  std::mt19937 random(7);
  AttributeLayout layout;
  for (int i = 0; i < 500; ++i) {
    std::string name(random() % 300, ' ');
    for (char& c : name) c = static_cast<char>(random() % (i % 2 == 0 ? 4 : 256));
    layout.attributes.push_back({UsableAttributeName(name, layout), ScalarType::kInt8});
  }
  CHECK(AttributeNamesFault(layout) == "");
  CHECK(UsableAttributeName("quality", layout) == "quality");
}

TEST_CASE("A layout of bytes with a name that none may have is corrupt") {
  for (const char* name : {"x", "a\nproperty float b", ""}) {
    ByteWriter writer;
    PutAttributeLayout(Named({"red", name}), &writer);
    const Bytes bytes = writer.Take();
    ByteReader reader(bytes);
    const auto layout = GetAttributeLayout(&reader);
    REQUIRE(!layout.ok());
    CHECK(layout.status().code() == StatusCode::kCorrupt);
    CHECK_THAT(layout.status().message(), Catch::Contains("attribute"));
  }
}

}  // namespace
}  // namespace mtdb
