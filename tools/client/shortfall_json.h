// A shortfall as JSON and as a line of text. Of the client's side too.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "store/base/shortfall.h"

namespace mtdb {

// null when there is none.
nlohmann::ordered_json ShortfallJson(const Shortfall& shortfall);
// False when it is neither.
bool ParseShortfall(const nlohmann::json& json, Shortfall* shortfall);
// A line to print, with its end; nothing when there is none. `limit`: what ended the refinement.
std::string ShortfallText(const Shortfall& shortfall, const std::string& limit);

}  // namespace mtdb
