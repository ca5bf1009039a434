// SPDX-License-Identifier: Apache-2.0
// ReadPiece: some bytes of a file that anybody may have written.
#pragma once

#include <cstdint>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Exactly so many bytes from `offset` on. kNotFound; kCorrupt where the file is shorter; kIoError.
Result<Bytes> ReadPiece(const std::string& path, uint64_t offset, uint64_t bytes);

// kNotFound, kIoError.
Result<uint64_t> FileBytes(const std::string& path);

}  // namespace mtdb
