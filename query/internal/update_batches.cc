#include "query/internal/update_batches.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include "query/internal/fetch_nodes.h"

namespace mtdb {
namespace {

constexpr TriangleKey KeyOf(UnitId unit, uint32_t slot) { return TriangleKey{unit} << 32 | slot; }

}  // namespace

void UpdateBatches::AddUnit(UnitId unit, const Bits& from, const Bits& to) {
  Bits changes = to;
  const uint32_t count = from.empty() ? changes.Count() : changes.RemoveAll(from.words());
  if (count == 0) return;
  Unit& u = units_.emplace_back();
  u.unit = unit;
  u.before = changes.Ranks();
  u.changes = std::move(changes);
  u.levels.resize(count);
  count_ += count;
}

Status UpdateBatches::Collect(const GetUnit& get, std::vector<UpdateBatch>* batches) {
  const size_t first = batches->size();
  // Parents have the larger numbers.
  std::sort(units_.begin(), units_.end(), [&](const Unit& a, const Unit& b) {
    return insert_ ? a.unit > b.unit : a.unit < b.unit;
  });
  std::vector<NodeIndex> nodes;
  for (Unit& u : units_) {
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, get(u.unit));
    parents_.clear();
    for (const UnitId p : unit->parents) {
      const auto at = std::lower_bound(
          units_.begin(), units_.end(), p,
          [&](const Unit& a, UnitId id) { return insert_ ? a.unit > id : a.unit < id; });
      parents_.push_back(at != units_.end() && at->unit == p ? &*at : nullptr);
    }
    nodes.clear();
    u.changes.ForEach([&](NodeIndex node) { nodes.push_back(node); });
    if (!insert_) std::reverse(nodes.begin(), nodes.end());
    const uint32_t first_own = unit->first_own_slot();
    size_t n = 0;
    ForEachFetched(*unit, nodes, true, [&](NodeIndex node) {
      const size_t i = insert_ ? n : nodes.size() - 1 - n;
      ++n;
      creators_.clear();
      for (const uint32_t slot : unit->cluster.hole(node)) {
        uint32_t* parent = nullptr;
        creators_.push_back(slot >= first_own ? unit->creator(slot) : 0);
        if (slot >= first_own) {
          parent = Level(&u, creators_.back());
        } else if (const SlotOrigin& origin = unit->origins[slot]; origin.creator != kNone32) {
          parent = Level(parents_[origin.parent], origin.creator);
        }
        if (parent == nullptr) continue;
        if (insert_) {
          u.levels[i] = std::max(u.levels[i], *parent + 1);
        } else {
          *parent = std::max(*parent, u.levels[i] + 1);
        }
      }
      const size_t batch = first + u.levels[i];
      while (batches->size() <= batch) {
        batches->emplace_back().insert = insert_;
        if (batches->size() == first + 1) Reserve(batches->back());
      }
      AddNode(*unit, node, (*batches)[batch]);
    });
  }
  return Status::Ok();
}

void UpdateBatches::Reserve(UpdateBatch& batch) const {
  constexpr uint64_t kRing = 6;
  batch.nodes.reserve(count_);
  batch.ring.reserve(count_ * kRing);
  batch.holes.reserve(count_ * (kRing - 2));
  batch.rows.reserve(count_ * row_bytes_);
}

void UpdateBatches::AddNode(const LoadedUnit& unit, NodeIndex node, UpdateBatch& batch) const {
  const Cluster& c = unit.cluster;
  const uint32_t external = c.external_vertices();
  const VertexIndex first_vertex = index_.first_vertex(ClusterId(unit.id));
  const uint32_t local = external + node;
  UpdateBatch::Node& out = batch.nodes.emplace_back();
  out.vertex = first_vertex + node;
  out.position = c.position(local);
  out.boundary = c.boundary(node);
  out.first_star = KeyOf(unit.id, c.star_begin[node]);
  out.ring_begin = static_cast<uint32_t>(batch.ring.size());
  const std::span<const uint32_t> ring = c.ring(node);
  out.ring_count = static_cast<uint32_t>(ring.size());
  for (const uint32_t v : ring) {
    batch.ring.push_back(v < external ? c.in.vertices[v] : first_vertex + (v - external));
  }
  out.hole_begin = static_cast<uint32_t>(batch.holes.size());
  const std::span<const uint32_t> hole = c.hole(node);
  for (size_t h = 0; h < hole.size(); ++h) {
    const uint32_t slot = hole[h];
    UpdateBatch::HoleTriangle& t = batch.holes.emplace_back();
    const bool own = slot >= unit.first_own_slot();
    if (own) {
      t.key = KeyOf(unit.id, slot);
    } else {
      t.key = KeyOf(unit.parents[unit.origins[slot].parent], unit.origins[slot].slot);
    }
    const std::array<uint32_t, 3> corners = unit.corners(slot, creators_[h]);
    for (size_t i = 0; i < 3; ++i) {
      t.corners[i] =
          static_cast<uint8_t>(std::find(ring.begin(), ring.end(), corners[i]) - ring.begin());
    }
  }
  const auto row = c.in.rows.begin() + static_cast<std::ptrdiff_t>(local * row_bytes_);
  batch.rows.insert(batch.rows.end(), row, row + static_cast<std::ptrdiff_t>(row_bytes_));
}

}  // namespace mtdb
