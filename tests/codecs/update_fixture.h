// SPDX-License-Identifier: Apache-2.0
// A cluster's nodes as updates of its in-triangles' mesh, for the tests of the update stream.
#pragma once

#include <cstdint>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "codecs/cluster/cluster.h"
#include "codecs/stream/client_mesh.h"
#include "codecs/stream/mesh_update.h"
#include "tests/codecs/cluster_fixture.h"

namespace mtdb::testing {

// A record of an update stream with this body.
Bytes UpdateRecord(ByteSpan body);
// Flips a bit of it in every second call, and cuts it short in every eighth.
void Damage(std::mt19937& random, Bytes* body);

class UpdateFixture {
 public:
  explicit UpdateFixture(const ClusterOptions& options);
  explicit UpdateFixture(const ClusterFixture& fixture);

  // Of a terrain, by the Delaunay rule.
  ClientMeshOptions options(uint32_t remembered) const {
    Grid grid;
    if (terrain_) grid.mode = PositionMode::kRaster;
    return {grid, attributes_, remembered, terrain_};
  }
  const Cluster& cluster() const { return cluster_; }
  const BaseMesh& base() const { return base_; }
  // Per node; the closure of some: with all their ancestors.
  std::vector<bool> Closed(std::vector<bool> wanted) const;
  // From one closed set to another; removals first.
  std::vector<UpdateBatch> Batches(const std::vector<bool>& from,
                                   const std::vector<bool>& to) const;
  // The mesh of a closed set, or what of it meets the region, as ClientTriangles has it.
  std::multiset<std::string> Triangles(const std::vector<bool>& applied,
                                       const MeetsRegion& region = {}) const;

 private:
  std::vector<uint32_t> Parents(uint32_t node) const;
  void AddNode(uint32_t node, UpdateBatch& batch) const;
  void AddHole(uint32_t node, uint32_t first_star, std::span<const uint32_t> ring,
               std::span<const uint32_t> hole, UpdateBatch& batch) const;
  std::array<uint32_t, 3> Corners(uint32_t slot) const;

  bool terrain_ = false;
  AttributeLayout attributes_;
  Cluster cluster_;
  std::vector<uint32_t> creator_;  // per slot, or kNone32
  BaseMesh base_;
};

}  // namespace mtdb::testing
