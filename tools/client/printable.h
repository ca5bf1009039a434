// SPDX-License-Identifier: Apache-2.0
// Printable: texts of others (names of files, journals, what servers say) on a terminal, in a line.
#pragma once

#include <string>

namespace mtdb {

// With '?' for each control character: C0, DEL, and C1 as UTF-8 has it. What a terminal would obey.
inline std::string Printable(std::string text) {
  for (size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    if (byte < ' ' || byte == 0x7f) text[i] = '?';
    if (byte != 0xc2 || i + 1 == text.size()) continue;
    const auto next = static_cast<unsigned char>(text[i + 1]);
    if (next >= 0x80 && next < 0xa0) text.replace(i, 2, "?");
  }
  return text;
}

}  // namespace mtdb
