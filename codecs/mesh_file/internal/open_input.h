// SPDX-License-Identifier: Apache-2.0
// OpenInputFile: files as readers want them: regular, and not compressed.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "codecs/mesh_file/internal/file_io.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Whether a file that begins with these bytes is compressed by gzip.
bool IsGzip(std::string_view start);

// Opens the file at `path`, or `descriptor` when it is not negative. What is no regular file, or is
// compressed by gzip, is copied into a nameless temporary file in `tmp_directory` (empty: the
// system's) first, decompressed. Memory: some buffers. Errors: kNotFound, kIoError, kNoSpace, and
// kBadInput for gzip that is damaged, cut short, or followed by something else.
Result<std::unique_ptr<InputFile>> OpenInputFile(const std::string& path, int descriptor,
                                                 const std::string& tmp_directory);

}  // namespace mtdb::internal
