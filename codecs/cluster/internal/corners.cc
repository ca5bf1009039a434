// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/corners.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>

#include "codecs/coding/attribute_coder.h"
#include "codecs/coding/rans.h"
#include "store/base/check.h"
#include "store/base/coordinate_limit.h"

namespace mtdb::internal {
namespace {

// What is coded of a corner: u and v. Its page is that of its hole.
AttributeLayout PlaceLayout(double step) {
  AttributeLayout layout = CornerLayout(step);
  layout.attributes.pop_back();
  return layout;
}

// Walks through the nodes of a cluster, and finds which corner each of their triangles has. A node
// has one new corner in each of its fans, which `code` gives; around it, the corners are those that
// the triangles of the fan's hole have.
class CornerReplay {
 public:
  explicit CornerReplay(Cluster& cluster) : c_(cluster) {
    c_.in.corner_places.reserve(c_.slots());
    for (uint32_t s = 0; s < c_.listed(); ++s) {
      c_.in.corner_places.push_back({3 * s, 3 * s + 1, 3 * s + 2});
    }
  }

  // `code(slot, star)`: of the first triangle of a fan. False when holes and stars do not fit, or
  // there are crumbs.
  template <typename Code>
  bool Run(Code&& code) {
    size_t later = 0;
    for (NodeIndex node = 0; node < c_.nodes(); ++node) {
      if (c_.crumb(node)) return false;
      const uint32_t end = c_.star_begin[node + 1];
      const std::span<const uint32_t> slots = c_.hole(node);
      size_t hole = 0;
      for (uint32_t begin = c_.star_begin[node]; begin < end;) {
        const bool more = later < c_.later_fans.size() && c_.later_fans[later] < end;
        const uint32_t fan_end = more ? c_.later_fans[later++] : end;
        const size_t count = more || hole > 0 ? fan_end - begin - 1 : slots.size();
        if (fan_end <= begin || hole + count > slots.size()) return false;
        if (!AddFan(node, {begin, fan_end}, slots.subspan(hole, count), code)) return false;
        hole += count;
        begin = fan_end;
      }
    }
    return true;
  }

  // The star's ring: two rows, around what is expected of the corner.
  const Bytes& rows() const { return rows_; }

 private:
  // Expects u and v from the corners around it, by mean value coordinates (Floater 2003): exactly,
  // where the image is an affine map of a flat ring.
  void Expect(Vec3i at) {
    const size_t n = ring_.size();
    weights_.assign(n, 0);
    lengths_.resize(n);
    for (size_t i = 0; i < n; ++i)
      lengths_[i] = Length(ToDouble(ring_positions_[i]) - ToDouble(at));
    for (size_t i = 0; i < n; ++i) {
      const size_t j = i + 1 == n ? 0 : i + 1;
      const Vec3d a = ToDouble(ring_positions_[i]) - ToDouble(at);
      const Vec3d b = ToDouble(ring_positions_[j]) - ToDouble(at);
      // The tangent of half of the angle between them; large where the vertex is on their line.
      const double product = lengths_[i] * lengths_[j];
      const double tangent =
          Length(Cross(a, b)) / std::max(product + Dot(a, b), 1e-6 * product + 1e-30);
      weights_[i] += tangent;
      weights_[j] += tangent;
    }
    double u = 0, v = 0, sum = 0;
    for (size_t i = 0; i < n; ++i) {
      const double weight = weights_[i] / std::max(lengths_[i], 1e-3) + 1e-12;
      const TextureCorner& corner = c_.in.corners[ring_[i]];
      u += weight * corner.u;
      v += weight * corner.v;
      sum += weight;
    }
    u /= sum;
    v /= sum;
    double spread_u = 0, spread_v = 0;
    for (const uint32_t place : ring_) {
      spread_u += std::abs(c_.in.corners[place].u - u);
      spread_v += std::abs(c_.in.corners[place].v - v);
    }
    const double part = 0.125 / static_cast<double>(n);
    const std::array<float, 4> rows{
        static_cast<float>(u + spread_u * part), static_cast<float>(v + spread_v * part),
        static_cast<float>(u - spread_u * part), static_cast<float>(v - spread_v * part)};
    rows_.resize(sizeof(rows));
    std::memcpy(rows_.data(), rows.data(), sizeof(rows));
  }
  std::array<uint32_t, 3> CornersOf(uint32_t slot) const {
    return slot < c_.listed() ? c_.in.triangles[slot] : triangles_[slot - c_.listed()];
  }
  // Of a vertex, in the triangles of a hole; kNone32: it is in none.
  uint32_t PlaceAt(std::span<const uint32_t> hole, uint32_t vertex) const {
    for (const uint32_t slot : hole) {
      const std::array<uint32_t, 3> corners = CornersOf(slot);
      for (uint32_t i = 0; i < 3; ++i) {
        if (corners[i] == vertex) return c_.in.corner_places[slot][i];
      }
    }
    return kNone32;
  }

  template <typename Code>
  bool AddFan(NodeIndex node, IndexRange star, std::span<const uint32_t> hole, Code&& code) {
    ring_.clear();
    ring_positions_.clear();
    const auto add = [&](uint32_t vertex) {
      ring_.push_back(PlaceAt(hole, vertex));
      ring_positions_.push_back(c_.position(vertex));
      return ring_.back() != kNone32;
    };
    const std::array<uint32_t, 3> first = c_.created_triangle(node, star.front());
    uint32_t last = kNone32;
    for (const uint32_t slot : star) {
      const std::array<uint32_t, 3> t = c_.created_triangle(node, slot);
      triangles_.push_back(t);
      if (!add(t[1])) return false;
      last = t[2];
    }
    if (last != first[1] && !add(last)) return false;
    const auto place = static_cast<uint32_t>(c_.in.corners.size());
    Expect(c_.position(first[0]));
    constexpr std::array<uint32_t, 2> kRows{0, 1};
    TextureCorner corner = code(star.front(), AttributeCoder::Star{{}, kRows, {}});
    corner.page = c_.in.corners[ring_[0]].page;
    c_.in.corners.push_back(corner);
    for (size_t j = 0; j < star.size(); ++j) {
      c_.in.corner_places.push_back({place, ring_[j], ring_[j + 1 == ring_.size() ? 0 : j + 1]});
    }
    return true;
  }

  Cluster& c_;
  Bytes rows_;
  std::vector<std::array<uint32_t, 3>> triangles_;  // of created slots
  // Of the fan at hand.
  std::vector<uint32_t> ring_;
  std::vector<Vec3i> ring_positions_;
  std::vector<double> weights_, lengths_;
};

// Who creates a slot.
NodeIndex NodeOf(const Cluster& cluster, uint32_t slot) {
  const auto next = std::upper_bound(cluster.star_begin.begin(), cluster.star_begin.end(), slot);
  return static_cast<NodeIndex>(next - cluster.star_begin.begin() - 1);
}

struct Seam {
  uint32_t from, to, half_edge;
  friend auto operator<=>(const Seam&, const Seam&) = default;
};

bool IsLegal(const TextureCorner& corner) {
  return std::abs(corner.u) <= kMostTextureCoordinate &&
         std::abs(corner.v) <= kMostTextureCoordinate;
}

}  // namespace

std::vector<uint32_t> FindHiddenSeams(const ClusterUpdates& updates,
                                      std::span<const uint32_t> in_triangles,
                                      std::span<const uint8_t> in_rotations, const InPatch& in) {
  std::vector<Seam> seams;
  for (uint32_t slot = 0; slot < in_triangles.size(); ++slot) {
    const uint8_t marks = updates.seams[in_triangles[slot]];
    for (uint32_t i = 0; i < 3; ++i) {
      if ((marks >> (i + in_rotations[slot]) % 3 & 1) == 0) continue;
      seams.push_back({in.triangles[slot][i], in.triangles[slot][(i + 1) % 3], 4 * slot + i});
    }
  }
  std::sort(seams.begin(), seams.end());
  const auto corner = [&](uint32_t h, uint32_t behind) {
    return in.corners[3 * (h >> 2) + ((h & 3) + behind) % 3];
  };
  std::vector<uint32_t> hidden;
  for (const Seam& seam : seams) {
    if (seam.from > seam.to) continue;
    const auto other = std::lower_bound(seams.begin(), seams.end(), Seam{seam.to, seam.from, 0});
    if (other == seams.end() || other->from != seam.to || other->to != seam.from) continue;
    const uint32_t h = seam.half_edge, o = other->half_edge;
    if (corner(h, 0) == corner(o, 1) && corner(h, 1) == corner(o, 0)) hidden.push_back(h);
  }
  std::sort(hidden.begin(), hidden.end());
  return hidden;
}

void EncodeSeams(std::span<const uint32_t> seams, StreamWriter& streams) {
  if (seams.empty()) return;
  ByteWriter& out = streams.stream(StreamTag::kSeams);
  uint32_t last = 0;
  for (const uint32_t h : seams) out.PutVarint(h - std::exchange(last, h));
}

Status DecodeSeams(const StreamReader& streams, uint32_t listed, const std::string& where,
                   std::vector<uint32_t>* seams) {
  ByteReader in = streams.stream(StreamTag::kSeams);
  const uint64_t end = 4 * uint64_t{listed};
  uint64_t h = 0;
  while (in.remaining() > 0) {
    const uint64_t step = in.GetVarint();
    if (in.failed() || step > end || (step == 0 && !seams->empty())) {
      return Corrupt(where + ": seams: not ascending");
    }
    h += step;
    if (h >= end || (h & 3) == 3) return Corrupt(where + ": seams: an edge that is not there");
    seams->push_back(static_cast<uint32_t>(h));
  }
  return Status::Ok();
}

void MarkSeams(std::span<const uint32_t> seams, InPatch& in) {
  in.seams.assign(in.triangles.size(), 0);
  if (seams.empty()) return;
  const auto ends = [&](uint32_t h) {
    const std::array<uint32_t, 3>& t = in.triangles[h >> 2];
    return std::pair(t[h & 3], t[((h & 3) + 1) % 3]);
  };
  std::vector<Seam> marked;  // by their ends, the other way round
  for (const uint32_t h : seams) marked.push_back({ends(h).second, ends(h).first, h});
  std::sort(marked.begin(), marked.end());
  for (const Seam& seam : marked) {
    in.seams[seam.half_edge >> 2] |= static_cast<uint8_t>(1 << (seam.half_edge & 3));
  }
  for (uint32_t slot = 0; slot < in.triangles.size(); ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      const auto [from, to] = ends(4 * slot + i);
      const auto at = std::lower_bound(marked.begin(), marked.end(), Seam{from, to, 0});
      if (at == marked.end() || at->from != from || at->to != to) continue;
      in.seams[slot] |= static_cast<uint8_t>(1 << i);
    }
  }
}

void EncodeCorners(const ClusterUpdates& updates, Cluster cluster,
                   std::span<const uint32_t> slot_triangle,
                   const std::function<uint32_t(uint32_t)>& stored_vertex, StreamWriter& streams) {
  RansEncoder stream;
  AttributeCoder coder(PlaceLayout(updates.corner_step));
  const auto corner_at = [&](uint32_t slot, uint32_t stored) -> const TextureCorner& {
    const uint32_t t = slot_triangle[slot];
    for (size_t i = 0; i < 3; ++i) {
      if (stored_vertex(updates.triangles[t][i]) == stored) return updates.corners[t][i];
    }
    MTDB_CHECK(false, "a triangle without its vertex");
    return updates.corners[t][0];
  };
  CornerReplay replay(cluster);
  const bool fits = replay.Run([&](uint32_t slot, const AttributeCoder::Star& star) {
    // The node's vertex is the first corner of its triangles.
    const TextureCorner& corner =
        corner_at(slot, cluster.created_triangle(NodeOf(cluster, slot), slot)[0]);
    coder.Encode(stream, star, replay.rows(), reinterpret_cast<const std::byte*>(&corner));
    return corner;
  });
  MTDB_CHECK(fits, "holes and stars that do not fit");
  for (uint32_t slot = cluster.listed(); slot < slot_triangle.size(); ++slot) {
    const std::array<uint32_t, 3> t = cluster.created_triangle(NodeOf(cluster, slot), slot);
    const std::array<TextureCorner, 3> found = cluster.texture(slot);
    for (size_t i = 0; i < 3; ++i) {
      MTDB_CHECK(found[i] == corner_at(slot, t[i]), "corners of one fan that differ");
    }
  }
  streams.AddCoded(StreamTag::kCorners, stream.Finish());
}

Status DecodeCorners(const StreamReader& streams, const std::string& where, Cluster* cluster) {
  RansDecoder<> stream(streams.bytes(StreamTag::kCorners));
  AttributeCoder coder(PlaceLayout(cluster->in.corner_step));
  CornerReplay replay(*cluster);
  const bool fits = replay.Run([&](uint32_t, const AttributeCoder::Star& star) {
    TextureCorner corner;
    coder.Decode(stream, star, replay.rows(), reinterpret_cast<std::byte*>(&corner));
    if (!IsLegal(corner)) corner.u = corner.v = 0;
    return corner;
  });
  if (!fits) {
    return Corrupt(where + ": corners: they do not fit the nodes");
  }
  if (!stream.Done()) return Corrupt(where + ": corners: do not end where they should");
  return Status::Ok();
}

}  // namespace mtdb::internal
