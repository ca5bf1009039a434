// SPDX-License-Identifier: Apache-2.0
#include "store/object_name.h"

#include <catch2/catch.hpp>

namespace mtdb::test {
namespace {

TEST_CASE("an object may have any name of UTF-8 without control characters", "[store]") {
  for (const std::string name : {"a", "a b", "../a/b", "...", ".a", "\xc2\xa0", "\xc3\x9f",
                                 "\xe6\xbc\xa2", "\xf0\x9f\x97\xbf", "\xf4\x8f\xbf\xbf"}) {
    CHECK(CheckObjectName(name).ok());
  }
  CHECK(CheckObjectName(std::string(500, 'n')).ok());
  for (const std::string name : {"",
                                 ".",
                                 "..",
                                 "a\nb",
                                 "\x1b[2J",
                                 "\x7f",
                                 "\x80",
                                 "\xc2\x80",
                                 "\xc2\x9b"
                                 "31m",
                                 "\xc2\x9f",
                                 "\xff",
                                 "\xc0\xaf",
                                 "\xc3",
                                 "a\xe6\xbc",
                                 "\xe6\xbc"
                                 "a",
                                 "\xe0\x80\x80",
                                 "\xed\xa0\x80",
                                 "\xf0\x80\x80\x80",
                                 "\xf4\x90\x80\x80",
                                 "\xf5\x80\x80\x80"}) {
    INFO(name);
    CHECK(CheckObjectName(name).code() == StatusCode::kInvalidArgument);
  }
  CHECK_FALSE(CheckObjectName(std::string(501, 'n')).ok());
  CHECK_FALSE(CheckObjectName(std::string("a\0b", 3)).ok());
}

}  // namespace
}  // namespace mtdb::test
