// SPDX-License-Identifier: Apache-2.0
// OpenInputFile: files as readers want them: regular, and not compressed.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "codecs/mesh_file/input/file_io.h"
#include "codecs/mesh_file/internal/stream_start.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Whether a file that begins with these bytes is compressed by gzip.
bool IsGzip(std::string_view start);

struct InputRules {
  std::string tmp_directory;              // of the copies; empty: the system's
  uint64_t max_tmp_bytes = ~uint64_t{0};  // of a copy
  // Called between reads, and while nothing comes from a pipe; its error ends the copy.
  std::function<Status()> look;
  // Is asked about the first mebibyte of what is copied when more follows.
  std::function<Result<StreamFacts>(const InputFile& start)> check_start;
};

// Opens the file at `path`, or `descriptor` when it is not negative. What is no regular file, or is
// compressed by gzip, is copied into a nameless temporary file first, decompressed, and
// `copied_bytes` is its size, else 0. Memory: some buffers. Errors: kNotFound, kIoError, kNoSpace,
// kBudgetExceeded, those of the rules, and kBadInput for gzip that is damaged, cut short, or
// followed by something else, and for a stream that is longer than it can be.
Result<std::unique_ptr<InputFile>> OpenInputFile(const std::string& path, int descriptor,
                                                 const InputRules& rules, uint64_t* copied_bytes);

}  // namespace mtdb::internal
