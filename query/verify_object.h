// SPDX-License-Identifier: Apache-2.0
// VerifyObject: everything that can be checked of an object by decoding it.
#pragma once

#include "query/surface.h"
#include "store/base/status.h"
#include "store/verify_store.h"

namespace mtdb {

enum class VerifyLevel {
  // Decodes every cluster and root piece; compares counts, arcs, bounds, errors, degrees and depth
  // with the index and the record.
  kFull,
  // Streams the full-resolution mesh and the root; compares the surface's digest, its border and
  // the Euler characteristic with the record.
  kGlobal,
};

// Appends what was checked and what is wrong to `report`. A unit that does not decode is reported
// once, and units that descend from it are skipped. Memory: the surface's cache, some bytes per
// cluster, and for kFull four bytes per node of each cluster some of whose children have not been
// checked yet. Both levels read every payload. The Status is an error only when the source fails
// otherwise than by kCorrupt or kUnsupported, or when `control`, which may be null, cancels the
// check. Safe beside queries.
Status VerifyObject(const Surface& surface, VerifyLevel level, CheckReport* report,
                    QueryControl* control = nullptr);

}  // namespace mtdb
