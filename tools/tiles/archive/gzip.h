// SPDX-License-Identifier: Apache-2.0
// Bytes compressed by gzip, and back.
#pragma once

#include <cstdint>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// The same bytes for the same input. kNoSpace.
Result<Bytes> Gzip(ByteSpan bytes);
// kCorrupt: not gzip, not whole, or of more than `most_bytes`.
Result<Bytes> Gunzip(ByteSpan packed, uint64_t most_bytes);

}  // namespace mtdb
