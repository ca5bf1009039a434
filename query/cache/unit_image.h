// SPDX-License-Identifier: Apache-2.0
// The bytes of a decoded unit, to put it away and to have it back without decoding.
#pragma once

#include "query/cache/loaded_unit.h"
#include "store/base/bytes.h"

namespace mtdb::internal {

// Of this process only: no format, and not for bytes that others may have written.
Bytes MakeUnitImage(const LoadedUnit& unit);
// Null for bytes that MakeUnitImage did not make. Throws std::bad_alloc.
LoadedUnitPtr UnitFromImage(ByteSpan image);

}  // namespace mtdb::internal
