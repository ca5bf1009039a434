// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/internal/cluster_payload.h"
#include "codecs/cluster/internal/corners.h"
#include "codecs/cluster/internal/crumbs.h"
#include "codecs/cluster/internal/explicit_arcs.h"
#include "codecs/cluster/internal/lattice.h"
#include "codecs/cluster/internal/streams.h"
#include "codecs/coding/attribute_coder.h"
#include "codecs/coding/cluster_model.h"
#include "codecs/coding/hole_frame.h"
#include "codecs/coding/patch.h"
#include "codecs/coding/rans.h"

namespace mtdb {

using namespace internal;

namespace {

// What is coded about a node's vertex, kept until it is known how to code n.
struct VertexResidual {
  int32_t u, v, n;
  float variance_u, variance_v, variance_n, slant;
  uint32_t ring_class;
  uint32_t hole_size, least_code;
};

int32_t Difference(int32_t value, int32_t expected) {
  return static_cast<int32_t>(static_cast<uint32_t>(value) - static_cast<uint32_t>(expected));
}

VertexResidual MeasureVertex(const Patch& patch, const Patch::Hole& hole, bool boundary, bool flat,
                             Vec3i p) {
  HoleFrame frame;
  frame.Set(patch, hole.slot_span(), hole.ring_span(), boundary, flat);
  const int32_t u = p[frame.axis_u()];
  const int32_t v = p[frame.axis_v()];
  const int32_t n = p[frame.axis_n()];
  return {Difference(u, frame.ExpectU()),
          Difference(v, frame.ExpectV(u)),
          Difference(n, frame.ExpectN(patch, hole.slot_span(), u, v)),
          frame.variance_u(),
          frame.variance_v(),
          frame.unevenness(patch, hole.ring_span()),
          frame.slant(),
          static_cast<uint32_t>(PositionModel::RingClass(hole.ring_count, boundary)),
          hole.slot_count,
          hole.least_code};
}

// True when the errors bound the heights of nearly all vertices above their holes, in grid cells;
// false when errors and positions have different units (PositionMode::kLossless).
bool ErrorsBoundHeights(const std::vector<VertexResidual>& residuals,
                        const std::vector<uint8_t>& codes) {
  size_t within = 0;
  for (size_t i = 0; i < residuals.size(); ++i) {
    const VertexResidual& r = residuals[i];
    within += std::abs(static_cast<float>(r.n)) <= kErrorInCells[codes[i]] * r.slant + 1;
  }
  return within * 10 >= residuals.size() * 9;
}

// Which node removes and which one creates each triangle of the updates; kNone32: none of them, or
// a crumb.
struct Owners {
  std::vector<uint32_t> removers, creators;
  std::vector<uint8_t> triggers;  // of some crumb
};

Owners FindOwners(const ClusterUpdates& updates) {
  Owners owners;
  owners.removers.resize(updates.triangles.size(), kNone32);
  owners.creators.resize(updates.triangles.size(), kNone32);
  for (uint32_t i = 0; i < updates.nodes.size(); ++i) {
    for (const uint32_t t : updates.hole(i)) owners.removers[t] = i;
    for (const uint32_t t : updates.star(i)) owners.creators[t] = i;
  }
  owners.triggers.resize(updates.triangles.size());
  for (const ClusterUpdates::Crumb& crumb : updates.crumbs) {
    for (const uint32_t t : crumb.triggers) owners.triggers[t] = 1;
  }
  return owners;
}

// The typical exponent of the squared longest edge of the out-triangles that nodes created.
int ReferenceLength(const ClusterUpdates& updates, const Owners& owners) {
  uint64_t sum = 0;
  uint64_t count = 0;
  for (size_t t = 0; t < updates.triangles.size(); ++t) {
    if (owners.creators[t] == kNone32 || owners.removers[t] != kNone32) continue;
    const auto& c = updates.triangles[t];
    double longest = 0;
    for (size_t i = 0; i < 3; ++i) {
      Vec3d edge = ToDouble(updates.positions[c[(i + 1) % 3]]) - ToDouble(updates.positions[c[i]]);
      if (updates.is_height_field) edge.z = 0;
      longest = std::max(longest, SquaredLength(edge));
    }
    sum += static_cast<uint64_t>(ExponentOf(static_cast<float>(longest)));
    ++count;
  }
  return count == 0 ? 0 : static_cast<int>((sum + count / 2) / count);
}

// Finds the in-triangles and puts them in their canonical order: sets what `result` says of them,
// and returns the patch, whose vertices are numbers of `updates`.
InPatch OrderInTriangles(const ClusterUpdates& updates, const Owners& owners,
                         EncodedCluster& result) {
  std::vector<std::array<uint32_t, 3>> in;
  std::vector<uint32_t> numbers;  // in `updates`
  for (uint32_t t = 0; t < updates.triangles.size(); ++t) {
    if (owners.creators[t] != kNone32) continue;
    if (owners.removers[t] == kNone32 && !owners.triggers[t]) continue;
    in.push_back(updates.triangles[t]);
    numbers.push_back(t);
  }
  const CanonicalOrder order = SortCanonically(in, updates.positions);
  result.explicit_arcs = !order.unique;
  for (const InSlot& slot : order.slots) {
    result.in_triangles.push_back(numbers[slot.triangle]);
    result.in_rotations.push_back(static_cast<uint8_t>(slot.first_corner));
  }
  InPatch patch = MakeInPatch(in, updates.positions, order.slots);
  if (!updates.two_sided.empty()) {
    for (const uint32_t t : result.in_triangles) patch.two_sided.push_back(updates.two_sided[t]);
  }
  if (!updates.corners.empty()) {
    patch.corner_step = updates.corner_step;
    for (uint32_t slot = 0; slot < result.in_triangles.size(); ++slot) {
      for (size_t i = 0; i < 3; ++i) {
        patch.corners.push_back(
            updates.corners[result.in_triangles[slot]][(i + result.in_rotations[slot]) % 3]);
      }
    }
  }
  result.external_vertices = static_cast<uint32_t>(patch.vertices.size());
  return patch;
}

// Replays the updates in the order in which a reader will, which it finds on the way, and codes
// what a reader needs to go on: which nodes there are, their holes and attributes. What is coded
// when all is known (vertices, errors, arcs) is kept.
class Replay {
 public:
  Replay(const ClusterUpdates& updates, const Owners& owners, const AttributeLayout& attributes,
         const InPatch& in, std::span<const uint32_t> hidden_seams, int reference_length,
         ClusterModels& models, ModelObserver* observer, bool try_lattice)
      : topology(observer),
        patch(in.triangles, in.positions, reference_length, updates.nodes.size(),
              updates.is_height_field, in.two_sided, {in.corners, hidden_seams}),
        any_boundary(std::any_of(updates.nodes.begin(), updates.nodes.end(),
                                 [](const auto& node) { return node.boundary(); })),
        any_fans(std::any_of(updates.nodes.begin(), updates.nodes.end(),
                             [](const auto& node) { return node.fans > 1; })),
        updates_(updates),
        owners_(owners),
        attribute_coder_(attributes),
        models_(models),
        observer_(observer),
        stored_vertex_(updates.positions.size(), kNone32) {
    residuals.reserve(updates.nodes.size());
    codes.reserve(updates.nodes.size());
    rows_.reserve(updates.rows.size());
    for (const VertexIndex v : in.vertices) NumberVertex(static_cast<uint32_t>(v));
    if (any_fans) patch.IndexCreases();
    if (try_lattice) {
      lattice = Lattice::Make(patch, in.positions, updates.nodes.size(), any_boundary);
      if (lattice) patch.LeaveOutShapes();
    }
  }

  // `in_triangles`: slot by slot. Returns false when the lattice does not tell the holes, as with
  // updates that were not made by the Delaunay rule.
  bool Run(std::span<const uint32_t> in_triangles);

  uint32_t stored_vertex(uint32_t vertex) const { return stored_vertex_[vertex]; }

  std::vector<uint32_t> node_order;     // stored node -> ClusterUpdates::nodes
  std::vector<uint32_t> slot_triangle;  // slot -> ClusterUpdates::triangles
  std::vector<uint8_t> codes;           // of the stored nodes' errors
  std::vector<VertexResidual> residuals;
  RansEncoder topology;
  RansEncoder attribute_stream;
  Patch patch;
  const bool any_boundary, any_fans;
  std::optional<Lattice> lattice;

 private:
  bool Insert(uint32_t slot, uint32_t i);
  void WalkHole(uint32_t first, uint32_t anchor, uint32_t i, Patch::Hole& hole);
  void PutStar(const Patch::Hole& hole, bool open);
  void InsertOtherFans(uint32_t anchor, uint32_t i, const Patch::Hole& first_hole);
  bool CodeTake(uint32_t count, uint32_t slot, uint32_t shape, bool take);
  bool CodeVertex(uint32_t slot, const Patch::Hole& hole, Vec3i p, uint32_t split);
  uint32_t MatchStar(uint32_t i, const Patch::Hole& hole);
  void EncodeRow(uint32_t vertex, std::span<const uint32_t> ring);
  void NumberVertex(uint32_t vertex);

  const ClusterUpdates& updates_;
  const Owners& owners_;
  AttributeCoder attribute_coder_;
  ClusterModels& models_;
  ModelObserver* observer_;
  // Vertices get their stored numbers one after the other, with rows and positions.
  std::vector<uint32_t> stored_vertex_;
  uint32_t stored_vertices_ = 0;
  Bytes rows_;
  std::vector<Vec3i> positions_;
  // Of the node that is inserted.
  std::array<uint32_t, kMaxRing> star_;  // by ring edge of one hole
  std::vector<uint32_t> ring_;           // of all holes
  std::vector<Vec3i> ring_positions_;
};

bool Replay::Run(std::span<const uint32_t> in_triangles) {
  const size_t nodes = updates_.nodes.size();
  slot_triangle.assign(in_triangles.begin(), in_triangles.end());
  std::vector<uint32_t> waiting(nodes);  // hole triangles not visited yet
  for (uint32_t i = 0; i < nodes; ++i) waiting[i] = updates_.nodes[i].hole_count;
  uint32_t generation_end = patch.slots();
  for (uint32_t slot = 0; codes.size() < nodes; ++slot) {
    if (slot == generation_end) {
      patch.EndGeneration(codes);
      generation_end = patch.slots();
    }
    MTDB_CHECK(slot < generation_end, "the updates of a cluster form a cycle");
    const uint32_t i = owners_.removers[slot_triangle[slot]];
    const bool is_anchor = i != kNone32 && --waiting[i] == 0;
    if (lattice) {
      const bool coded =
          CodeLatticeAnchor(topology.lane(0), models_.lattice, patch, *lattice, slot, is_anchor);
      if (coded != is_anchor || lattice->exhausted()) return false;
    } else {
      models_.topology.CodeAnchor(topology.lane(0), patch, slot, is_anchor);
    }
    if (is_anchor && !Insert(slot, i)) return false;
  }
  return true;
}

bool Replay::CodeTake(uint32_t count, uint32_t slot, uint32_t shape, bool take) {
  if (!lattice) return models_.topology.CodeTake(topology.lane(1), count, shape, take);
  if (lattice->count() == 0) return take;  // the vertex was not among them
  const uint32_t inside = lattice->CountInside(patch, slot);
  models_.lattice.CodeTake(topology.lane(1), inside, lattice->count(), take);
  lattice->Keep(take);
  return take;
}

// Of a vertex on the lattice. Returns false when a reader would not find it.
bool Replay::CodeVertex(uint32_t slot, const Patch::Hole& hole, Vec3i p, uint32_t split) {
  lattice->Exclude(patch, hole, slot);
  const LatticePoint vertex = lattice->ToLattice(p);
  const uint32_t number = lattice->NumberOf(vertex);
  if (number == lattice->count()) return false;
  models_.lattice.CodeIndex(topology.lane(1), lattice->count(), number);
  return !any_boundary || lattice->SplitEdge(hole, vertex) == split;
}

void Replay::WalkHole(uint32_t first, uint32_t anchor, uint32_t i, Patch::Hole& hole) {
  const bool walked =
      patch.WalkHole(first, anchor, static_cast<uint32_t>(codes.size()), hole,
                     [&](bool possible, uint32_t count, uint32_t other, uint32_t shape) {
                       if (!possible) return false;
                       const bool take = owners_.removers[slot_triangle[other]] == i;
                       return CodeTake(count, other, shape, take);
                     });
  MTDB_CHECK(walked, "a hole is not a disc");
}

// Inserts node `i`, whose anchor is visited.
bool Replay::Insert(uint32_t slot, uint32_t i) {
  const ClusterUpdates::Node& node = updates_.nodes[i];
  uint32_t hole_slots[kHoleEntries];
  uint32_t ring_vertices[kHoleEntries];
  Patch::Hole hole{hole_slots, ring_vertices};
  WalkHole(slot, slot, i, hole);
  MTDB_CHECK(hole.slot_count == node.hole_count || node.fans > 1, "a hole is not a disc");
  const uint32_t split = MatchStar(i, hole);
  const Vec3i p = updates_.positions[node.vertex];
  if (lattice) {
    if (!CodeVertex(slot, hole, p, split)) return false;
  } else if (any_boundary) {
    CodeSplitEdge(topology.lane(1), models_.topology, hole, split);
  }
  if (split != kNone32) {
    std::rotate(star_.begin(), star_.begin() + split + 1, star_.begin() + hole.ring_count);
    hole.Rotate(split);
    patch.OpenStar(hole);
  }
  PutStar(hole, split != kNone32);
  residuals.push_back(MeasureVertex(patch, hole, node.boundary(), updates_.is_height_field, p));
  ring_.assign(hole.ring_span().begin(), hole.ring_span().end());
  if (node.fans > 1) InsertOtherFans(slot, i, hole);
  if (lattice) lattice->AddVertex(patch, lattice->ToLattice(p));
  node_order.push_back(i);
  codes.push_back(node.error_code);
  if (attribute_coder_.row_bytes() != 0) EncodeRow(node.vertex, ring_);
  NumberVertex(node.vertex);
  patch.AddPoint(p);
  return true;
}

// The star that fills the hole is in the patch.
void Replay::PutStar(const Patch::Hole& hole, bool open) {
  slot_triangle.insert(slot_triangle.end(), star_.begin(),
                       star_.begin() + hole.ring_count - (open ? 1 : 0));
  if (any_fans) patch.NoteCreases(hole, open);
}

// Adds the vertices of their rings to ring_.
void Replay::InsertOtherFans(uint32_t anchor, uint32_t i, const Patch::Hole& first_hole) {
  const ClusterUpdates::Node& node = updates_.nodes[i];
  const uint32_t a = first_hole.ring[first_hole.ring_count - 1];
  const uint32_t b = first_hole.ring[0];
  const std::span<const uint32_t> found = patch.FindCrease(a, b);
  const std::vector<uint32_t> faces(found.begin(), found.end());
  MTDB_CHECK(faces.size() + 1 == node.fans, "triangles at a crease that its node does not know");
  patch.AllowInNextRing(first_hole);
  uint32_t hole_slots[kHoleEntries];
  uint32_t ring_vertices[kHoleEntries];
  for (const uint32_t face : faces) {
    MTDB_CHECK(face >> 2 < anchor, "a hole behind its anchor");
    Patch::Hole hole{hole_slots, ring_vertices};
    WalkHole(face >> 2, anchor, i, hole);
    const uint32_t split = MatchStar(i, hole);
    MTDB_CHECK(split == hole.EdgeBetween(a, b), "a fan beyond the edge that is split");
    std::rotate(star_.begin(), star_.begin() + split + 1, star_.begin() + hole.ring_count);
    hole.Rotate(split);
    patch.OpenStar(hole);
    PutStar(hole, true);
    patch.AllowInNextRing(hole);
    for (const uint32_t v : hole.ring_span()) {
      if (std::find(ring_.begin(), ring_.end(), v) == ring_.end()) ring_.push_back(v);
    }
  }
}

// Sets star_[j] to the star triangle beyond ring edge j. Returns the edge that has none, the one
// that a boundary node splits; kNone32 when the node is interior.
uint32_t Replay::MatchStar(uint32_t i, const Patch::Hole& hole) {
  const ClusterUpdates::Node& node = updates_.nodes[i];
  const std::span<const uint32_t> ring = hole.ring_span();
  std::fill_n(star_.begin(), ring.size(), kNone32);
  uint32_t matched = 0;
  for (const uint32_t t : updates_.star(i)) {
    const auto& corners = updates_.triangles[t];
    const auto apex = std::find(corners.begin(), corners.end(), node.vertex) - corners.begin();
    MTDB_CHECK(apex < 3, "a star triangle without the node's vertex");
    const uint32_t from = stored_vertex_[corners[static_cast<size_t>(apex + 1) % 3]];
    const uint32_t to = stored_vertex_[corners[static_cast<size_t>(apex + 2) % 3]];
    const auto j = static_cast<size_t>(std::find(ring.begin(), ring.end(), from) - ring.begin());
    const bool fits =
        j < ring.size() && ring[j + 1 == ring.size() ? 0 : j + 1] == to && star_[j] == kNone32;
    MTDB_CHECK(fits || node.fans > 1, "the star does not fit its hole");
    if (!fits) continue;  // it is of another hole
    star_[j] = t;
    ++matched;
  }
  MTDB_CHECK(matched + node.boundary() == ring.size(),
             "a node's star leaves no ring edge out, or the one that its vertex splits");
  if (!node.boundary()) return kNone32;
  return static_cast<uint32_t>(std::find(star_.begin(), star_.end(), kNone32) - star_.begin());
}

void Replay::EncodeRow(uint32_t vertex, std::span<const uint32_t> ring) {
  ring_positions_.clear();
  for (const uint32_t v : ring) ring_positions_.push_back(positions_[v]);
  attribute_coder_.Encode(attribute_stream, {updates_.positions[vertex], ring, ring_positions_},
                          rows_, updates_.rows.data() + vertex * attribute_coder_.row_bytes(),
                          observer_);
}

void Replay::NumberVertex(uint32_t vertex) {
  stored_vertex_[vertex] = stored_vertices_++;
  const size_t row = attribute_coder_.row_bytes();
  if (row == 0) return;
  const auto begin = updates_.rows.begin() + static_cast<std::ptrdiff_t>(vertex * row);
  rows_.insert(rows_.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
  positions_.push_back(updates_.positions[vertex]);
}

// Where the out-triangles go.
struct OutArcs {
  std::vector<uint32_t> ordinals;  // per slot, among the children; their count for the drain
  std::vector<ExplicitArc> explicit_arcs;
};

// Sets what `result` says of children and out-triangles.
OutArcs FindArcs(const ClusterUpdates& updates, const Owners& owners, const Replay& replay,
                 EncodedCluster& result) {
  std::vector<UnitId>& children = result.children;
  std::vector<uint32_t> out;  // slots
  for (uint32_t slot = 0; slot < replay.patch.slots(); ++slot) {
    if (replay.patch.remover(slot) == kNone32) out.push_back(slot);
  }
  result.out_triangles = static_cast<uint32_t>(out.size());
  const auto consumer_of = [&](uint32_t slot) -> const ClusterUpdates::Consumer& {
    return updates.consumers[replay.slot_triangle[slot]];
  };
  for (const uint32_t slot : out) {
    const UnitId child = consumer_of(slot).child;
    if (child != kNone32) children.push_back(child);
  }
  for (const ClusterUpdates::Crumb& crumb : updates.crumbs) {
    for (const uint32_t t : crumb.triangles) {
      if (updates.consumers[t].child != kNone32) children.push_back(updates.consumers[t].child);
    }
    result.out_triangles += static_cast<uint32_t>(crumb.triangles.size());
  }
  std::sort(children.begin(), children.end());
  children.erase(std::unique(children.begin(), children.end()), children.end());

  OutArcs arcs;
  arcs.ordinals.resize(replay.patch.slots(), static_cast<uint32_t>(children.size()));
  for (const uint32_t slot : out) {
    const ClusterUpdates::Consumer& consumer = consumer_of(slot);
    if (consumer.child == kNone32) continue;
    const auto at = std::lower_bound(children.begin(), children.end(), consumer.child);
    arcs.ordinals[slot] = static_cast<uint32_t>(at - children.begin());
    if (!consumer.explicit_arc) continue;
    // The builder's corner 0 is the child's first corner; find it among the triangle's.
    const uint32_t triangle = replay.slot_triangle[slot];
    if (owners.creators[triangle] == kNone32) {  // a trigger that comes in
      const uint8_t turn = result.in_rotations[slot];
      arcs.explicit_arcs.push_back(
          {slot, consumer.child_slot, static_cast<uint8_t>((3 - turn) % 3)});
      continue;
    }
    const auto& t = updates.triangles[triangle];
    const uint32_t vertex = updates.nodes[owners.creators[triangle]].vertex;
    const auto apex = std::find(t.begin(), t.end(), vertex) - t.begin();
    arcs.explicit_arcs.push_back({slot, consumer.child_slot, static_cast<uint8_t>((3 - apex) % 3)});
  }
  return arcs;
}

void EncodeVertices(const Replay& replay, bool scaled_by_error, ClusterModels& models,
                    RansEncoder& vertices, BitWriter& bits) {
  uint8_t last = 0;
  for (size_t i = 0; i < replay.codes.size(); ++i) {
    const VertexResidual& r = replay.residuals[i];
    const uint8_t code = replay.codes[i];
    if (replay.lattice) {
      models.errors.CodeOnLattice(vertices.lane(0), bits, r.least_code, last, code);
    } else {
      models.errors.Code(vertices.lane(0), bits, r.hole_size, r.least_code, last, code);
      models.positions.CodeScaled(vertices.lane(1), bits, 0, r.ring_class, r.variance_u, r.u);
      models.positions.CodeScaled(vertices.lane(2), bits, 1, r.ring_class, r.variance_v, r.v);
    }
    if (scaled_by_error) {
      const float limit = kErrorInCells[code] * r.slant;
      PositionModel::CodeWithin(vertices.lane(3), bits,
                                replay.lattice ? models.positions.HeightOf(code)
                                               : models.positions.WithinOf(r.ring_class, limit),
                                limit, r.n);
    } else {
      models.positions.CodeScaled(vertices.lane(3), bits, 2, r.ring_class, r.variance_n, r.n);
    }
    last = code;
  }
}

uint8_t FlagsOf(const Replay& replay, bool is_height_field, bool scaled_by_error) {
  return static_cast<uint8_t>(
      (replay.any_boundary ? kFlagBoundary : 0) | (scaled_by_error ? kFlagScaledByError : 0) |
      (is_height_field ? kFlagFlat : 0) | (replay.lattice ? kFlagLattice : 0) |
      (replay.any_fans ? kFlagFans : 0));
}

// The payload, which is so long at least.
Bytes Padded(StreamWriter& streams, uint64_t least) {
  Bytes payload = streams.Finish();
  if (payload.size() >= least) return payload;
  streams.AddCoded(StreamTag::kPadding, Bytes(least - payload.size()));
  return streams.Finish();
}

void PutChildren(std::span<const UnitId> children, ByteWriter& head) {
  head.PutVarint(children.size());
  for (UnitId previous = 0; const UnitId child : children) {
    head.PutVarint(child - previous);
    previous = child;
  }
}

// What a reader has of the other streams decides how corners are coded.
void AddCorners(const ClusterUpdates& updates, const AttributeLayout& attributes, InPatch in,
                const Replay& replay, uint32_t nodes, StreamWriter& streams) {
  in.rows.clear();
  for (VertexIndex& v : in.vertices) {
    const auto begin = updates.rows.begin() + static_cast<ptrdiff_t>(v * attributes.row_bytes());
    in.rows.insert(in.rows.end(), begin, begin + static_cast<ptrdiff_t>(attributes.row_bytes()));
  }
  Result<Cluster> cluster =
      DecodeWithoutCorners(Padded(streams, LeastPayloadBytes(nodes, attributes.row_bytes())),
                           std::move(in), attributes, nodes);
  MTDB_CHECK(cluster.ok(), cluster.status().message().c_str());
  EncodeCorners(
      updates, *std::move(cluster), replay.slot_triangle,
      [&](uint32_t v) { return replay.stored_vertex(v); }, streams);
}

}  // namespace

EncodedCluster EncodeCluster(const ClusterUpdates& updates, const AttributeLayout& attributes) {
  ClusterModels models;
  return EncodeCluster(updates, attributes, models, nullptr);
}

EncodedCluster internal::EncodeCluster(const ClusterUpdates& updates,
                                       const AttributeLayout& attributes, ClusterModels& models,
                                       ModelObserver* observer) {
  const size_t node_count = updates.nodes.size();
  MTDB_CHECK(node_count + updates.crumbs.size() > 0, "a cluster needs nodes");
  EncodedCluster result;
  const Owners owners = FindOwners(updates);
  const InPatch in = OrderInTriangles(updates, owners, result);
  const std::vector<uint32_t> hidden_seams =
      in.corners.empty() ? std::vector<uint32_t>{}
                         : FindHiddenSeams(updates, result.in_triangles, result.in_rotations, in);
  const int reference_length = ReferenceLength(updates, owners);
  const ClusterModels fresh = models;
  std::optional<Replay> attempt;
  for (const bool try_lattice : {updates.is_height_field, false}) {
    models = fresh;
    attempt.emplace(updates, owners, attributes, in, hidden_seams, reference_length, models,
                    observer, try_lattice);
    if (attempt->Run(result.in_triangles)) break;
  }
  Replay& replay = *attempt;
  const OutArcs arcs = FindArcs(updates, owners, replay, result);
  result.node_order = std::move(replay.node_order);
  const auto child_count = static_cast<uint32_t>(result.children.size());
  const bool scaled_by_error = ErrorsBoundHeights(replay.residuals, replay.codes);

  RansEncoder arc_stream(observer);
  if (child_count > 0) {
    models.arcs.Code(
        arc_stream, replay.patch, child_count, [&](uint32_t slot) { return arcs.ordinals[slot]; },
        [](uint32_t, uint32_t) { return true; });
  }
  RansEncoder vertices(observer);
  BitWriter bits;
  EncodeVertices(replay, scaled_by_error, models, vertices, bits);

  StreamWriter streams;
  EncodeExplicitArcs(arcs.explicit_arcs, streams);
  result.nodes = EncodeCrumbs(updates,
                              CrumbPlaces{replay.patch, replay.slot_triangle, result.children,
                                          [&](uint32_t v) { return replay.stored_vertex(v); }},
                              attributes.row_bytes(), streams);
  result.nodes += static_cast<uint32_t>(node_count);
  ByteWriter& head = streams.stream(StreamTag::kHead);
  head.Put<uint8_t>(FlagsOf(replay, updates.is_height_field, scaled_by_error));
  head.Put<uint8_t>(static_cast<uint8_t>(reference_length));
  head.PutVarint(node_count);
  PutChildren(result.children, head);
  streams.AddCoded(StreamTag::kTopology, replay.topology.Finish(2));
  streams.AddCoded(StreamTag::kVertices, vertices.Finish(4));
  streams.AddCoded(StreamTag::kBits, bits.Finish());
  streams.AddCoded(StreamTag::kArcs, arc_stream.Finish());
  streams.AddCoded(StreamTag::kAttributes, replay.attribute_stream.Finish());
  if (!in.corners.empty()) {
    EncodeSeams(hidden_seams, streams);
    AddCorners(updates, attributes, in, replay, result.nodes, streams);
  }
  result.payload = Padded(streams, LeastPayloadBytes(result.nodes, attributes.row_bytes()));
  return result;
}

namespace {

// Of nodes[first], which bring a crumb: appends it, and the triangles that its slots have.
void AddCrumb(const Cluster& cluster, NodeIndex first, NodeIndex end,
              std::vector<uint32_t>& triangle_of, ClusterUpdates& updates) {
  ClusterUpdates::Crumb& crumb = updates.crumbs.emplace_back();
  crumb.error_code = cluster.error_codes[first];
  const NodeShape shape = cluster.shape(first);
  for (const uint32_t slot : shape.removed) crumb.triggers.push_back(triangle_of[slot]);
  if (cluster.fans[first] == kCrumb) {
    for (NodeIndex i = first; i < end; ++i) crumb.vertices.push_back(cluster.first_vertex(i));
  }
  for (const uint32_t slot : shape.created) {
    const size_t place = slot - shape.created.first;
    if (place < crumb.triggers.size()) {
      triangle_of[slot] = crumb.triggers[place];
      continue;
    }
    triangle_of[slot] = static_cast<uint32_t>(updates.triangles.size());
    crumb.triangles.push_back(triangle_of[slot]);
    updates.triangles.push_back(cluster.created_triangle(first, slot));
    if (!cluster.in.two_sided.empty()) updates.two_sided.push_back(cluster.in.two_sided[slot]);
  }
}

}  // namespace

ClusterUpdates UpdatesOf(const Cluster& cluster, bool is_height_field) {
  ClusterUpdates updates;
  updates.is_height_field = is_height_field;
  updates.positions = cluster.in.positions;
  updates.rows = cluster.in.rows;
  updates.triangles = cluster.in.triangles;
  std::vector<uint32_t> triangle_of(cluster.slots());
  std::iota(triangle_of.begin(), triangle_of.end(), 0u);
  NodeIndex i = 0;
  for (; i < cluster.nodes() && !cluster.crumb(i); ++i) {
    const NodeShape shape = cluster.shape(i);
    MTDB_CHECK(shape.vertices.size() == 1, "a node that is no insertion of a vertex");
    ClusterUpdates::Node& node = updates.nodes.emplace_back();
    node.vertex = shape.vertices.front();
    node.error_code = cluster.error_codes[i];
    node.hole_begin = static_cast<uint32_t>(updates.holes.size());
    node.hole_count = static_cast<uint32_t>(shape.removed.size());
    updates.holes.insert(updates.holes.end(), shape.removed.begin(), shape.removed.end());
    node.star_begin = static_cast<uint32_t>(updates.stars.size());
    node.star_count = static_cast<uint32_t>(shape.created.size());
    if (!cluster.fans.empty() && cluster.fans[i] > 1) node.fans = cluster.fans[i];
    for (const uint32_t slot : shape.created) {
      updates.stars.push_back(slot);
      updates.triangles.push_back(cluster.created_triangle(i, slot));
    }
  }
  if (!cluster.in.two_sided.empty()) {
    const auto begin = cluster.in.two_sided.begin();
    updates.two_sided.assign(begin, begin + std::ssize(updates.triangles));
  }
  while (i < cluster.nodes()) {
    const NodeIndex first = i;
    for (++i; i < cluster.nodes() && cluster.hole(i).empty();) ++i;
    AddCrumb(cluster, first, i, triangle_of, updates);
  }
  if (!cluster.in.corner_places.empty()) {
    updates.corner_step = cluster.in.corner_step;
    updates.corners.resize(updates.triangles.size());
    for (uint32_t s = 0; s < cluster.slots(); ++s) {
      updates.corners[triangle_of[s]] = cluster.texture(s);
    }
    updates.seams = cluster.in.seams;
    updates.seams.resize(updates.triangles.size());
  }
  updates.consumers.resize(updates.triangles.size());
  for (uint32_t s = 0; s < cluster.slots(); ++s) {
    if (!RemovedByChild(cluster.removers[s])) continue;
    updates.consumers[triangle_of[s]].child = cluster.children[ChildOrdinal(cluster.removers[s])];
  }
  for (const ExplicitArc& arc : cluster.explicit_arcs) {
    updates.consumers[triangle_of[arc.slot]].explicit_arc = true;
    updates.consumers[triangle_of[arc.slot]].child_slot = arc.child_slot;
  }
  return updates;
}

}  // namespace mtdb
