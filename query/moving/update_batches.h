// SPDX-License-Identifier: Apache-2.0
// UpdateBatches: the nodes that a step of a session changes, as batches of updates.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "codecs/stream/mesh_update.h"
#include "query/cache/loaded_unit.h"
#include "query/cut/bits.h"
#include "store/base/status.h"

namespace mtdb::internal {

// What a session calls the triangle of a slot, to its client.
constexpr TriangleKey TriangleKeyOf(UnitId unit, uint32_t slot) {
  return TriangleKey{unit} << 32 | slot;
}

// Nodes that change in one direction. Cost: in proportion to them.
class UpdateBatches {
 public:
  using GetUnit = std::function<Result<const LoadedUnit*>(UnitId)>;

  UpdateBatches(const ClusterIndex& index, size_t row_bytes, bool insert)
      : index_(index), row_bytes_(row_bytes), insert_(insert) {}

  // Notes the nodes of `to` that are not in `from`. Empty bits stand for none. Once a unit.
  void AddUnit(UnitId unit, const Bits& from, const Bits& to);
  uint64_t count() const { return count_; }

  // Appends the batches. A node goes to the batch after those of all nodes that have to be
  // inserted (removed) before it. `get` gives units, each until the next one.
  Status Collect(const GetUnit& get, std::vector<UpdateBatch>* batches);

 private:
  struct Unit {
    UnitId unit;
    Bits changes;
    std::vector<uint32_t> before;  // per word of `changes`: the set flags before it
    std::vector<uint32_t> levels;  // per node that changes
    uint32_t Place(NodeIndex node) const {
      const uint64_t below = (uint64_t{1} << (node & 63)) - 1;
      return before[node >> 6] + PopCount(changes.words()[node >> 6] & below);
    }
  };
  static uint32_t* Level(Unit* unit, NodeIndex node) {
    if (unit == nullptr || !unit->changes.Test(node)) return nullptr;
    return &unit->levels[unit->Place(node)];
  }
  // Of nodes_[n], in Unit::levels.
  size_t LevelPlace(size_t n) const { return insert_ ? n : nodes_.size() - 1 - n; }
  // The longest chain of changes before each of nodes_, from the units that came before; creators_.
  void FindLevels(Unit& u, const LoadedUnit& unit);
  void PrefetchShapes(const LoadedUnit& unit) const;
  // `creators` of the hole's triangles that the unit creates.
  void AddNode(const LoadedUnit& unit, NodeIndex node, std::span<const NodeIndex> creators,
               UpdateBatch& batch) const;
  void AddHole(const LoadedUnit& unit, NodeIndex node, IndexRange star,
               std::span<const LocalNumber> ring, std::span<const LocalNumber> hole,
               std::span<const NodeIndex> creators, UpdateBatch& batch) const;
  // Of a node that brings a crumb.
  void AddCrumb(const LoadedUnit& unit, NodeIndex node, UpdateBatch& batch) const;
  // Room for the nodes of a batch, of usual rings.
  void Reserve(UpdateBatch& batch) const;

  const ClusterIndex& index_;
  const size_t row_bytes_;
  const bool insert_;
  uint64_t count_ = 0;
  std::vector<Unit> units_;
  // Of the unit at hand.
  std::vector<Unit*> parents_;
  std::vector<NodeIndex> nodes_;     // that change, in the order of their changes
  std::vector<NodeIndex> creators_;  // of their holes
};

}  // namespace mtdb::internal
