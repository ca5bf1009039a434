// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/encode/clip_encoder.h"

#include <algorithm>
#include <utility>

#include "store/base/check.h"

namespace mtdb::internal {
namespace {

// So many triangles are attached in a record.
constexpr uint64_t kRecordTriangles = 16384;

// The client's answers to what clip_coder.h asks, out of the whole cut.
class AttachedSide {
 public:
  // `slots`: the triangles of the whole cut that are to be attached.
  AttachedSide(SentStream& stream, std::span<const uint32_t> slots)
      : s_(stream), whole_(*stream.whole), slots_(slots), pending_(whole_.mesh().triangle_slots()) {
    for (const uint32_t slot : slots) pending_[slot] = true;
    for (const uint32_t slot : slots) {
      for (const uint32_t o : whole_.mesh().triangle(slot).opposite) {
        if (o == kNone32 || whole_.client_slot(o >> 2) == kNone32) continue;
        if (const uint32_t h = ClientHalfEdge(o); h != kNone32) seeds_.emplace_back(h, slot);
      }
    }
    std::sort(seeds_.begin(), seeds_.end());
  }

  uint32_t NextSeed() {
    for (; seed_ < seeds_.size(); ++seed_) {
      const auto [h, slot] = seeds_[seed_];
      if (!pending_[slot] || s_.mesh.triangle(h >> 2).opposite[h & 3] != kNone32) continue;
      return h;
    }
    target_ = slots_[alone_];
    first_corner_ = 0;
    return kNone32;
  }
  bool done() {
    while (alone_ < slots_.size() && !pending_[slots_[alone_]]) ++alone_;
    return alone_ == slots_.size();
  }
  bool Across(uint32_t h) {
    const uint32_t o = WholeOpposite(h);
    if (o == kNone32 || !pending_[o >> 2]) return false;
    target_ = o >> 2;
    first_corner_ = o & 3;
    return true;
  }
  uint32_t Corner(uint32_t i) {
    corner_ = whole_.mesh().triangle(target_).corners[(first_corner_ + i) % 3];
    return s_.vertices.Find(whole_.vertex_key(corner_));
  }
  Vec3i position() const { return whole_.mesh().position(corner_); }
  void CodeRow(const AttributeCoder::Star& star) {
    if (s_.row_bytes == 0) return;
    s_.models.attribute_coder.Encode(s_.coder, star, s_.mesh.rows(), row());
  }
  void CodeRow() {
    for (size_t i = 0; i < s_.row_bytes; ++i) s_.coder.Raw(8, static_cast<uint32_t>(row()[i]));
  }
  uint32_t PutVertex(Vec3i p) { return s_.AddVertex(whole_.vertex_key(corner_), p, row()); }
  void Recalled() { ++s_.recalled; }
  bool MayPutTriangle() {
    s_.cost.AddAttached();
    return true;
  }
  void PutTriangle(uint32_t slot) {
    pending_[target_] = false;
    s_.PutTriangle(whole_.key(target_), slot);
  }

 private:
  const std::byte* row() const { return whole_.mesh().row(corner_).data(); }
  // The half-edge of the client's triangle that is the whole cut's half-edge.
  uint32_t ClientHalfEdge(uint32_t half_edge) const {
    const VertexIndex from =
        whole_.vertex_key(whole_.mesh().triangle(half_edge >> 2).corners[half_edge & 3]);
    const uint32_t slot = whole_.client_slot(half_edge >> 2);
    const auto& corners = s_.mesh.triangle(slot).corners;
    for (uint32_t i = 0; i < 3; ++i) {
      if (s_.vertices.key(corners[i]) == from) return 4 * slot + i;
    }
    return kNone32;
  }
  // What lies beyond the client's half-edge in the whole cut.
  uint32_t WholeOpposite(uint32_t half_edge) const {
    const VertexIndex from =
        s_.vertices.key(s_.mesh.triangle(half_edge >> 2).corners[half_edge & 3]);
    const ReplayedMesh::Triangle& t = whole_.mesh().triangle(whole_.held(half_edge >> 2).whole);
    for (size_t i = 0; i < 3; ++i) {
      if (whole_.vertex_key(t.corners[i]) == from) return t.opposite[i];
    }
    return kNone32;
  }

  SentStream& s_;
  const WholeCut& whole_;
  const std::span<const uint32_t> slots_;
  std::vector<bool> pending_;
  std::vector<std::pair<uint32_t, uint32_t>> seeds_;  // half-edges of the client; what lies beyond
  size_t seed_ = 0;
  size_t alone_ = 0;
  uint32_t target_ = 0, first_corner_ = 0, corner_ = 0;  // of the whole cut
};

}  // namespace

void ClipEncoder::Begin() {
  BaseMesh base;
  std::vector<uint32_t> number(s_.mesh.vertex_slots(), kNone32);
  for (uint32_t v = 0; v < s_.mesh.vertex_slots(); ++v) {
    if (!s_.mesh.has_vertex(v)) continue;
    number[v] = static_cast<uint32_t>(base.vertices.size());
    base.vertices.push_back(s_.vertices.key(v));
    base.positions.push_back(s_.mesh.position(v));
    base.rows.insert(base.rows.end(), s_.mesh.row(v).begin(), s_.mesh.row(v).end());
  }
  const std::vector<uint32_t> slots = s_.triangles.Slots();
  for (const uint32_t slot : slots) {
    const auto& c = s_.mesh.triangle(slot).corners;
    base.triangles.push_back({number[c[0]], number[c[1]], number[c[2]]});
    base.triangle_keys.push_back(s_.triangles.key(slot));
  }
  s_.whole.emplace(s_.options, base);
  for (const uint32_t slot : slots) s_.whole->Link(s_.triangles.key(slot), slot);
}

// The triangles of the whole cut that the client is to have and has not, neighbours by neighbours.
std::vector<uint32_t> ClipEncoder::Coming() const {
  const ReplayedMesh& mesh = s_.whole->mesh();
  std::vector<uint32_t> coming;
  std::vector<bool> seen(mesh.triangle_slots());
  const auto visit = [&](uint32_t slot) {
    if (seen[slot] || !s_.whole->chosen(slot) || s_.whole->client_slot(slot) != kNone32) return;
    seen[slot] = true;
    coming.push_back(slot);
  };
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    const size_t first = coming.size();
    visit(slot);
    for (size_t i = first; i < coming.size(); ++i) {
      for (const uint32_t o : mesh.triangle(coming[i]).opposite) {
        if (o != kNone32) visit(o >> 2);
      }
    }
  }
  return coming;
}

void ClipEncoder::EncodeDrops(const std::vector<uint32_t>& leaving,
                              std::vector<uint32_t>* left_over) {
  std::vector<bool> leaves(s_.mesh.triangle_slots());
  for (const uint32_t slot : leaving) leaves[slot] = true;
  DropWalk walk(s_.mesh, scratch_);
  size_t next = 0;
  walk.Code(
      s_.coder, s_.models.clips, [&](uint32_t slot) { return leaves[slot]; },
      [&](uint32_t) {
        while (next < leaving.size() && walk.decided(leaving[next])) ++next;
        return next == leaving.size() ? kNone32 : leaving[next];
      });
  for (const uint32_t slot : walk.dropped()) s_.EraseTriangle(slot);
  s_.mesh.Drop(walk.dropped(), left_over);
}

void ClipEncoder::Encode(ByteWriter& out) {
  std::vector<uint32_t> leaving;
  for (uint32_t slot = 0; slot < s_.mesh.triangle_slots(); ++slot) {
    if (!s_.mesh.has_triangle(slot)) continue;
    const uint32_t whole = s_.whole->held(slot).whole;
    if (whole == kNone32 || !s_.whole->chosen(whole)) leaving.push_back(slot);
  }
  std::vector<uint32_t> coming = Coming();
  if (leaving.empty() && coming.empty()) {
    if (s_.record_updates == 0) return;
    s_.coder.Bit(s_.models.more, false);
    s_.PutRecord(out);
    return;
  }
  // A triangle brings up to three vertices.
  const uint64_t most = std::clamp<uint64_t>(s_.max_updates / 4, 1, kRecordTriangles);
  for (size_t begin = 0; begin == 0 || begin < coming.size(); begin += most) {
    const size_t end = std::min<size_t>(begin + most, coming.size());
    s_.MakeRoom(3 * most, out);
    const auto slots = std::span<const uint32_t>(coming).subspan(begin, end - begin);
    s_.coder.Bit(s_.models.more, true);
    s_.coder.Bit(s_.models.other, true);
    s_.coder.Bit(s_.models.clip, true);
    std::vector<uint32_t> left_over;
    EncodeDrops(leaving, &left_over);
    leaving.clear();
    AttachedSide side(s_, slots);
    const bool good = Attacher(s_.coder, s_.models, s_.mesh, side, &left_over).Code();
    MTDB_CHECK(good, "a triangle of the cut has equal corners");
    ForgetLeftOver(s_.mesh, left_over, [&](uint32_t vertex) { s_.vertices.Erase(vertex); });
    s_.PutRecord(out);
  }
}

}  // namespace mtdb::internal
