// SPDX-License-Identifier: Apache-2.0
// A shortfall as JSON and as a line of text. Of the client's side too.
#pragma once

#include <string>
#include <string_view>

#include "store/base/json.h"
#include "store/base/shortfall.h"

namespace mtdb {

// null when there is none.
Json ShortfallJson(const Shortfall& shortfall);
// False when it is neither.
bool ParseShortfall(const Json& json, Shortfall* shortfall);
// 1 to 32 small letters, such as the name of a limit.
bool IsWord(std::string_view text);
// A line to print, with its end; nothing when there is none. `limit`: what ended the refinement.
std::string ShortfallText(const Shortfall& shortfall, const std::string& limit);

}  // namespace mtdb
