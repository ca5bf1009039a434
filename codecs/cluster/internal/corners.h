// SPDX-License-Identifier: Apache-2.0
// The streams of texture coordinates (codecs/FORMAT.md, "Corners").
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/internal/streams.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Half-edges, 4 * slot + edge, of in-triangles that are seams although their corners do not tell.
std::vector<uint32_t> FindHiddenSeams(const ClusterUpdates& updates,
                                      std::span<const uint32_t> in_triangles,
                                      std::span<const uint8_t> in_rotations, const InPatch& in);
void EncodeSeams(std::span<const uint32_t> seams, StreamWriter& streams);
Status DecodeSeams(const StreamReader& streams, uint32_t listed, const std::string& where,
                   std::vector<uint32_t>* seams);

// Marks both sides of seams in in.seams.
void MarkSeams(std::span<const uint32_t> seams, InPatch& in);

// `cluster`: what a reader has but for corners. `slot_triangle`: of slots that no crumb creates,
// the triangle of the updates. `stored_vertex`: of a local vertex of the updates.
void EncodeCorners(const ClusterUpdates& updates, Cluster cluster,
                   std::span<const uint32_t> slot_triangle,
                   const std::function<uint32_t(uint32_t)>& stored_vertex, StreamWriter& streams);
// Extends in.corners, and sets corner_places, of a cluster that has all else.
Status DecodeCorners(const StreamReader& streams, const std::string& where, Cluster* cluster);

}  // namespace mtdb::internal
