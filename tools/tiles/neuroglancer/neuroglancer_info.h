// SPDX-License-Identifier: Apache-2.0
// What neuroglancer is told of meshes beside their fragments.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/base/json.h"
#include "store/object_record.h"
#include "tools/tiles/neuroglancer/neuroglancer_levels.h"

namespace mtdb {

struct NeuroglancerSegment {
  uint64_t id = 0;
  ObjectRecord record;
};

struct NeuroglancerSetOptions {
  std::optional<Vec3d> resolution;  // nanometres of a unit; none: of the object's own units
  int bits = 16;                    // of positions in a fragment: 10 or 16
  uint64_t tile_triangles = 50'000;
  // Clients draw a level when its error covers so many pixels as they have set, 10 at first. The
  // mesh says errors so much larger that they then refine at `pixels`.
  double pixels = 2;
  bool sharded = false;
};

// Of a unit; 1 where nobody said it.
double NanometresOf(const ObjectRecord& record);
// The id that a name is, if it is one.
std::optional<uint64_t> SegmentIdIn(std::string_view name);
// kInvalidArgument: the object has no place in a space of nanometres.
Status CheckSegment(const ObjectRecord& record);

// What clients add to all positions: far from its origin float32, which they compute with, has no
// room for details.
Vec3d NeuroglancerMove(const std::vector<NeuroglancerSegment>& segments,
                       const NeuroglancerSetOptions& set);
// How a segment becomes fragments.
NeuroglancerOptions NeuroglancerOptionsOf(const ObjectRecord& record,
                                          const NeuroglancerSetOptions& set, Vec3d moved);
// The files "info", but for shards, and "segment_properties/info".
Json NeuroglancerInfo(const NeuroglancerSetOptions& set, Vec3d moved);
Json NeuroglancerProperties(const std::vector<NeuroglancerSegment>& segments);

}  // namespace mtdb
