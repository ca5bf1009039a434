// SPDX-License-Identifier: Apache-2.0
// The stream of crumbs (codecs/FORMAT.md, "Crumbs").
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/internal/streams.h"
#include "codecs/coding/patch.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Where a reader finds what the crumbs hang on, once it has the other nodes.
struct CrumbPlaces {
  const Patch& patch;
  std::span<const uint32_t> slot_triangle;          // slot -> ClusterUpdates::triangles
  std::span<const UnitId> children;                 // ascending
  std::function<uint32_t(uint32_t)> stored_vertex;  // of a local vertex
};

// Returns how many nodes the index counts for the crumbs.
uint32_t EncodeCrumbs(const ClusterUpdates& updates, const CrumbPlaces& places, size_t row_bytes,
                      StreamWriter& streams);

// Appends the crumbs' nodes to a cluster that has all others, its removers and explicit arcs.
// `node_limit`: of all nodes.
Status DecodeCrumbs(const StreamReader& streams, size_t row_bytes, uint32_t node_limit,
                    const std::string& where, Cluster* cluster);

}  // namespace mtdb::internal
