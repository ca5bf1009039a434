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
// once, and those that descend from it are skipped. Memory: the surface's cache, four bytes per
// node of the clusters whose children are still to come (kFull), some bytes per cluster. Both
// levels read every payload. The Status is an error only when the source fails otherwise than by
// kCorrupt or kUnsupported, and when `control`, which may be null, cancels it. Safe beside queries.
Status VerifyObject(const Surface& surface, VerifyLevel level, CheckReport* report,
                    QueryControl* control = nullptr);

}  // namespace mtdb
