// SPDX-License-Identifier: Apache-2.0
// SqueezeTable, UnsqueezeTable: tables of numbers in few bytes, for temporary files.
#pragma once

#include <optional>

#include "store/base/bytes.h"

namespace mtdb::internal {

// Rows of `columns` words of four bytes, or with none, bytes. Each word is taken as its difference
// to the one above, their first bytes are put together, then their second ones ..., and all is
// compressed, fast.
Bytes SqueezeTable(ByteSpan table, size_t columns);
// None when these are not the bytes of a table of at most `most` bytes.
std::optional<Bytes> UnsqueezeTable(ByteSpan squeezed, size_t columns, size_t most);

}  // namespace mtdb::internal
