// SPDX-License-Identifier: Apache-2.0
// A book: pages that meet in a spine, made coarser by removing vertices, those of the spine from
// all pages at once.
#pragma once

#include "tests/codecs/cluster_fixture.h"

namespace mtdb::testing {

// Sets positions, triangles and nodes. `options.side`: vertices along the spine.
void MakeBook(const ClusterOptions& options, ClusterUpdates& updates);

}  // namespace mtdb::testing
