// SPDX-License-Identifier: Apache-2.0
// What a file seems to be that is not what was expected, for messages.
#pragma once

#include <cstddef>
#include <string_view>

namespace mtdb {

inline constexpr size_t kFileKindBytes = 32;

// "a PNG picture", by how the file begins: its first kFileKindBytes, or all that it has. Empty when
// nothing is known.
std::string_view KindOfFile(std::string_view start);

// Whether it begins as a store of mtdb does, or as a packed file.
bool SeemsStore(std::string_view start);
bool SeemsPackedFile(std::string_view start);

}  // namespace mtdb
