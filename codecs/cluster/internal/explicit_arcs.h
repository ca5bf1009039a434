// SPDX-License-Identifier: Apache-2.0
// The stream of explicit arcs, the same for clusters and pieces of the root (codecs/FORMAT.md).
#pragma once

#include <span>

#include "codecs/cluster/cluster.h"
#include "codecs/cluster/internal/streams.h"

namespace mtdb::internal {

// `arcs` ascend by slot.
void EncodeExplicitArcs(std::span<const ExplicitArc> arcs, StreamWriter& streams);

// Appends to unit->explicit_arcs. False when one does not start at a slot whose remover is in a
// child, or is no arc. `unit` has its removers, one for each slot.
[[nodiscard]] bool DecodeExplicitArcs(const StreamReader& streams, Cluster* unit);

}  // namespace mtdb::internal
