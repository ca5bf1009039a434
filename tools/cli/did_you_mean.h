// SPDX-License-Identifier: Apache-2.0
// What somebody may have meant who mistyped a word.
#pragma once

#include <span>
#include <string>

namespace mtdb {

// "; did you mean 'extract'?", or nothing when no known word is near.
std::string DidYouMean(const std::string& word, std::span<const std::string> known);

}  // namespace mtdb
