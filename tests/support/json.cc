// SPDX-License-Identifier: Apache-2.0
#include "tests/support/json.h"

namespace mtdb::test {

Json ParseJson(const std::string& text) { return Json::parse(text); }

std::string TextOf(const Json& json, int indent) { return json.dump(indent); }

}  // namespace mtdb::test
