// Arguments of the verbs, as text and as values.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "store/base/status.h"

namespace mtdb {

// "X0,Y0,..." as exactly `count` finite numbers. `option` names the option in messages.
Result<std::vector<double>> ParseNumbers(const std::string& text, size_t count,
                                         const std::string& option);
// "512M", "1G", "4096": bytes; the suffixes K, M, G, T are powers of 1024.
Result<uint64_t> ParseSize(const std::string& text, const std::string& option);
// "1200x900".
Result<std::pair<int, int>> ParseExtent(const std::string& text, const std::string& option);
// The file's name without folders and extension: an object's name by default.
std::string Stem(const std::string& path);

}  // namespace mtdb
