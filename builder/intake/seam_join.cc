// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/seam_join.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "builder/disk/disjoint_sets.h"
#include "builder/intake/corner_gather.h"
#include "store/base/geometry.h"
#include "store/base/hash.h"
#include "store/base/ids.h"
#include "store/base/position_hash.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMaxParts = 256;
constexpr size_t kTriangleBytes = 12;
constexpr size_t kLeastMemory = size_t{1} << 16;
constexpr double kFold = -0.9999;  // cosine of the normals of faces that lie back to back
constexpr double kSliver = 1e-3;   // height to length of a triangle whose normal says nothing

// Records of one size in parts that fit the memory one by one.
class Parts {
 public:
  Parts(uint64_t most_records, size_t bytes, const SpoolSpace* space, size_t memory_bytes)
      : bytes_(bytes), memory_(std::max(memory_bytes, kLeastMemory)) {
    const uint64_t count = std::min(kMaxParts, most_records * bytes / (memory_ / 2) + 1);
    for (uint64_t i = 0; i < count; ++i) spools_.emplace_back(space, memory_ / 4 / count);
  }
  size_t count() const { return spools_.size(); }
  size_t Of(uint64_t hash) const { return (hash >> 40) % spools_.size(); }
  Status Add(size_t part, const void* record) { return spools_[part].Append(record, bytes_); }
  Status Finish() {
    for (Spool& s : spools_) MTDB_RETURN_IF_ERROR(s.Finish());
    return Status::Ok();
  }
  uint64_t size(size_t part) const { return spools_[part].size() / bytes_; }
  // All records of the part; gives their room back.
  template <typename T>
  Status Take(size_t part, std::vector<T>* records) {
    const uint64_t size = spools_[part].size();
    if (size > 2 * memory_ || size / bytes_ >= kNone32) {
      return Status(StatusCode::kBudgetExceeded,
                    "joining vertices of equal positions needs " + std::to_string(size >> 20) +
                        " MiB for those of one place; allow more --memory, or say --no-weld");
    }
    records->resize(size / sizeof(T));
    auto* const to = reinterpret_cast<std::byte*>(records->data());
    MTDB_RETURN_IF_ERROR(spools_[part].Read(0, to, size));
    spools_[part] = Spool(nullptr, 0);
    return Status::Ok();
  }
  const Spool& spool(size_t part) const { return spools_[part]; }

 private:
  size_t bytes_;
  size_t memory_;
  std::vector<Spool> spools_;
};

// What is looked up for a corner: the first vertex that is like it, the first at its place, and
// where that is, from a corner of the mesh's box.
struct Place {
  uint32_t like = 0;
  uint32_t position = 0;
  Vec3f at;
};

// Half an edge between two places: that of a triangle.
struct HalfEdge {
  uint32_t low, high;  // first vertices of both ends' likes, or places; low < high
  uint32_t third;      // likewise of the corner opposite to it
  uint32_t at_low, at_high;
  std::array<int16_t, 3> normal;  // of the triangle; 0 when it is a sliver
  uint16_t forward;               // 1: from low to high
};

struct Union {
  uint32_t like, a, b;
};
struct Move {
  uint32_t vertex, to;
};

std::array<int16_t, 3> PackedNormal(Vec3d a, Vec3d b, Vec3d c) {
  const Vec3d normal = Cross(b - a, c - a);
  const double longest =
      std::max({SquaredLength(b - a), SquaredLength(c - a), SquaredLength(c - b)});
  const double length = Length(normal);
  if (!(length > kSliver * longest)) return {0, 0, 0};
  std::array<int16_t, 3> packed;
  for (int i = 0; i < 3; ++i) {
    packed[static_cast<size_t>(i)] = static_cast<int16_t>(std::lround(normal[i] / length * 32767));
  }
  return packed;
}

bool AreBackToBack(const HalfEdge& a, const HalfEdge& b) {
  if (a.third == b.third) return true;
  double cosine = 0;
  for (size_t i = 0; i < 3; ++i) cosine += double{1} * a.normal[i] * b.normal[i];
  return cosine < kFold * 32767 * 32767;
}

class SeamJoin {
 public:
  SeamJoin(const SeamJoinInput& input, const SpoolSpace* space, size_t memory_bytes)
      : input_(input),
        space_(space),
        memory_bytes_(memory_bytes),
        vertices_(input.vertices->size() / input.vertex_bytes),
        places_(space, memory_bytes / 8) {}

  Result<SeamJoinTotals> Run(Spool* left, Spool* triangles) {
    totals_.vertices = vertices_;
    MTDB_RETURN_IF_ERROR(FindUsed());
    MTDB_RETURN_IF_ERROR(FindCandidates());
    if (!any_) return totals_;
    MTDB_RETURN_IF_ERROR(FindPlaces());
    if (totals_.equal == 0) return totals_;
    Parts unions(3 * input_.triangles->size() / kTriangleBytes, sizeof(Union), space_,
                 memory_bytes_ / 2);
    const auto join = [&](uint32_t like, uint32_t u, uint32_t v) {
      const Union both{like, u, v};
      return u == v ? Status::Ok() : unions.Add(unions.Of(Mix64(like)), &both);
    };
    const auto join_both = [&](const HalfEdge& a, const HalfEdge& b) {
      const Status low = join(a.low, a.at_low, b.at_low);
      return low.ok() ? join(a.high, a.at_high, b.at_high) : low;
    };
    MTDB_RETURN_IF_ERROR(ForEachPair(false, join_both));
    const auto compare = [&](const HalfEdge& a, const HalfEdge& b) {
      const bool differ = a.at_low != b.at_low || a.at_high != b.at_high;
      totals_.attributes_differ = totals_.attributes_differ || differ;
      return Status::Ok();
    };
    if (rows_differ_) MTDB_RETURN_IF_ERROR(ForEachPair(true, compare));
    MTDB_RETURN_IF_ERROR(Unite(unions));
    if (totals_.joined == 0) return totals_;
    totals_.equal -= totals_.joined;
    totals_.vertices -= totals_.joined;
    MTDB_RETURN_IF_ERROR(Write(left, triangles));
    return totals_;
  }

 private:
  Vec3d Position(const std::byte* vertex) const {
    if (input_.doubles) {
      Vec3d p;
      std::memcpy(&p, vertex, sizeof(p));
      return p + Vec3d{};  // -0 + 0 = +0
    }
    Vec3f p;
    std::memcpy(&p, vertex, sizeof(p));
    return Vec3d{p.x, p.y, p.z} + Vec3d{};
  }
  size_t position_bytes() const { return input_.doubles ? sizeof(Vec3d) : sizeof(Vec3f); }

  // f(number, bytes of the vertex).
  template <typename F>
  Status ForEachVertex(F&& f) const {
    SpoolReader reader(input_.vertices);
    for (uint64_t v = 0; v < vertices_; ++v) {
      const std::byte* bytes = reader.Next(input_.vertex_bytes);
      if (bytes == nullptr) return reader.status();
      MTDB_RETURN_IF_ERROR(f(static_cast<uint32_t>(v), bytes));
    }
    return Status::Ok();
  }

  // Vertices of triangles whose position another one may have: those of one hash. (Scanners write
  // millions of others at the origin.)
  Status FindCandidates() {
    struct Hashed {
      uint64_t hash;
      uint32_t vertex, unused;
    };
    Parts parts(vertices_, sizeof(Hashed), space_, memory_bytes_);
    MTDB_RETURN_IF_ERROR(ForEachVertex([&](uint32_t v, const std::byte* bytes) {
      const Vec3d p = Position(bytes);
      bounds_.Add(p);
      if (!used_[v]) return Status::Ok();
      const Hashed record{HashOfPosition(p), v, 0};
      return parts.Add(parts.Of(record.hash), &record);
    }));
    MTDB_RETURN_IF_ERROR(parts.Finish());
    candidate_.assign(vertices_, false);
    std::vector<Hashed> records;
    std::vector<uint32_t> slots;
    for (size_t part = 0; part < parts.count(); ++part) {
      MTDB_RETURN_IF_ERROR(parts.Take(part, &records));
      slots.assign(std::bit_ceil(records.size() + records.size() / 2 + 2), kNone32);
      for (uint32_t i = 0; i < records.size(); ++i) {
        size_t slot = records[i].hash & (slots.size() - 1);
        while (slots[slot] != kNone32 && records[slots[slot]].hash != records[i].hash) {
          slot = (slot + 1) & (slots.size() - 1);
        }
        if (slots[slot] == kNone32) {
          slots[slot] = i;
          continue;
        }
        any_ = true;
        candidate_[records[slots[slot]].vertex] = candidate_[records[i].vertex] = true;
      }
    }
    return Status::Ok();
  }

  Status FindUsed() {
    used_.assign(vertices_, false);
    SpoolReader reader(input_.triangles);
    std::array<uint32_t, 3> t;
    while (reader.remaining() != 0) {
      if (!reader.Get(&t)) return reader.status();
      for (const uint32_t v : t) used_[v] = true;
    }
    return Status::Ok();
  }

  // What likes are told by: the position with +0 for -0, and the row, of a long one its hashes.
  static constexpr size_t kLongRow = 2 * sizeof(uint64_t);
  size_t key_bytes() const {
    return position_bytes() + std::min(input_.vertex_bytes - position_bytes(), kLongRow);
  }
  // A candidate's number and key.
  size_t record_bytes() const { return sizeof(uint32_t) + key_bytes(); }

  // Fills places_, a Place for each vertex.
  Status FindPlaces() {
    uint64_t candidates = 0;
    for (const bool is : candidate_) candidates += is;
    Parts parts(candidates, record_bytes(), space_, memory_bytes_);
    Bytes record(record_bytes());
    MTDB_RETURN_IF_ERROR(ForEachVertex([&](uint32_t v, const std::byte* bytes) {
      if (!candidate_[v]) return Status::Ok();
      std::memcpy(record.data(), &v, sizeof(v));
      PutKey(bytes, record.data() + sizeof(v));
      return parts.Add(parts.Of(HashOfPosition(Position(bytes))), record.data());
    }));
    MTDB_RETURN_IF_ERROR(parts.Finish());
    shared_.assign(vertices_, false);
    std::vector<Spool> found;
    for (size_t part = 0; part < parts.count(); ++part) {
      found.emplace_back(space_, memory_bytes_ / 8 / parts.count());
      MTDB_RETURN_IF_ERROR(GroupPart(part, parts, &found.back()));
    }
    const size_t block = std::clamp<size_t>(memory_bytes_ / 8 / parts.count(), 4096, Spool::kBlock);
    std::vector<SpoolReader> readers;
    for (const Spool& s : found) readers.emplace_back(&s, 0, ~uint64_t{0}, block);
    MTDB_RETURN_IF_ERROR(ForEachVertex([&](uint32_t v, const std::byte* bytes) {
      const Vec3d p = Position(bytes);
      const Vec3d from = p - bounds_.min;
      Place place{
          v,
          v,
          {static_cast<float>(from.x), static_cast<float>(from.y), static_cast<float>(from.z)}};
      if (candidate_[v]) {
        SpoolReader& reader = readers[parts.Of(HashOfPosition(p))];
        std::array<uint32_t, 2> first;
        if (!reader.Get(&first)) return reader.status();
        place.like = first[0];
        place.position = first[1];
      }
      return places_.Append(&place, sizeof(place));
    }));
    return places_.Finish();
  }
  void PutKey(const std::byte* vertex, std::byte* key) const {
    const Vec3d p = Position(vertex);
    const Vec3f single{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
    const void* const position = input_.doubles ? static_cast<const void*>(&p) : &single;
    std::memcpy(key, position, position_bytes());
    const ByteSpan row(vertex + position_bytes(), input_.vertex_bytes - position_bytes());
    if (row.size() <= kLongRow) {
      std::copy(row.begin(), row.end(), key + position_bytes());
      return;
    }
    const std::array<uint64_t, 2> hashes{Hash64(row), Hash64(row, 1)};
    std::memcpy(key + position_bytes(), hashes.data(), sizeof(hashes));
  }

  // For each vertex of the part, in their order, the first that is like it, and the first there.
  Status GroupPart(size_t part, Parts& parts, Spool* found) {
    Bytes records;
    MTDB_RETURN_IF_ERROR(parts.Take(part, &records));
    const size_t count = records.size() / record_bytes();
    std::vector<uint32_t> order(count);
    for (uint32_t i = 0; i < count; ++i) order[i] = i;
    const auto bytes = [&](uint32_t i) { return records.data() + i * record_bytes() + 4; };
    const auto compare = [&](uint32_t i, uint32_t j, size_t size) {
      return std::memcmp(bytes(i), bytes(j), size);
    };
    std::sort(order.begin(), order.end(), [&](uint32_t i, uint32_t j) {
      const int less = compare(i, j, key_bytes());
      return less != 0 ? less < 0 : i < j;
    });
    const auto number = [&](uint32_t i) {
      uint32_t v;
      std::memcpy(&v, records.data() + i * record_bytes(), sizeof(v));
      return v;
    };
    std::vector<std::array<uint32_t, 2>> first(count);
    for (size_t from = 0, to = 0; from < count; from = to) {
      uint32_t here = kNone32;
      uint64_t used = 0;
      for (to = from; to < count && compare(order[from], order[to], position_bytes()) == 0; ++to) {
        here = std::min(here, number(order[to]));
        used += used_[number(order[to])];
      }
      totals_.equal += used > 1 ? used - 1 : 0;
      for (size_t a = from, b = from; a < to; a = b) {
        for (; b < to && compare(order[a], order[b], key_bytes()) == 0; ++b) {
          first[order[b]] = {number(order[a]), here};
          shared_[number(order[b])] = to - from > 1;
        }
        rows_differ_ = rows_differ_ || b < to;
      }
    }
    for (const auto& pair : first) MTDB_RETURN_IF_ERROR(found->Append(&pair, sizeof(pair)));
    return found->Finish();
  }

  CornerTable place_table() const { return {&places_, vertices_, sizeof(Place), sizeof(Place)}; }

  // f(one, other) for the edges that join: by likes, where at_low and at_high are vertices; or by
  // places, where they are the first of their likes.
  template <typename F>
  Status ForEachPair(bool by_place, F&& f) {
    Parts parts(3 * input_.triangles->size() / kTriangleBytes, sizeof(HalfEdge), space_,
                memory_bytes_);
    MTDB_RETURN_IF_ERROR(GatherCorners(
        *input_.triangles, place_table(), space_, 2 * memory_bytes_,
        [&](const std::array<uint32_t, 3>& t, const std::array<const std::byte*, 3>& corners) {
          return AddHalfEdges(by_place, t, corners, parts);
        }));
    MTDB_RETURN_IF_ERROR(parts.Finish());
    std::vector<HalfEdge> edges;
    for (size_t part = 0; part < parts.count(); ++part) {
      MTDB_RETURN_IF_ERROR(parts.Take(part, &edges));
      std::sort(edges.begin(), edges.end(), [](const HalfEdge& a, const HalfEdge& b) {
        return std::tie(a.low, a.high) < std::tie(b.low, b.high);
      });
      for (size_t from = 0, to = 0; from < edges.size(); from = to) {
        const auto same = [&](const HalfEdge& e) {
          return e.low == edges[from].low && e.high == edges[from].high;
        };
        while (to < edges.size() && same(edges[to])) ++to;
        if (to - from != 2 || edges[from].forward == edges[from + 1].forward) continue;
        if (AreBackToBack(edges[from], edges[from + 1])) continue;
        MTDB_RETURN_IF_ERROR(f(edges[from], edges[from + 1]));
      }
    }
    return Status::Ok();
  }

  Status AddHalfEdges(bool by_place, const std::array<uint32_t, 3>& t,
                      const std::array<const std::byte*, 3>& corners, Parts& parts) const {
    if (!shared_[t[0]] && !shared_[t[1]] && !shared_[t[2]]) return Status::Ok();
    std::array<Place, 3> places;
    std::array<uint32_t, 3> ids;
    for (size_t c = 0; c < 3; ++c) {
      std::memcpy(&places[c], corners[c], sizeof(Place));
      ids[c] = by_place ? places[c].position : places[c].like;
    }
    if (ids[0] == ids[1] || ids[1] == ids[2] || ids[2] == ids[0]) return Status::Ok();
    const auto at = [&](size_t c) { return Vec3d{places[c].at.x, places[c].at.y, places[c].at.z}; };
    HalfEdge edge;
    edge.normal = PackedNormal(at(0), at(1), at(2));
    for (size_t c = 0; c < 3; ++c) {
      size_t low = c, high = (c + 1) % 3;
      if (!shared_[t[low]] && !shared_[t[high]]) continue;
      edge.forward = ids[low] < ids[high];
      if (!edge.forward) std::swap(low, high);
      edge.low = ids[low];
      edge.high = ids[high];
      edge.third = ids[(c + 2) % 3];
      edge.at_low = by_place ? places[low].like : t[low];
      edge.at_high = by_place ? places[high].like : t[high];
      const uint64_t hash = Mix64(uint64_t{edge.low} << 32 | edge.high);
      MTDB_RETURN_IF_ERROR(parts.Add(parts.Of(hash), &edge));
    }
    return Status::Ok();
  }

  // Unions are between like vertices, so that those of a part are all that concern its vertices.
  Status Unite(Parts& unions) {
    MTDB_RETURN_IF_ERROR(unions.Finish());
    moves_.emplace(vertices_, sizeof(Move), space_, memory_bytes_ / 2);
    while ((vertices_ - 1) >> range_bits_ >= moves_->count()) ++range_bits_;
    gone_.assign((vertices_ >> 6) + 1, 0);
    std::vector<Union> pairs;
    std::vector<uint32_t> met;
    for (size_t part = 0; part < unions.count(); ++part) {
      MTDB_RETURN_IF_ERROR(unions.Take(part, &pairs));
      met.clear();
      for (const Union& u : pairs) met.insert(met.end(), {u.a, u.b});
      std::sort(met.begin(), met.end());
      met.erase(std::unique(met.begin(), met.end()), met.end());
      const auto place = [&](uint32_t v) {
        return static_cast<uint32_t>(std::lower_bound(met.begin(), met.end(), v) - met.begin());
      };
      DisjointSets sets(met.size());
      for (const Union& u : pairs) sets.Join(place(u.a), place(u.b));
      for (uint32_t i = 0; i < met.size(); ++i) {
        const Move move{met[i], met[sets.Find(i)]};
        if (move.to == move.vertex) continue;
        ++totals_.joined;
        gone_[move.vertex >> 6] |= uint64_t{1} << (move.vertex & 63);
        MTDB_RETURN_IF_ERROR(moves_->Add(move.vertex >> range_bits_, &move));
      }
    }
    return moves_->Finish();
  }

  // What the corners of the triangles that stay become.
  struct NewPlace {
    uint32_t number, like;
  };

  Status Write(Spool* left, Spool* triangles) {
    std::vector<uint32_t> before(gone_.size());  // that are gone
    uint32_t sum = 0;
    for (size_t i = 0; i < gone_.size(); ++i) {
      before[i] = sum;
      sum += static_cast<uint32_t>(std::popcount(gone_[i]));
    }
    const auto number = [&](uint32_t v) {
      const uint64_t lower = gone_[v >> 6] & ((uint64_t{1} << (v & 63)) - 1);
      return v - before[v >> 6] - static_cast<uint32_t>(std::popcount(lower));
    };
    Spool table(space_, memory_bytes_ / 8);
    SpoolReader places(&places_);
    std::vector<Move> moves;
    std::vector<uint32_t> became;
    const auto translate = [&](uint32_t v, const std::byte* bytes) {
      const uint32_t at = static_cast<uint32_t>(v & ((uint64_t{1} << range_bits_) - 1));
      if (at == 0) {
        MTDB_RETURN_IF_ERROR(moves_->Take(v >> range_bits_, &moves));
        became.assign(uint64_t{1} << range_bits_, kNone32);
        for (const Move& m : moves) became[m.vertex - v] = m.to;
      }
      Place place;
      if (!places.Get(&place)) return places.status();
      const bool stays = became[at] == kNone32;
      const NewPlace now{number(stays ? v : became[at]), place.like};
      MTDB_RETURN_IF_ERROR(table.Append(&now, sizeof(now)));
      return stays ? left->Append(bytes, input_.vertex_bytes) : Status::Ok();
    };
    MTDB_RETURN_IF_ERROR(ForEachVertex(translate));
    MTDB_RETURN_IF_ERROR(table.Finish());
    places_ = Spool(space_, 0);
    const CornerTable lookup{&table, vertices_, sizeof(NewPlace), sizeof(NewPlace)};
    return GatherCorners(
        *input_.triangles, lookup, space_, 2 * memory_bytes_,
        [&](const std::array<uint32_t, 3>&, const std::array<const std::byte*, 3>& corners) {
          std::array<NewPlace, 3> now;
          for (size_t c = 0; c < 3; ++c) std::memcpy(&now[c], corners[c], sizeof(NewPlace));
          const bool stays = now[0].like != now[1].like && now[1].like != now[2].like &&
                             now[2].like != now[0].like;
          if (input_.told) MTDB_RETURN_IF_ERROR(input_.told(stays));
          if (!stays) return Status::Ok();
          const std::array<uint32_t, 3> t{now[0].number, now[1].number, now[2].number};
          return triangles->Append(t.data(), kTriangleBytes);
        });
  }

  const SeamJoinInput& input_;
  const SpoolSpace* space_;
  size_t memory_bytes_;
  uint64_t vertices_;
  SeamJoinTotals totals_;
  Box3d bounds_;
  bool any_ = false;
  bool rows_differ_ = false;     // at one place
  std::vector<bool> candidate_;  // a position of this hash was seen twice
  std::vector<bool> used_;       // by a triangle
  std::vector<bool> shared_;     // another vertex has its position
  Spool places_;
  std::optional<Parts> moves_;  // by ranges of vertices
  int range_bits_ = 0;
  std::vector<uint64_t> gone_;  // bits
};

}  // namespace

Result<SeamJoinTotals> JoinSeams(const SeamJoinInput& input, const SpoolSpace* space,
                                 size_t memory_bytes, Spool* left, Spool* triangles) {
  return SeamJoin(input, space, memory_bytes).Run(left, triangles);
}

}  // namespace mtdb::internal
