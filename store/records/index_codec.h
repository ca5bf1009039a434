// SPDX-License-Identifier: Apache-2.0
// Rows of the cluster index as bytes. Layout in store/FORMAT.md, "Index".
#pragma once

#include <cstdint>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/records/keys.h"

namespace mtdb::internal {

// The body of the index value that holds rows `first` .. `first + count - 1`.
Bytes EncodeIndexRows(const ClusterIndex& index, uint32_t first, uint32_t count);

// Appends exactly `count` rows to `index`, which holds the rows before them. `where` names the
// value.
Status DecodeIndexRows(ByteSpan body, uint32_t count, const std::string& where,
                       ClusterIndex* index);

// Of all index values in the order of their keys: 0 at first, then with each one's body.
inline uint64_t ChainIndexValue(uint64_t chain, ByteSpan body) { return Hash64(body, chain); }

}  // namespace mtdb::internal
