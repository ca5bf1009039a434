// SPDX-License-Identifier: Apache-2.0
// Rows of the cluster index as bytes. Layout in store/FORMAT.md, "Index".
#pragma once

#include <cstdint>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/internal/keys.h"

namespace mtdb::internal {

// The body of the index value that holds rows `first` .. `first + count - 1`.
Bytes EncodeIndexRows(const ClusterIndex& index, uint32_t first, uint32_t count);

// Appends exactly `count` rows to `index`, which holds the rows before them. `where` names the
// value.
Status DecodeIndexRows(ByteSpan body, uint32_t count, const std::string& where,
                       ClusterIndex* index);

}  // namespace mtdb::internal
