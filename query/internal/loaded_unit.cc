// SPDX-License-Identifier: Apache-2.0
#include "query/internal/loaded_unit.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/root_codec.h"

namespace mtdb::internal {
namespace {

template <typename T>
size_t VectorBytes(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

// Gathers the in-triangles of one cluster from its parents.
class Gatherer {
 public:
  Gatherer(const ClusterIndex& index, UnitId unit, const std::string& name,
           std::span<const LoadedUnitPtr> parents)
      : index_(index), unit_(unit), name_(name), entry_(index.unit(unit)) {
    size_t most = 0;
    for (const LoadedUnitPtr& parent : parents) most += parent->own_slots();
    triangles_.reserve(std::min<size_t>(entry_.in_triangles, most));
    origins_.reserve(triangles_.capacity());
  }

  // Appends the parent's out-triangles that the cluster consumes, in slot order.
  Status Add(uint32_t ordinal, const LoadedUnit& parent) {
    const std::vector<UnitId>& children = parent.children();
    const auto it = std::lower_bound(children.begin(), children.end(), unit_);
    if (it == children.end() || *it != unit_) {
      return Corrupt(name_ + ": unit " + std::to_string(parent.id) +
                     " is a parent in the index, but does not name it as a child; rebuild");
    }
    const auto ordinal_there = static_cast<uint32_t>(it - children.begin());
    const auto wanted = static_cast<LocalNumber>(kLocalChildFlag | ordinal_there);
    const std::vector<LocalNumber>& removers = parent.removers().codes();
    const size_t before = triangles_.size();

    NodeIndex creator = kNone32;
    const uint32_t listed = parent.cluster.listed();
    const auto end = static_cast<uint32_t>(removers.size());
    constexpr uint32_t kStride = 16;  // most strides have none
    for (uint32_t begin = parent.first_own_slot(); begin < end; begin += kStride) {
      const uint32_t last = std::min(begin + kStride, end);
      uint32_t any = 0;
      for (uint32_t slot = begin; slot < last; ++slot) any |= removers[slot] == wanted ? 1 : 0;
      if (any == 0) continue;
      // Without a branch, which would be hard to predict.
      uint32_t found[kStride];
      uint32_t count = 0;
      for (uint32_t slot = begin; slot < last; ++slot) {
        found[count] = slot;
        count += removers[slot] == wanted ? 1 : 0;
      }
      if (triangles_.size() + count > entry_.in_triangles) return WrongCount("more");
      for (uint32_t i = 0; i < count; ++i) {
        if (found[i] >= listed) {
          if (creator == kNone32) creator = 0;
          while (parent.cluster.star_begin[creator + 1] <= found[i]) ++creator;
        }
        AddTriangle(ordinal, parent, found[i], creator);
      }
    }
    if (entry_.explicit_arcs) return AddArcs(parent, kChildFlag | ordinal_there, before);
    return Status::Ok();
  }

  // Where the triangles come from: origin(t.origin) for a triangle t of Take().
  const SlotOrigin& origin(uint32_t i) const { return origins_[i]; }
  // Puts the triangles in the order of the cluster's in-slots.
  Result<std::vector<InTriangle>> Take() {
    if (triangles_.size() != entry_.in_triangles) return WrongCount("fewer");
    if (!entry_.explicit_arcs) {
      if (!SortCanonically(triangles_)) {
        return Corrupt(name_ + ": in-triangles coincide, but its parents name no slots; rebuild");
      }
      return std::move(triangles_);
    }
    std::vector<InTriangle> placed(triangles_.size());
    std::vector<bool> taken(triangles_.size(), false);
    for (size_t i = 0; i < triangles_.size(); ++i) {
      const ExplicitArc& arc = arcs_[i];
      if (arc.child_slot >= placed.size() || arc.rotation > 2 || taken[arc.child_slot]) {
        return Corrupt(name_ + ": in-triangle " + std::to_string(arc.child_slot) + " of " +
                       std::to_string(placed.size()) + " is out of range or claimed twice");
      }
      taken[arc.child_slot] = true;
      InTriangle& t = placed[arc.child_slot];
      t = triangles_[i];
      for (int c = 0; c < 3; ++c) {
        const int from = (c + arc.rotation) % 3;
        t.vertices[c] = triangles_[i].vertices[from];
        t.positions[c] = triangles_[i].positions[from];
        t.parent_vertices[c] = triangles_[i].parent_vertices[from];
      }
    }
    return placed;
  }

 private:
  Status WrongCount(const char* relation) const {
    return Corrupt(name_ + ": its parents leave " + relation + " than the " +
                   std::to_string(entry_.in_triangles) + " in-triangles of the index");
  }

  void AddTriangle(uint32_t ordinal, const LoadedUnit& parent, uint32_t slot, NodeIndex creator) {
    InTriangle& t = triangles_.emplace_back();
    t.parent_vertices = parent.corners(slot, creator);
    const LocalPositions& positions = parent.positions();
    for (int c = 0; c < 3; ++c) {
      const uint32_t local = t.parent_vertices[c];
      t.positions[c] = positions[local];
      const uint32_t external = parent.cluster.external_vertices();
      t.vertices[c] = local < external ? parent.vertex(local)
                                       : index_.first_vertex(parent.id) + (local - external);
    }
    t.origin = static_cast<uint32_t>(origins_.size());
    origins_.push_back({static_cast<LocalNumber>(ordinal), static_cast<LocalNumber>(slot),
                        static_cast<LocalNumber>(creator)});
  }

  // The parent's explicit arcs to this cluster, one for each triangle gathered since `before`.
  Status AddArcs(const LoadedUnit& parent, uint32_t wanted, size_t before) {
    const LocalRemovers& removers = parent.removers();
    for (const ExplicitArc& arc : parent.explicit_arcs()) {
      if (arc.slot >= removers.size() || removers[arc.slot] != wanted) continue;
      const size_t i = arcs_.size();
      if (i < before || i >= triangles_.size() || origins_[i].slot != arc.slot) break;
      arcs_.push_back(arc);
    }
    if (arcs_.size() != triangles_.size()) {
      return Corrupt(name_ + ": unit " + std::to_string(parent.id) +
                     " does not name the slot of each of its in-triangles");
    }
    return Status::Ok();
  }

  const ClusterIndex& index_;
  const UnitId unit_;
  const std::string& name_;
  const UnitEntry& entry_;
  std::vector<InTriangle> triangles_;  // until Take()
  std::vector<SlotOrigin> origins_;
  std::vector<ExplicitArc> arcs_;
};

// Fetches what the parents know of the patch's vertices: attributes, and the clusters that insert
// them (kNone32 for a root vertex).
void AskParents(std::span<const InTriangle> triangles, const Gatherer& gatherer,
                std::span<const LoadedUnitPtr> parents, size_t row_bytes, InPatch& patch,
                std::vector<UnitId>& owners) {
  patch.rows.resize(patch.vertices.size() * row_bytes);
  owners.resize(patch.vertices.size());
  uint32_t next = 0;
  for (size_t i = 0; i < triangles.size(); ++i) {
    const LoadedUnit& parent = *parents[gatherer.origin(triangles[i].origin).parent];
    for (size_t c = 0; c < 3; ++c) {
      if (patch.triangles[i][c] != next) continue;
      const uint32_t local = triangles[i].parent_vertices[c];
      owners[next] = local < parent.owners.size() ? parent.owners[local] : parent.id;
      if (row_bytes > 0) {
        std::memcpy(patch.rows.data() + next * row_bytes, parent.rows().data() + local * row_bytes,
                    row_bytes);
      }
      ++next;
    }
  }
}

Status Mismatch(const std::string& name, const char* what, uint64_t expected, uint64_t found) {
  return Corrupt(name + ": " + what + ": the index says " + std::to_string(expected) +
                 ", the payload has " + std::to_string(found));
}

Status CheckRemovers(const std::string& name, const Cluster& c, uint32_t expected_out) {
  const std::vector<uint32_t>& removers = c.removers;
  const uint32_t first_own = c.first_own_slot;
  const uint32_t nodes = c.nodes();
  const auto children = static_cast<uint32_t>(c.children.size());
  const auto by_child = [&](uint32_t r) { return r - kChildFlag < children; };
  const auto legal = [&](uint32_t slot, uint32_t r) {
    return r < nodes || (slot >= first_own && (r == kDrain || by_child(r)));
  };
  // Without branches, which would be hard to predict.
  uint32_t illegal = 0;
  uint32_t out = 0;
  for (uint32_t slot = 0; slot < first_own; ++slot) illegal += removers[slot] >= nodes ? 1 : 0;
  for (uint32_t slot = first_own; slot < removers.size(); ++slot) {
    const uint32_t r = removers[slot];
    const uint32_t leaves = static_cast<uint32_t>(r == kDrain) | static_cast<uint32_t>(by_child(r));
    illegal += 1 - (leaves | static_cast<uint32_t>(r < nodes));
    out += leaves;
  }
  for (uint32_t slot = 0; illegal > 0; ++slot) {
    if (legal(slot, removers[slot])) continue;
    return Corrupt(name + ": triangle " + std::to_string(slot) + " is removed by " +
                   std::to_string(removers[slot]) + ", which does not exist");
  }
  if (out != expected_out) return Mismatch(name, "out-triangles", expected_out, out);
  return Status::Ok();
}

Status CheckUnit(const std::string& name, const ClusterIndex& index, UnitId unit,
                 const Cluster& c) {
  const UnitEntry& entry = index.unit(unit);
  if (c.nodes() != entry.nodes) return Mismatch(name, "nodes", entry.nodes, c.nodes());
  if (c.in_triangles() != entry.in_triangles) {
    return Mismatch(name, "in-triangles", entry.in_triangles, c.in_triangles());
  }
  if (c.external_vertices() != entry.external_vertices) {
    return Mismatch(name, "external vertices", entry.external_vertices, c.external_vertices());
  }
  for (const uint8_t code : c.error_codes) {
    if (code < entry.error_code_min || code > entry.error_code_max) {
      return Corrupt(name + ": error code " + std::to_string(code) + " is outside of the index's " +
                     std::to_string(entry.error_code_min) + ".." +
                     std::to_string(entry.error_code_max));
    }
  }
  if (!std::ranges::equal(index.children(unit), c.children)) {
    return Corrupt(name + ": its children differ from those in the index");
  }
  return CheckRemovers(name, c, entry.out_triangles);
}

std::vector<uint64_t> FindDrain(const LoadedUnit& unit) {
  std::vector<uint64_t> drain((unit.own_slots() + 63) / 64, 0);
  const LocalNumber* removers = unit.removers().codes().data() + unit.first_own_slot();
  for (uint32_t i = 0; i < unit.own_slots(); ++i) {
    drain[i >> 6] |= uint64_t{removers[i] == kLocalDrain} << (i & 63);
  }
  return drain;
}

std::vector<LocalNumber> FindCreators(const LoadedUnit& unit) {
  std::vector<LocalNumber> creators;
  NodeIndex node = 0;
  const uint32_t end = unit.cluster.slots();
  constexpr uint32_t kStep = LoadedUnit::kCreatorStep;
  creators.reserve((end - unit.cluster.listed() + kStep - 1) / kStep);
  for (uint32_t slot = unit.cluster.listed(); slot < end; slot += kStep) {
    while (unit.cluster.star_begin[node + 1] <= slot) ++node;
    creators.push_back(static_cast<LocalNumber>(node));
  }
  return creators;
}

}  // namespace

uint32_t LoadedUnit::FindInSlot(UnitId parent, uint32_t parent_slot) const {
  const auto p = std::find(parents.begin(), parents.end(), parent);
  const std::pair<uint32_t, uint32_t> key(p - parents.begin(), parent_slot);
  const auto origin_of = [&](uint32_t slot) {
    return std::pair<uint32_t, uint32_t>(origins[slot].parent, origins[slot].slot);
  };
  const auto it =
      std::lower_bound(by_origin.begin(), by_origin.end(), key,
                       [&](uint32_t slot, const auto& k) { return origin_of(slot) < k; });
  return it == by_origin.end() || origin_of(*it) != key ? kNone32 : *it;
}

size_t LoadedUnit::memory_bytes() const {
  return sizeof(LoadedUnit) + cluster.memory_bytes() + VectorBytes(parents) + VectorBytes(origins) +
         VectorBytes(by_origin) + VectorBytes(owners) + VectorBytes(drain) + VectorBytes(creators);
}

std::string UnitName(const ObjectRecord& record, UnitId unit) {
  return record.name + ": " + UnitLabel(record, unit);
}

namespace {

// Gathers the in-triangles from the parents and replays the payload on them.
Result<Cluster> DecodeFromParents(const ObjectRecord& record, const ClusterIndex& index,
                                  const std::string& name, ByteSpan payload,
                                  std::span<const LoadedUnitPtr> parents, LoadedUnit& unit) {
  const UnitEntry& entry = index.unit(unit.id);
  unit.parents.assign(index.parents(unit.id).begin(), index.parents(unit.id).end());
  if (parents.size() > kMostSlots) {
    return Corrupt(name + ": " + std::to_string(parents.size()) + " parents");
  }
  Gatherer gatherer(index, unit.id, name, parents);
  for (uint32_t i = 0; i < parents.size(); ++i) {
    MTDB_RETURN_IF_ERROR(gatherer.Add(i, *parents[i]));
  }
  MTDB_ASSIGN_OR_RETURN(const std::vector<InTriangle> triangles, gatherer.Take());
  InPatch patch = MakeInPatch(triangles);
  if (patch.vertices.size() != entry.external_vertices) {
    return Mismatch(name, "external vertices", entry.external_vertices, patch.vertices.size());
  }
  AskParents(triangles, gatherer, parents, record.attributes.row_bytes(), patch, unit.owners);
  // The triangles were gathered in ascending order of their origins.
  unit.origins.resize(triangles.size());
  unit.by_origin.resize(triangles.size());
  for (uint32_t i = 0; i < triangles.size(); ++i) {
    unit.origins[i] = gatherer.origin(triangles[i].origin);
    unit.by_origin[triangles[i].origin] = static_cast<LocalNumber>(i);
  }
  return DecodeCluster(payload, std::move(patch), record.attributes, entry.nodes, name);
}

}  // namespace

Result<LoadedUnitPtr> LoadUnit(const ObjectRecord& record, const ClusterIndex& index, UnitId unit,
                               ByteSpan payload, std::span<const LoadedUnitPtr> parents) {
  const std::string name = UnitName(record, unit);
  auto loaded = std::make_shared<LoadedUnit>();
  loaded->id = unit;
  const bool root = index.unit(unit).round == kRootRound;
  MTDB_ASSIGN_OR_RETURN(
      Cluster cluster,
      root ? DecodeRootPiece(payload, record.attributes, index.root_vertices(), name)
           : DecodeFromParents(record, index, name, payload, parents, *loaded));
  MTDB_RETURN_IF_ERROR(CheckUnit(name, index, unit, cluster));
  MTDB_ASSIGN_OR_RETURN(loaded->cluster, MakeCompact(std::move(cluster), name));
  if (root) loaded->owners.assign(loaded->cluster.external_vertices(), kNone32);
  loaded->drain = FindDrain(*loaded);
  loaded->creators = FindCreators(*loaded);
  return LoadedUnitPtr(std::move(loaded));
}

}  // namespace mtdb::internal
