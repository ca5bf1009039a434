// SPDX-License-Identifier: Apache-2.0
// Small clusters for the codec's tests: a surface is decimated by random legal vertex removals.
#pragma once

#include <cstdint>
#include <string>

#include "codecs/cluster/cluster_codec.h"

namespace mtdb::testing {

// The second and third have a border. kTerrain: vertices of a square's lattice, inserted by the
// Delaunay rule, some of them on the border; kOtherTerrain: by another rule.
enum class Surface { kTorus, kSheet, kTerrain, kOtherTerrain, kBook };
enum class Numbers { kGrid, kLossless, kWild, kCoincident };

struct ClusterOptions {
  Surface surface = Surface::kTorus;
  int side = 20;  // vertices along a side
  int pages = 3;  // of a book
  Numbers numbers = Numbers::kGrid;
  bool attributes = false;          // of every type, wild
  bool rounded_attributes = false;  // colours, a normal on the octahedron, scalars on steps
  bool pierced = false;  // a triangle is missing, and removing one of its corners closes the gap
  int children = 3;
  double keep = 0.3;  // share of vertices that stay
  uint32_t seed = 1;
};

struct ClusterFixture {
  ClusterUpdates updates;
  AttributeLayout attributes;
};

ClusterFixture MakeCluster(const ClusterOptions& options);

// The in-patch that a loader would gather from the parents.
InPatch MakeIn(const ClusterFixture& fixture, const EncodedCluster& encoded);

// Empty when `cluster` says what `fixture` says, else what differs.
std::string Difference(const ClusterFixture& fixture, const EncodedCluster& encoded,
                       const Cluster& cluster);

}  // namespace mtdb::testing
