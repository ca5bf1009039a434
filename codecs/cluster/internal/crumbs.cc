// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/crumbs.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "codecs/cluster/cluster_limits.h"
#include "store/base/check.h"

namespace mtdb::internal {
namespace {

// What follows a triangle's corners: whether it is two-sided, whether its arc is an explicit one,
// and its child.
constexpr uint64_t kTwoSidedBit = 1;
constexpr uint64_t kExplicitBit = 2;
constexpr int kChildShift = 2;

using Corners = std::array<uint32_t, 3>;

// The vertices of triangles, each once, in the order in which they occur.
void AddVertices(const Corners& corners, std::vector<uint32_t>& vertices) {
  for (const uint32_t v : corners) {
    if (std::find(vertices.begin(), vertices.end(), v) == vertices.end()) vertices.push_back(v);
  }
}

class CrumbEncoder {
 public:
  CrumbEncoder(const ClusterUpdates& updates, const CrumbPlaces& places, ByteWriter& out)
      : updates_(updates), places_(places), out_(out), next_slot_(places.patch.slots()) {
    slots_.resize(updates.triangles.size(), kNone32);
    for (uint32_t s = 0; s < places.slot_triangle.size(); ++s) {
      slots_[places.slot_triangle[s]] = s;
    }
  }

  void Add(const ClusterUpdates::Crumb& crumb) {
    std::vector<uint32_t> around;  // stored
    std::vector<Corners> copies;
    out_.PutVarint(crumb.triggers.size());
    for (const uint32_t t : crumb.triggers) {
      const uint32_t slot = slots_[t];
      MTDB_CHECK(slot != kNone32, "a trigger that no node creates or removes");
      out_.PutVarint(slot);
      const Corners corners = CornersOf(slot);
      AddVertices(corners, around);
      copies.push_back(corners);
      slots_[t] = next_slot_++;
    }
    copies_.insert(copies_.end(), copies.begin(), copies.end());
    out_.Put<uint8_t>(crumb.error_code);
    out_.PutVarint(crumb.vertices.size());
    Vec3i last = updates_.positions[FirstCorner(crumb)];
    for (const uint32_t v : crumb.vertices) {
      const Vec3i p = updates_.positions[v];
      for (int i = 0; i < 3; ++i) out_.PutSignedVarint(int64_t{p[i]} - last[i]);
      last = p;
    }
    out_.PutVarint(crumb.triangles.size());
    for (const uint32_t t : crumb.triangles) {
      for (const uint32_t v : updates_.triangles[t]) {
        out_.PutVarint(NumberOf(v, crumb, around));
      }
      PutArc(t);
      // Nobody of the cluster removes it: it only takes a slot.
      copies_.push_back({});
      ++next_slot_;
    }
  }

 private:
  Corners CornersOf(uint32_t slot) const {
    const uint32_t plain = places_.patch.slots();
    return slot < plain ? places_.patch.triangle(slot).corners : copies_[slot - plain];
  }
  // The corner, of the updates, that the reader has as the first one of the first trigger.
  uint32_t FirstCorner(const ClusterUpdates::Crumb& crumb) const {
    const uint32_t trigger = crumb.triggers[0];
    const uint32_t wanted = CornersOf(slots_[trigger])[0];
    for (const uint32_t v : updates_.triangles[trigger]) {
      if (places_.stored_vertex(v) == wanted) return v;
    }
    MTDB_CHECK(false, "a trigger whose vertices the patch does not know");
    return 0;
  }
  // The crumb's own vertices come first, then those around.
  uint32_t NumberOf(uint32_t vertex, const ClusterUpdates::Crumb& crumb,
                    const std::vector<uint32_t>& around) const {
    const auto own = std::find(crumb.vertices.begin(), crumb.vertices.end(), vertex);
    if (own != crumb.vertices.end()) return static_cast<uint32_t>(own - crumb.vertices.begin());
    const auto at = std::find(around.begin(), around.end(), places_.stored_vertex(vertex));
    MTDB_CHECK(at != around.end(), "a crumb that hangs on more than its triggers");
    return static_cast<uint32_t>(crumb.vertices.size() + static_cast<size_t>(at - around.begin()));
  }
  void PutArc(uint32_t t) {
    const ClusterUpdates::Consumer& consumer = updates_.consumers[t];
    const std::span<const UnitId> children = places_.children;
    uint64_t ordinal = children.size();
    if (consumer.child != kNone32) {
      ordinal = static_cast<uint64_t>(
          std::lower_bound(children.begin(), children.end(), consumer.child) - children.begin());
    }
    const bool two_sided = !updates_.two_sided.empty() && updates_.two_sided[t] != 0;
    const bool is_explicit = consumer.child != kNone32 && consumer.explicit_arc;
    out_.PutVarint(ordinal << kChildShift | (is_explicit ? kExplicitBit : 0) |
                   (two_sided ? kTwoSidedBit : 0));
    // The updates' first corner is the child's.
    if (is_explicit) out_.PutVarint(consumer.child_slot);
  }

  const ClusterUpdates& updates_;
  const CrumbPlaces& places_;
  ByteWriter& out_;
  std::vector<uint32_t> slots_;  // of triangles, the newest
  std::vector<Corners> copies_;  // of the slots behind the patch's, where they are triggers'
  uint32_t next_slot_;
};

class CrumbDecoder {
 public:
  CrumbDecoder(ByteReader in, size_t row_bytes, const std::string& where, Cluster& cluster)
      : in_(in), row_(row_bytes), where_(where), c_(cluster) {}

  Status Run(uint32_t node_limit) {
    Begin();
    const uint64_t count = in_.GetVarint();
    if (count == 0 || count > in_.remaining()) return Corrupted("cut short");
    for (uint64_t i = 0; i < count; ++i) {
      MTDB_RETURN_IF_ERROR(Add());
      if (c_.nodes() > node_limit) return Corrupted("more vertices than the index says");
    }
    if (!DecodeRows()) return Corrupted("rows cut short");
    if (in_.failed() || in_.remaining() != 0) return Corrupted("wrong length");
    std::ranges::sort(c_.explicit_arcs, {}, &ExplicitArc::slot);
    return Status::Ok();
  }

 private:
  Status Corrupted(const std::string& what) const { return Corrupt(where_ + ": crumbs: " + what); }

  // What all other nodes say by arithmetic is said in full.
  void Begin() {
    if (c_.created_corners.empty()) {
      for (NodeIndex i = 0; i < c_.nodes(); ++i) {
        for (uint32_t s = c_.star_begin[i]; s < c_.star_begin[i + 1]; ++s) {
          corners_.push_back(c_.created_triangle(i, s));
        }
      }
      c_.created_corners = std::move(corners_);
    }
    if (c_.fans.empty()) {
      std::vector<uint8_t> fans;
      for (NodeIndex i = 0; i < c_.nodes(); ++i) fans.push_back(c_.boundary(i) ? 1 : 0);
      c_.fans = std::move(fans);
    }
    arc_of_.assign(c_.explicit_arcs.empty() ? 0 : c_.slots(), kNone32);
    for (uint32_t i = 0; i < c_.explicit_arcs.size(); ++i) arc_of_[c_.explicit_arcs[i].slot] = i;
  }

  Status Add() {
    if (!GetTriggers()) return Corrupted("a trigger that is not there");
    const auto code = in_.Get<uint8_t>();
    const uint64_t own = in_.GetVarint();
    if (in_.failed() || own > 3 * kMostCrumbTriangles) return Corrupted("too many vertices");
    // A crumb without vertices of its own has a number all the same.
    const auto numbers = static_cast<uint32_t>(std::max<uint64_t>(own, 1));
    first_vertex_ = c_.external_vertices() + c_.nodes();
    own_ = static_cast<uint32_t>(own);
    used_.assign(own_, 0);
    const uint32_t first_corner = CornersOf(triggers_[0])[0];
    Vec3i p = c_.in.positions[first_corner];
    if (own == 0) alike_.push_back(first_corner);
    for (uint64_t v = 0; v < own; ++v) {
      for (int i = 0; i < 3; ++i) {
        const auto step = static_cast<uint64_t>(in_.GetSignedVarint());
        p[i] = static_cast<int32_t>(static_cast<uint32_t>(p[i]) + static_cast<uint32_t>(step));
      }
      c_.in.positions.push_back(p);
      alike_.push_back(kNone32);
    }
    if (own == 0) c_.in.positions.push_back(p);
    for (const uint32_t slot : triggers_) PutBack(slot);
    MTDB_RETURN_IF_ERROR(GetTriangles());
    if (std::ranges::find(used_, 0) != used_.end()) return Corrupted("a vertex without triangles");
    EndNode(code, numbers);
    return Status::Ok();
  }

  bool GetTriggers() {
    triggers_.clear();
    around_.clear();
    const uint64_t count = in_.GetVarint();
    if (count == 0 || count > kMostCrumbTriggers) return false;
    for (uint64_t i = 0; i < count; ++i) {
      const uint64_t slot = in_.GetVarint();
      if (in_.failed() || slot >= c_.slots() || RemovedByNode(c_.removers[slot])) return false;
      triggers_.push_back(static_cast<uint32_t>(slot));
      AddVertices(CornersOf(triggers_.back()), around_);
      if (std::ranges::count(triggers_, triggers_.back()) > 1) return false;
    }
    return true;
  }

  // Whoever removed the trigger removes what takes its place.
  void PutBack(uint32_t slot) {
    const uint32_t copy = c_.slots();
    const uint32_t arc = slot < arc_of_.size() ? arc_of_[slot] : kNone32;
    if (arc != kNone32) SetArc(arc, copy);
    AddSlot(CornersOf(slot), c_.removers[slot], IsTwoSided(slot));
    c_.removers[slot] = c_.nodes();
    c_.hole_slots.push_back(slot);
  }

  Status GetTriangles() {
    const uint64_t count = in_.GetVarint();
    if (count == 0 || count > kMostCrumbTriangles) return Corrupted("too many triangles");
    for (uint64_t i = 0; i < count; ++i) {
      Corners corners{};
      for (uint32_t& corner : corners) {
        const uint64_t number = in_.GetVarint();
        if (number >= own_ + around_.size()) return Corrupted("a corner that is not there");
        if (number < own_) used_[number] = 1;
        corner =
            number < own_ ? first_vertex_ + static_cast<uint32_t>(number) : around_[number - own_];
      }
      if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) {
        return Corrupted("a triangle of two vertices");
      }
      const uint64_t arc = in_.GetVarint();
      const uint64_t ordinal = arc >> kChildShift;
      if (in_.failed() || ordinal > c_.children.size()) return Corrupted("a child not listed");
      const bool drain = ordinal == c_.children.size();
      if ((arc & kExplicitBit) != 0) {
        const uint64_t child_slot = in_.GetVarint();
        if (drain || child_slot >= kNone32) return Corrupted("explicit arc out of range");
        c_.explicit_arcs.push_back({0, static_cast<uint32_t>(child_slot), 0});
        SetArc(static_cast<uint32_t>(c_.explicit_arcs.size() - 1), c_.slots());
      }
      AddSlot(corners, drain ? kDrain : kChildFlag | static_cast<uint32_t>(ordinal),
              (arc & kTwoSidedBit) != 0);
    }
    return Status::Ok();
  }

  void EndNode(uint8_t code, uint32_t numbers) {
    c_.ring_vertices.insert(c_.ring_vertices.end(), around_.begin(), around_.end());
    for (uint32_t i = 0; i < numbers; ++i) {
      c_.error_codes.push_back(code);
      c_.ring_begin.push_back(static_cast<uint32_t>(c_.ring_vertices.size()));
      c_.hole_begin.push_back(static_cast<uint32_t>(c_.hole_slots.size()));
      c_.star_begin.push_back(c_.slots());
      c_.fans.push_back(own_ == 0 ? kCrumbWithoutVertex : kCrumb);
    }
  }

  bool DecodeRows() {
    for (const uint32_t like : alike_) {
      const ByteSpan row =
          like == kNone32 ? in_.GetBytes(row_) : ByteSpan(c_.in.rows).subspan(like * row_, row_);
      if (in_.failed()) return false;
      const Bytes copy(row.begin(), row.end());
      c_.in.rows.insert(c_.in.rows.end(), copy.begin(), copy.end());
    }
    return true;
  }

  void SetArc(uint32_t arc, uint32_t slot) {
    c_.explicit_arcs[arc].slot = slot;
    arc_of_.resize(std::max<size_t>(arc_of_.size(), size_t{slot} + 1), kNone32);
    arc_of_[slot] = arc;
  }
  Corners CornersOf(uint32_t slot) const {
    return slot < c_.listed() ? c_.in.triangles[slot] : c_.created_corners[slot - c_.listed()];
  }
  bool IsTwoSided(uint32_t slot) const {
    return !c_.in.two_sided.empty() && c_.in.two_sided[slot] != 0;
  }
  void AddSlot(const Corners& corners, uint32_t remover, bool two_sided) {
    c_.created_corners.push_back(corners);
    c_.removers.push_back(remover);
    if (two_sided || !c_.in.two_sided.empty()) {
      c_.in.two_sided.resize(c_.slots());
      c_.in.two_sided.back() = two_sided;
    }
  }

  ByteReader in_;
  const size_t row_;
  const std::string& where_;
  Cluster& c_;
  std::vector<Corners> corners_;
  std::vector<uint32_t> arc_of_;  // of slots: their explicit arcs
  std::vector<uint32_t> alike_;   // of the crumbs' vertices: kNone32, or whose row it has
  // Of the crumb at hand.
  std::vector<uint32_t> triggers_;  // slots
  std::vector<uint32_t> around_;    // local vertices: of the triggers
  uint32_t first_vertex_ = 0, own_ = 0;
  std::vector<uint8_t> used_;  // of its own vertices
};

}  // namespace

uint32_t EncodeCrumbs(const ClusterUpdates& updates, const CrumbPlaces& places, size_t row_bytes,
                      StreamWriter& streams) {
  if (updates.crumbs.empty()) return 0;
  ByteWriter& out = streams.stream(StreamTag::kCrumbs);
  out.PutVarint(updates.crumbs.size());
  CrumbEncoder encoder(updates, places, out);
  uint32_t nodes = 0;
  for (const ClusterUpdates::Crumb& crumb : updates.crumbs) {
    encoder.Add(crumb);
    nodes += static_cast<uint32_t>(std::max<size_t>(crumb.vertices.size(), 1));
  }
  for (const ClusterUpdates::Crumb& crumb : updates.crumbs) {
    for (const uint32_t v : crumb.vertices) {
      out.PutBytes(ByteSpan(updates.rows).subspan(v * row_bytes, row_bytes));
    }
  }
  return nodes;
}

Status DecodeCrumbs(const StreamReader& streams, size_t row_bytes, uint32_t node_limit,
                    const std::string& where, Cluster* cluster) {
  if (streams.bytes(StreamTag::kCrumbs).empty()) return Status::Ok();
  return CrumbDecoder(streams.stream(StreamTag::kCrumbs), row_bytes, where, *cluster)
      .Run(node_limit);
}

}  // namespace mtdb::internal
