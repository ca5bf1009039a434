// SPDX-License-Identifier: Apache-2.0
#include "tools/request/read_file.h"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>

namespace mtdb {

Result<std::string> ReadFile(const std::string& path, uint64_t most_bytes) {
  const bool is_standard_input = path == "-";
  std::FILE* file = is_standard_input ? stdin : std::fopen(path.c_str(), "rb");
  if (file == nullptr) {
    if (errno == ENOENT) return NotFound(path + ": no such file");
    return IoError(path + ": cannot be opened: " + std::strerror(errno));
  }
  std::string text;
  std::array<char, 1 << 16> block;
  while (const size_t n = std::fread(block.data(), 1, block.size(), file)) {
    text.append(block.data(), n);
    if (text.size() > most_bytes) break;
  }
  const bool failed = std::ferror(file) != 0;
  const int error = errno;
  if (!is_standard_input) std::fclose(file);
  if (text.size() > most_bytes) {
    return BadInput((is_standard_input ? "standard input" : path) + ": more than " +
                    std::to_string(most_bytes >> 20) + " MiB, which is too much for what it says");
  }
  if (failed) return IoError(path + ": cannot be read: " + std::strerror(error));
  return text;
}

}  // namespace mtdb
