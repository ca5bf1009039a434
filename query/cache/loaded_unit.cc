// SPDX-License-Identifier: Apache-2.0
#include "query/cache/loaded_unit.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <numeric>
#include <string>
#include <utility>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/root_codec.h"
#include "store/base/open_table.h"

namespace mtdb::internal {
namespace {

template <typename T>
size_t VectorBytes(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

// Gathers the in-triangles of one cluster from its parents, and their vertices, each once.
class Gatherer {
 public:
  Gatherer(const ClusterIndex& index, UnitId unit, const std::string& name,
           std::span<const LoadedUnitPtr> parents)
      : index_(index), unit_(unit), name_(name), entry_(index.unit(unit)), parents_(parents) {
    size_t most = 0;
    for (const LoadedUnitPtr& parent : parents) most += parent->own_slots();
    triangles_.reserve(std::min<size_t>(entry_.in_triangles, most));
    origins_.reserve(triangles_.capacity());
    vertices_.reserve(triangles_.capacity());
    positions_.reserve(triangles_.capacity());
    // At most three quarters full.
    table_.Reset(4 * triangles_.capacity() + 2);
  }

  // Appends the parent's out-triangles that the cluster consumes, in slot order.
  Status Add(uint32_t ordinal) {
    const LoadedUnit& parent = *parents_[ordinal];
    const std::vector<UnitId>& children = parent.children();
    const auto it = std::lower_bound(children.begin(), children.end(), unit_);
    if (it == children.end() || *it != unit_) {
      return Corrupt(name_ + ": unit " + std::to_string(parent.id) +
                     " is a parent in the index, but does not name it as a child; rebuild");
    }
    const auto ordinal_there = static_cast<uint32_t>(it - children.begin());
    const std::span<const LocalNumber> slots = parent.slots_of_child(ordinal_there);
    const size_t before = triangles_.size();
    if (slots.size() > entry_.in_triangles - taken_) return WrongCount("more");
    taken_ += slots.size();

    // Step by step for all, and without branches that are hard to predict, so that waiting for
    // memory overlaps: what is read lies far apart.
    for (const uint32_t slot : slots) parent.PrefetchCreator(slot);
    for (const uint32_t slot : slots) {
      if (parent.cluster.is_mirror(slot)) continue;
      const NodeIndex creator = CreatorOf(parent, slot);
      parent.PrefetchCorners(slot, creator);
      origins_.push_back({static_cast<LocalNumber>(ordinal), static_cast<LocalNumber>(slot),
                          static_cast<LocalNumber>(creator)});
    }
    numbers_.assign(parent.positions().size(), kNone32);
    for (size_t i = before; i < origins_.size(); ++i) {
      triangles_.push_back(parent.corners(origins_[i].slot, origins_[i].creator()));
      for (const uint32_t local : triangles_.back()) {
        parent.positions().Prefetch(local);
        numbers_[local] = 0;
      }
    }
    NumberVertices(ordinal, parent);
    for (std::array<uint32_t, 3>& corners : std::span(triangles_).subspan(before)) {
      for (uint32_t& corner : corners) corner = numbers_[corner];
    }
    if (entry_.explicit_arcs) return AddArcs(parent, kChildFlag | ordinal_there, before);
    return Status::Ok();
  }

  // Of the triangles in the order in which they were added.
  const std::vector<SlotOrigin>& origins() const { return origins_; }

  // The triangles that are in the cluster's in-slots, of those that are two-sided one side.
  Result<std::vector<InSlot>> FindSlots() const {
    if (taken_ != entry_.in_triangles) return WrongCount("fewer");
    if (!entry_.explicit_arcs) {
      CanonicalOrder order = SortCanonically(triangles_, positions_);
      if (!order.unique) {
        return Corrupt(name_ + ": in-triangles coincide, but its parents name no slots; rebuild");
      }
      return std::move(order.slots);
    }
    std::vector<InSlot> slots(triangles_.size(), {kNone32, 0});
    for (uint32_t i = 0; i < slots.size(); ++i) {
      const ExplicitArc& arc = arcs_[i];
      if (arc.child_slot >= slots.size() || arc.rotation > 2 ||
          slots[arc.child_slot].triangle != kNone32) {
        return Corrupt(name_ + ": in-triangle " + std::to_string(arc.child_slot) + " of " +
                       std::to_string(slots.size()) + " is out of range or claimed twice");
      }
      slots[arc.child_slot] = {i, arc.rotation};
    }
    return slots;
  }

  // With rows of so many bytes. `owners`: of its vertices, the clusters that insert them (kNone32
  // for a root vertex).
  // `textured`: all parents have corners.
  InPatch MakePatch(std::span<const InSlot> slots, size_t row_bytes, bool textured,
                    std::vector<UnitId>& owners) const {
    InPatch patch = MakeInPatch(triangles_, positions_, slots);
    if (textured) AddCorners(slots, patch);
    if (std::ranges::any_of(parents_, [](const auto& p) { return !p->cluster.mirrors.empty(); })) {
      for (const InSlot& slot : slots) patch.two_sided.push_back(IsTwoSided(slot.triangle));
      if (std::ranges::count(patch.two_sided, 0) == std::ssize(slots)) patch.two_sided.clear();
    }
    patch.rows.resize(patch.vertices.size() * row_bytes);
    owners.resize(patch.vertices.size());
    for (size_t v = 0; v < patch.vertices.size(); ++v) {
      const Vertex& vertex = vertices_[patch.vertices[v]];
      patch.vertices[v] = vertex.index;
      const LoadedUnit& parent = *parents_[vertex.parent];
      owners[v] = vertex.local < parent.owners.size() ? parent.owners[vertex.local] : parent.id;
      if (row_bytes > 0) {
        std::memcpy(patch.rows.data() + v * row_bytes,
                    parent.rows().data() + vertex.local * row_bytes, row_bytes);
      }
    }
    return patch;
  }

 private:
  struct Vertex {
    VertexIndex index;
    LocalNumber parent, local;  // one of the parents that know it
  };

  Status WrongCount(const char* relation) const {
    return Corrupt(name_ + ": its parents leave " + relation + " than the " +
                   std::to_string(entry_.in_triangles) + " in-triangles of the index");
  }

  // Of a textured object.
  void AddCorners(std::span<const InSlot> slots, InPatch& patch) const {
    for (const InSlot& slot : slots) {
      const SlotOrigin& origin = origins_[slot.triangle];
      const std::array<TextureCorner, 3> corners =
          parents_[origin.parent]->cluster.texture(origin.slot);
      for (uint32_t i = 0; i < 3; ++i)
        patch.corners.push_back(corners[(i + slot.first_corner) % 3]);
    }
  }
  bool IsTwoSided(size_t triangle) const {
    const SlotOrigin& origin = origins_[triangle];
    return parents_[origin.parent]->cluster.two_sided(origin.slot);
  }

  // As parent.creator(slot).
  static NodeIndex CreatorOf(const LoadedUnit& parent, uint32_t slot) {
    const CompactCluster& c = parent.cluster;
    if (slot < c.listed()) return kNone32;
    const NodeIndex first = parent.creators[(slot - c.listed()) / LoadedUnit::kCreatorStep];
    constexpr uint32_t kMost = LoadedUnit::kCreatorStep / 3;  // nodes that begin on the way, mostly
    NodeIndex node = first;
    for (uint32_t i = 1; i <= kMost; ++i) {
      node += c.star_begin[std::min(first + i, c.nodes())] <= slot ? 1 : 0;
    }
    while (c.star_begin[node + 1] <= slot) ++node;
    return node;
  }

  // Sets the numbers of the local vertices whose numbers are 0.
  void NumberVertices(uint32_t ordinal, const LoadedUnit& parent) {
    found_.resize(numbers_.size() + 1);
    size_t count = 0;
    for (uint32_t local = 0; local < numbers_.size(); ++local) {
      found_[count] = local;
      count += numbers_[local] == 0 ? 1 : 0;
    }
    for (const uint32_t local : std::span(found_).first(count)) {
      numbers_[local] = FindVertex(ordinal, parent, local);
    }
  }

  // The number of a parent's local vertex, which another parent may know as well.
  uint32_t FindVertex(uint32_t ordinal, const LoadedUnit& parent, uint32_t local) {
    const uint32_t external = parent.cluster.external_vertices();
    const VertexIndex index = local < external
                                  ? parent.vertex(local)
                                  : index_.first_vertex(parent.id) + (local - external);
    uint32_t& number =
        table_.Find(HashOfNumber(index), [&](uint32_t n) { return vertices_[n].index == index; });
    if (number == kNone32) {
      number = static_cast<uint32_t>(vertices_.size());
      vertices_.push_back(
          {index, static_cast<LocalNumber>(ordinal), static_cast<LocalNumber>(local)});
      positions_.push_back(parent.positions()[local]);
    }
    return number;
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
  const std::span<const LoadedUnitPtr> parents_;
  std::vector<std::array<uint32_t, 3>> triangles_;  // of numbers of vertices
  std::vector<SlotOrigin> origins_;                 // likewise
  size_t taken_ = 0;                                // triangles, both sides counted
  std::vector<ExplicitArc> arcs_;                   // likewise, or empty
  std::vector<Vertex> vertices_;
  std::vector<Vec3i> positions_;  // of vertices
  OpenTable<uint32_t> table_;     // numbers of vertices, by their index
  // Of the local vertices of the parent that is being added.
  std::vector<uint32_t> numbers_;
  std::vector<uint32_t> found_;
};

Status Mismatch(const std::string& name, const char* what, uint64_t expected, uint64_t found) {
  return Corrupt(name + ": " + what + ": the index says " + std::to_string(expected) +
                 ", the payload has " + std::to_string(found));
}

Status CheckRemovers(const std::string& name, const CompactCluster& c, uint32_t expected_out) {
  const std::vector<LocalNumber>& removers = c.removers.codes();
  const auto nodes = static_cast<LocalNumber>(c.nodes());
  const auto children = static_cast<LocalNumber>(c.children.size());
  const auto by_node = [&](LocalNumber r) { return LocalNumber{r < nodes}; };
  const auto leaves = [&](LocalNumber r) {
    const auto child = static_cast<LocalNumber>(r - kLocalChildFlag);
    return static_cast<LocalNumber>(LocalNumber{r == kLocalDrain} | LocalNumber{child < children});
  };
  // Without branches, which would be hard to predict, and in 16 bits, eight at a time. A cluster
  // has too few slots to overflow them.
  LocalNumber illegal = 0;
  LocalNumber out = 0;
  for (const LocalNumber r : std::span(removers).first(c.first_own_slot)) {
    illegal = static_cast<LocalNumber>(illegal + (by_node(r) ^ 1));
  }
  for (const LocalNumber r : std::span(removers).subspan(c.first_own_slot)) {
    const LocalNumber leaving = leaves(r);
    out = static_cast<LocalNumber>(out + leaving);
    illegal = static_cast<LocalNumber>(illegal + ((leaving | by_node(r)) ^ 1));
  }
  for (uint32_t slot = 0; illegal > 0; ++slot) {
    const LocalNumber r = removers[slot];
    if (by_node(r) || (slot >= c.first_own_slot && leaves(r))) continue;
    return Corrupt(name + ": triangle " + std::to_string(slot) + " is removed by " +
                   std::to_string(FromLocalRemover(r)) + ", which does not exist");
  }
  if (out != expected_out) return Mismatch(name, "out-triangles", expected_out, out);
  return Status::Ok();
}

Status CheckUnit(const std::string& name, const ClusterIndex& index, UnitId unit,
                 const CompactCluster& c) {
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

// Each slot of a textured object's unit has corners, whose pages are there.
Status CheckCorners(const std::string& name, const ObjectRecord& record, const CompactCluster& c) {
  if (c.corner_places.size() != (record.texture ? c.slots() : 0)) {
    return Corrupt(name + ": corners of " + std::to_string(c.corner_places.size()) + " of " +
                   std::to_string(c.slots()) + " triangles");
  }
  if (!record.texture) return Status::Ok();
  for (const TextureCorner& corner : c.corners) {
    if (corner.page < record.texture->pages.size() || corner.page == TextureCorner::kNoPage) {
      continue;
    }
    return Corrupt(name + ": a corner on page " + std::to_string(corner.page) +
                   ", but the object has " + std::to_string(record.texture->pages.size()));
  }
  return Status::Ok();
}

std::vector<uint64_t> FindDrain(const LoadedUnit& unit) {
  std::vector<uint64_t> drain((unit.own_slots() + 63) / 64, 0);
  const LocalNumber* removers = unit.removers().codes().data() + unit.first_own_slot();
  constexpr uint32_t kBits = 8;  // at a time
  const uint32_t end = unit.own_slots() / kBits * kBits;
  for (uint32_t i = 0; i < end; i += kBits) {
    uint32_t bits = 0;
    for (uint32_t j = 0; j < kBits; ++j) bits |= (removers[i + j] == kLocalDrain ? 1u : 0u) << j;
    drain[i >> 6] |= uint64_t{bits} << (i & 63);
  }
  for (uint32_t i = end; i < unit.own_slots(); ++i) {
    drain[i >> 6] |= uint64_t{removers[i] == kLocalDrain} << (i & 63);
  }
  return drain;
}

// Sets out_begin and out_slots.
void FindOutSlots(LoadedUnit& unit) {
  const LocalNumber* const removers = unit.removers().codes().data();
  const auto goes_to_child = [&](uint32_t slot) -> uint32_t {
    return removers[slot] >= kLocalChildFlag && removers[slot] != kLocalDrain ? 1 : 0;
  };
  const auto child_of = [&](uint32_t slot) {
    return static_cast<uint32_t>(removers[slot] & ~kLocalChildFlag);
  };
  std::vector<LocalNumber> found(unit.own_slots() + 1);
  uint32_t count = 0;
  for (uint32_t slot = unit.first_own_slot(); slot < unit.cluster.slots(); ++slot) {
    found[count] = static_cast<LocalNumber>(slot);
    count += goes_to_child(slot);
  }
  found.resize(count);
  const size_t children = unit.children().size();
  unit.out_begin.resize(children + 1);
  for (const uint32_t slot : found) ++unit.out_begin[child_of(slot) + 1];
  for (size_t c = 0; c < children; ++c) {
    unit.out_begin[c + 1] = static_cast<LocalNumber>(unit.out_begin[c + 1] + unit.out_begin[c]);
  }
  unit.out_slots.resize(count);
  std::vector<LocalNumber> next = unit.out_begin;
  for (const uint32_t slot : found) {
    unit.out_slots[next[child_of(slot)]++] = static_cast<LocalNumber>(slot);
  }
}

std::vector<LocalNumber> FindCreators(const LoadedUnit& unit) {
  constexpr uint32_t kStep = LoadedUnit::kCreatorStep;
  const std::vector<LocalNumber>& star_begin = unit.cluster.star_begin;
  const uint32_t listed = unit.cluster.listed();
  std::vector<LocalNumber> creators((unit.cluster.slots() - listed + kStep - 1) / kStep);
  if (creators.empty()) return creators;
  // The last node that begins at or before a step's slot writes last.
  const auto last = static_cast<uint32_t>(creators.size() - 1);
  for (NodeIndex node = 0; node < unit.nodes(); ++node) {
    uint32_t step = (star_begin[node] - listed + kStep - 1) / kStep;
    if (step > last) break;
    creators[step] = static_cast<LocalNumber>(node);
    // A long star reaches further steps.
    while (++step <= last && step * kStep + listed < star_begin[node + 1]) {
      creators[step] = static_cast<LocalNumber>(node);
    }
  }
  return creators;
}

}  // namespace

uint32_t LoadedUnit::FindInSlot(const Arc& arc) const {
  uint32_t slot = kNone32;
  FindInSlots({&arc, 1}, &slot);
  return slot;
}

void LoadedUnit::FindInSlots(std::span<const Arc> arcs, uint32_t* slots) const {
  struct Search {
    uint64_t key;
    size_t first;  // in by_origin: those before are smaller
  };
  std::array<Search, kArcsAtOnce> searches;
  const auto key_at = [&](size_t place) {
    const SlotOrigin& origin = origins[by_origin[place]];
    return uint64_t{origin.parent} << 32 | origin.slot;
  };
  for (size_t i = 0; i < arcs.size(); ++i) {
    const auto p = static_cast<uint64_t>(std::find(parents.begin(), parents.end(), arcs[i].parent) -
                                         parents.begin());
    searches[i] = {p << 32 | arcs[i].slot, 0};
    slots[i] = kNone32;
  }
  if (by_origin.empty()) return;
  for (size_t left = by_origin.size(); left > 1;) {
    const size_t half = left / 2;
    for (size_t i = 0; i < arcs.size(); ++i) {
      Search& s = searches[i];
      s.first += key_at(s.first + half - 1) < s.key ? half : 0;
    }
    left -= half;
  }
  for (size_t i = 0; i < arcs.size(); ++i) {
    if (key_at(searches[i].first) == searches[i].key) slots[i] = by_origin[searches[i].first];
  }
}

size_t LoadedUnit::memory_bytes() const {
  return sizeof(LoadedUnit) + cluster.memory_bytes() + VectorBytes(parents) + VectorBytes(origins) +
         VectorBytes(by_origin) + VectorBytes(owners) + VectorBytes(drain) + VectorBytes(creators) +
         VectorBytes(out_begin) + VectorBytes(out_slots);
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
  if (entry.in_triangles > kMostSlots) {
    return Corrupt(name + ": " + std::to_string(entry.in_triangles) +
                   " in-triangles are more than a cluster may have");
  }
  Gatherer gatherer(index, unit.id, name, parents);
  for (uint32_t i = 0; i < parents.size(); ++i) MTDB_RETURN_IF_ERROR(gatherer.Add(i));
  MTDB_ASSIGN_OR_RETURN(const std::vector<InSlot> slots, gatherer.FindSlots());
  InPatch patch = gatherer.MakePatch(slots, record.attributes.row_bytes(),
                                     record.texture.has_value(), unit.owners);
  if (patch.vertices.size() != entry.external_vertices) {
    return Mismatch(name, "external vertices", entry.external_vertices, patch.vertices.size());
  }
  if (record.texture) patch.corner_step = record.texture->step;
  // The triangles were gathered in ascending order of their origins.
  unit.origins.resize(slots.size());
  unit.by_origin.resize(slots.size());
  for (uint32_t i = 0; i < slots.size(); ++i) {
    unit.origins[i] = gatherer.origins()[slots[i].triangle];
    unit.by_origin[slots[i].triangle] = static_cast<LocalNumber>(i);
  }
  return DecodeCluster(payload, std::move(patch), record.attributes, entry.nodes, name);
}

// Of a cluster with two-sided triangles, whose slots have become more: where those of the other
// sides come from.
void AddOtherSides(std::span<const LoadedUnitPtr> parents, LoadedUnit& unit) {
  const CompactCluster& c = unit.cluster;
  const std::vector<SlotOrigin> told = std::move(unit.origins);
  unit.origins.resize(c.in_triangles());
  size_t next = 0;
  for (uint32_t slot = 0; slot < c.in_triangles(); ++slot) {
    if (c.is_mirror(slot)) continue;
    const SlotOrigin origin = unit.origins[slot] = told[next++];
    if (!c.two_sided(slot)) continue;
    const LocalNumber mirror = parents[origin.parent]->cluster.mirrors[origin.slot];
    unit.origins[c.mirrors[slot]] = {origin.parent, mirror, origin.made_by};
  }
  unit.by_origin.resize(c.in_triangles());
  std::iota(unit.by_origin.begin(), unit.by_origin.end(), LocalNumber{0});
  std::ranges::sort(unit.by_origin, {}, [&](LocalNumber slot) {
    return std::pair(unit.origins[slot].parent, unit.origins[slot].slot);
  });
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
      root ? DecodeRootPiece(payload, record.attributes, index.root_vertices(), name,
                             record.texture ? std::optional(record.texture->step) : std::nullopt)
           : DecodeFromParents(record, index, name, payload, parents, *loaded));
  MTDB_ASSIGN_OR_RETURN(loaded->cluster, MakeCompact(std::move(cluster), name));
  MTDB_RETURN_IF_ERROR(CheckUnit(name, index, unit, loaded->cluster));
  MTDB_RETURN_IF_ERROR(CheckCorners(name, record, loaded->cluster));
  if (!root && !loaded->cluster.mirrors.empty()) AddOtherSides(parents, *loaded);
  if (root) loaded->owners.assign(loaded->cluster.external_vertices(), kNone32);
  loaded->drain = FindDrain(*loaded);
  loaded->creators = FindCreators(*loaded);
  FindOutSlots(*loaded);
  return LoadedUnitPtr(std::move(loaded));
}

}  // namespace mtdb::internal
