// SPDX-License-Identifier: Apache-2.0
// JSON in tests: what is costly to compile of it is compiled once.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace mtdb::test {

using Json = nlohmann::json;

// Json::parse; throws what that throws.
Json ParseJson(const std::string& text);
std::string TextOf(const Json& json, int indent = -1);  // json.dump(indent)

}  // namespace mtdb::test
