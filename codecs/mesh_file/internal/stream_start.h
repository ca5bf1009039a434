// SPDX-License-Identifier: Apache-2.0
// CheckStreamStart: whether what comes from a pipe can become a mesh, by its first mebibyte, so
// that a stream that never ends and is none does not fill the disk first.
#pragma once

#include <cstdint>
#include <string>

#include "codecs/mesh_file/input/file_io.h"
#include "codecs/mesh_file/readers/mesh_format_table.h"
#include "store/base/status.h"

namespace mtdb::internal {

inline constexpr uint64_t kStreamStartBytes = uint64_t{1} << 20;

// What the beginning of a stream tells of the rest.
struct StreamFacts {
  uint64_t most_bytes = ~uint64_t{0};  // the stream has no more than that
  bool is_text = false;                // no byte of it is 0
};

// `start` has the first kStreamStartBytes of a stream that goes on, `row` is the format that reads
// it (null: none does). kBadInput and kUnsupported, as the readers say it.
Result<StreamFacts> CheckStreamStart(const InputFile& start, const MeshFormatRow* row,
                                     const MeshFileStart& first);

}  // namespace mtdb::internal
