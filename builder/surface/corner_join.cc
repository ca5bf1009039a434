// SPDX-License-Identifier: Apache-2.0
#include "builder/surface/corner_join.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <span>
#include <utility>

#include "builder/disk/packed_numbers.h"
#include "builder/disk/parallel.h"
#include "builder/surface/corner_keys.h"
#include "builder/surface/orient_sheets.h"
#include "builder/surface/sheet_orientation.h"

namespace mtdb::internal {

namespace {

// A corner at vertex v of triangle (v, a, b): a link edge of v.
struct Corner {
  uint32_t vertex, a, b;
};
// What is answered: the order of the edge (v, a), see TileTriangle::order, and ...
constexpr uint16_t kOrderMask = 15;
constexpr uint16_t kFixed = 16;     // v is a node of the graph of creases, or not one fan
constexpr uint16_t kDropped = 32;   // the triangle repeats an earlier one, or is its opposite
constexpr uint16_t kTwoSided = 64;  // a later one is its opposite
constexpr uint16_t kFans = 128;     // v has a number for each fan; this one's in four bits above
constexpr int kFanShift = 8;
constexpr uint16_t kMoreFans = 1 << 12;   // it is not the last one
constexpr uint16_t kOwnNumber = 1 << 13;  // the fan has a number as if it were a vertex
// Memory that a range takes per corner: the corner, its place in the vertex's list, its answer.
constexpr size_t kCornerMemory = sizeof(Corner) + sizeof(uint32_t) + sizeof(uint16_t);
constexpr size_t kTexturedMemory = sizeof(CornerKeys) + sizeof(uint32_t);
// And per vertex, beside its row: position, displacement, list, first number of its fans.
constexpr size_t kVertexMemory = sizeof(Vec3i) + sizeof(double) + 2 * sizeof(uint32_t);

// What is asked of the vertices of a range, in the input's order: their corners, as differences to
// the one before. A triangle whose vertices all lie in the range is there once, for its corners.
class Questions {
 public:
  Questions(const SpoolSpace* space, size_t memory_bytes) : spool_(space, memory_bytes) {}

  // `keys`: none, or those of the edges (v, a), (a, b), (b, v), and of the triangle.
  using Keys = TriangleKeys;
  Status Ask(const Corner& corner, bool whole, const Keys* keys) {
    std::byte bytes[kMostBytes];
    std::byte* to =
        PutVarint(bytes, ZigZag(int64_t{corner.vertex} - int64_t{last_}) << 1 | uint64_t{whole});
    to = PutNear(PutNear(to, corner.a, corner.vertex), corner.b, corner.vertex);
    last_ = corner.vertex;
    count_ += whole ? 3 : 1;
    if (keys != nullptr) {
      std::memcpy(to, keys, sizeof(*keys));
      to += sizeof(*keys);
    }
    return spool_.Append(bytes, static_cast<size_t>(to - bytes));
  }
  Status Finish() { return spool_.Finish(); }
  uint64_t count() const { return count_; }

  // All of them; gives their room back. `keys`: filled likewise, or null.
  Status Take(std::vector<Corner>* corners, std::vector<CornerKeys>* keys) {
    SpoolReader reader = SpoolReader::Consuming(&spool_);
    uint32_t last = 0;
    for (size_t i = 0; i < corners->size();) {
      const std::byte* const bytes = reader.Peek(kMostBytes);
      if (bytes == nullptr) return reader.status();
      uint64_t head = 0;
      Corner corner{};
      const std::byte* from = GetVarint(bytes, &head);
      corner.vertex = last = static_cast<uint32_t>(int64_t{last} + UnZigZag(head >> 1));
      from = GetNear(GetNear(from, &corner.a, last), &corner.b, last);
      Keys k{};
      if (keys != nullptr) {
        std::memcpy(&k, from, sizeof(k));
        from += sizeof(k);
        (*keys)[i] = {k[0], k[2], k[3]};
      }
      reader.Skip(static_cast<size_t>(from - bytes));
      (*corners)[i++] = corner;
      if (!(head & 1)) continue;
      MTDB_CHECK(i + 2 <= corners->size(), "questions that nobody asked");
      if (keys != nullptr) {
        (*keys)[i] = {k[1], k[0], k[3]};
        (*keys)[i + 1] = {k[2], k[1], k[3]};
      }
      (*corners)[i++] = {corner.a, corner.b, corner.vertex};
      (*corners)[i++] = {corner.b, corner.vertex, corner.a};
    }
    spool_ = Spool(nullptr, 0);
    return Status::Ok();
  }

 private:
  static constexpr size_t kMostBytes = 3 * kMaxVarintBytes + sizeof(Keys);
  Spool spool_;
  uint32_t last_ = 0;
  uint64_t count_ = 0;
};

// An answer is a byte: flags, and whether the vertex is known from an answer not long ago. Flags
// that do not fit follow, with the first number of a chain's vertex. Unless it is known, its
// position follows, as a difference to the one that was said last, and its row.
class AnswerPacking {
 public:
  explicit AnswerPacking(size_t row_bytes) : row_bytes_(row_bytes) {
    constexpr size_t kKnownBytes = size_t{1} << 14;  // rows are many in few ranges, or few
    while (known_ > 1 && known_ * (sizeof(Known) + row_bytes) > kKnownBytes) known_ /= 2;
    table_.resize(known_);
    rows_.resize(known_ * row_bytes);
  }
  size_t max_bytes() const { return 1 + 2 * kMaxVarintBytes + 3 * kMaxNearBytes + row_bytes_; }

  size_t Put(uint32_t vertex, Vec3i position, const std::byte* row, uint16_t flags, uint32_t number,
             std::byte* bytes) {
    const size_t at = vertex & (known_ - 1);
    const bool known = table_[at].vertex == vertex;
    const bool few = flags < kTwoSided;
    std::byte* to = bytes;
    *to++ = static_cast<std::byte>((few ? flags << 1 : kLong) | known);
    if (!few) to = PutVarint(PutVarint(to, flags), number);
    if (known) return static_cast<size_t>(to - bytes);
    to = PutNear(to, position, last_);
    std::copy_n(row, row_bytes_, to);
    Remember(at, vertex, position, row);
    return static_cast<size_t>(to - bytes) + row_bytes_;
  }
  struct Answer {
    Vec3i position;
    const std::byte* row = nullptr;  // valid until the next one
    uint16_t flags = 0;
    uint32_t number = 0;
  };
  // `vertex` as it was put; of max_bytes() that may be looked at. Returns what follows.
  const std::byte* Get(uint32_t vertex, const std::byte* from, Answer* answer) {
    const size_t at = vertex & (known_ - 1);
    const auto head = static_cast<uint8_t>(*from++);
    answer->flags = (head & 0x7f) >> 1;
    if (head & kLong) {
      uint64_t flags = 0, number = 0;
      from = GetVarint(GetVarint(from, &flags), &number);
      answer->flags = static_cast<uint16_t>(flags);
      answer->number = static_cast<uint32_t>(number);
    }
    if (!(head & 1)) {
      Vec3i position;
      from = GetNear(from, &position, last_);
      Remember(at, vertex, position, from);
      from += row_bytes_;
    }
    answer->position = table_[at].position;
    answer->row = rows_.data() + at * row_bytes_;
    return from;
  }

 private:
  static constexpr uint8_t kLong = 0x80;
  struct Known {
    uint32_t vertex = kNone32;
    Vec3i position;
  };
  void Remember(size_t at, uint32_t vertex, Vec3i position, const std::byte* row) {
    table_[at] = {vertex, position};
    std::copy_n(row, row_bytes_, rows_.data() + at * row_bytes_);
    last_ = position;
  }

  size_t row_bytes_;
  size_t known_ = 1024;
  std::vector<Known> table_;  // by the last bits of vertices' numbers
  Bytes rows_;
  Vec3i last_;
};

// The link of one vertex. Reused, so that it keeps its memory.
class Link {
 public:
  struct Counts {
    uint64_t duplicates = 0;
    uint64_t two_sided = 0;
    uint64_t edges = 0;               // to a larger vertex
    uint64_t border_edges = 0;        // running away from the vertex
    uint64_t nonmanifold_edges = 0;   // to a larger vertex
    uint64_t inconsistent_edges = 0;  // likewise
    bool stays = false;               // whatever the error
    bool nonmanifold = false;         // that is not only for seams
    uint32_t fans = 0;                // when they have numbers
  };
  // `places` index `corners` in the input's order, and `keys` of textured meshes (else null); sets
  // their `flags`, and of fans with numbers as vertices `own_numbers`, which are counted from 0.
  // Appends to `turns` what it finds about two-sided triangles.
  Counts Analyse(std::span<const uint32_t> places, const Corner* corners, const CornerKeys* keys,
                 uint16_t* flags, uint32_t* own_numbers, std::vector<SheetTurn>& turns) {
    Counts counts;
    keys_ = keys;
    edges_.clear();
    for (const uint32_t i : places) edges_.push_back({corners[i].a, corners[i].b, i});
    const uint32_t v = corners[places[0]].vertex;
    if (OneCycle()) {
      for (const Edge& e : edges_) counts.edges += v < e.a;
      return counts;
    }
    std::sort(edges_.begin(), edges_.end(), [](const Edge& x, const Edge& y) {
      return std::tie(x.a, x.b, x.place) < std::tie(y.a, y.b, y.place);
    });
    DropDuplicates(v, flags, counts);
    JoinOpposites(v, flags, counts);
    CountUses();
    if (!two_sided_.empty()) FindTurns(v, turns);
    if (keys_ != nullptr) FindSeams();
    bool known = true;  // the orders of all edges
    uint32_t creases = 0;
    for (const Neighbour& n : neighbours_) {
      counts.edges += v < n.vertex;
      counts.border_edges += n.uses() == 1 && n.out == 1;
      creases += n.order() != 0;
      known &= n.order() <= kMostOrder;
      counts.nonmanifold |= n.order() > 1 && !n.seam;
      counts.nonmanifold_edges += n.order() > 1 && !n.seam && v < n.vertex;
      counts.inconsistent_edges += n.disagree() && v < n.vertex;
    }
    counts.stays = !FindFans(creases) || !known;
    const bool few = fans_ <= kMostOrder;
    if (fans_ > 1 && (few || keys_ != nullptr)) counts.fans = fans_;
    const bool any_seam = std::ranges::any_of(neighbours_, &Neighbour::seam);
    counts.nonmanifold = counts.stays && (counts.nonmanifold || !any_seam);
    for (const Edge& e : edges_) {
      uint32_t answer = std::min(At(e.a).order(), kMostOrder);
      if (counts.stays) answer |= kFixed;
      if (counts.fans > 0 && few) answer |= kFans | e.fan << kFanShift;
      if (!few || e.fan + 1 < counts.fans) answer |= kMoreFans;
      if (counts.fans > 0 && !few) {
        answer |= kOwnNumber;
        own_numbers[e.place] = e.fan;
      }
      flags[e.place] = static_cast<uint16_t>(flags[e.place] | answer);
    }
    return counts;
  }

 private:
  struct Edge {
    uint32_t a, b, place;
    uint32_t fan = kNone32;
    bool two_sided = false;
  };
  struct Neighbour {
    uint32_t vertex;
    uint32_t out = 0, in = 0, two_sided = 0;  // link edges of either kind
    bool seam = false, seen = false;
    uint64_t key = 0;  // of the edge to it, on one side
    uint32_t uses() const { return out + in + two_sided; }
    bool inside_two_sided() const { return two_sided == 2 && uses() == 2; }
    bool inside() const { return out == 1 && in == 1 && uses() == 2; }
    bool disagree() const { return (out == 2 || in == 2) && uses() == 2; }
    uint32_t order() const { return (inside() || inside_two_sided()) && !seam ? 0 : uses(); }
  };
  // True when the edges, in any order, are one cycle: most vertices. A walk that returns to its
  // first edge after as many steps as there are edges has met each once, and no two begin alike.
  bool OneCycle() const {
    constexpr size_t kFew = 16;  // all pairs are compared
    if (edges_.size() > kFew || edges_.size() == 2) return false;
    size_t at = 0;
    for (size_t step = 1;; ++step) {
      const uint32_t next = edges_[at].b;
      const size_t before = at;
      for (at = 0; at < edges_.size() && edges_[at].a != next;) ++at;
      if (at == edges_.size()) return false;
      if (keys_ != nullptr && KeysAt(edges_[before]).at_b != KeysAt(edges_[at]).at_a) return false;
      if (at == 0) return step == edges_.size();
      if (step == edges_.size()) return false;
    }
  }
  // They are counted at the smallest of the three vertices.
  void DropDuplicates(uint32_t v, uint16_t* flags, Counts& counts) {
    size_t kept = 0;
    for (size_t i = 0; i < edges_.size(); ++i) {
      const Edge& e = edges_[i];
      if (i > 0 && e.a == edges_[kept - 1].a && e.b == edges_[kept - 1].b) {
        flags[e.place] |= kDropped;
        counts.duplicates += v < e.a && v < e.b;
      } else {
        edges_[kept++] = e;
      }
    }
    edges_.resize(kept);
  }
  // Of two that are each other's reverse the first in the input's order stays, two-sided.
  void JoinOpposites(uint32_t v, uint16_t* flags, Counts& counts) {
    two_sided_.clear();
    size_t kept = 0;
    for (Edge& e : edges_) {
      const auto reverse =
          std::lower_bound(edges_.begin(), edges_.end(), std::pair(e.b, e.a),
                           [](const Edge& x, const auto& y) { return std::pair(x.a, x.b) < y; });
      e.two_sided = reverse != edges_.end() && reverse->a == e.b && reverse->b == e.a &&
                    (keys_ == nullptr || KeysAt(e).triangle == KeysAt(*reverse).triangle);
      if (e.two_sided) flags[e.place] |= reverse->place < e.place ? kDropped : kTwoSided;
    }
    for (const Edge& e : edges_) {
      if (flags[e.place] & kDropped) continue;
      counts.two_sided += e.two_sided && v < e.a && v < e.b;
      if (e.two_sided) {
        two_sided_.push_back({e.a, static_cast<uint32_t>(kept)});
        two_sided_.push_back({e.b, static_cast<uint32_t>(kept)});
      }
      edges_[kept++] = e;
    }
    edges_.resize(kept);
    std::sort(two_sided_.begin(), two_sided_.end());
  }
  // Sets the neighbours, with the number of link edges that begin and end there.
  void CountUses() {
    ends_.clear();
    for (const Edge& e : edges_) {
      ends_.push_back({e.a, e.two_sided ? End::kOfTwoSided : End::kOut});
      ends_.push_back({e.b, e.two_sided ? End::kOfTwoSided : End::kIn});
    }
    std::sort(ends_.begin(), ends_.end());
    neighbours_.clear();
    for (size_t i = 0; i < ends_.size();) {
      Neighbour n{ends_[i].first};
      for (; i < ends_.size() && ends_[i].first == n.vertex; ++i) {
        const End end = ends_[i].second;
        (end == End::kOut ? n.out : end == End::kIn ? n.in : n.two_sided) += 1;
      }
      neighbours_.push_back(n);
    }
  }
  const CornerKeys& KeysAt(const Edge& e) const { return keys_[e.place]; }
  // Of edges of two triangles.
  void FindSeams() {
    const auto see = [&](uint32_t vertex, uint64_t key) {
      Neighbour& n = At(vertex);
      if (!n.inside() && !n.inside_two_sided()) return;
      n.seam |= n.seen && n.key != key;
      n.seen = true;
      n.key = key;
    };
    for (const Edge& e : edges_) {
      see(e.a, KeysAt(e).at_a);
      see(e.b, KeysAt(e).at_b);
    }
  }
  // The places in edges_ of two-sided ones that begin or end there.
  std::span<const std::pair<uint32_t, uint32_t>> TwoSidedAt(uint32_t vertex) const {
    const auto first = std::pair(vertex, 0u), next = std::pair(vertex + 1, 0u);
    const auto begin = std::lower_bound(two_sided_.begin(), two_sided_.end(), first);
    return {begin, std::lower_bound(begin, two_sided_.end(), next)};
  }
  // How those run that meet in an edge to a larger vertex.
  void FindTurns(uint32_t v, std::vector<SheetTurn>& turns) const {
    for (const Neighbour& n : neighbours_) {
      if (n.vertex < v || !n.inside_two_sided()) continue;
      const auto at = TwoSidedAt(n.vertex);
      const Edge& e = edges_[at[0].second];
      const Edge& f = edges_[at[1].second];
      turns.push_back({SheetOrientation::KeyOf(v, e.a, e.b), SheetOrientation::KeyOf(v, f.a, f.b),
                       (e.a == n.vertex) == (f.a == n.vertex)});
    }
  }
  Neighbour& At(uint32_t vertex) {
    return *std::lower_bound(neighbours_.begin(), neighbours_.end(), vertex,
                             [](const Neighbour& n, uint32_t x) { return n.vertex < x; });
  }
  // The next edge of the fan at a vertex where it does not end.
  Edge& Beyond(const Edge& e, uint32_t vertex) {
    if (!e.two_sided) {
      return *std::lower_bound(edges_.begin(), edges_.end(), vertex,
                               [](const Edge& x, uint32_t y) { return x.a < y; });
    }
    const auto at = TwoSidedAt(vertex);
    Edge& first = edges_[at[0].second];
    return &first != &e ? first : edges_[at[1].second];
  }
  // Follows the fan that begins with the edge, at its end `from`; returns where it ends, or where
  // it began.
  uint32_t Follow(Edge& first, uint32_t from, uint32_t fan) {
    Edge* e = &first;
    for (uint32_t at = from;;) {
      e->fan = fan;
      at = at == e->a ? e->b : e->a;
      if (At(at).order() != 0) return at;
      e = &Beyond(*e, at);
      if (e == &first) return at;
    }
  }
  // Follows the fan that begins with the edge at a crease; true: it runs from one to another one.
  bool FollowOpen(Edge& e) {
    const uint32_t from = At(e.a).order() != 0 || !e.two_sided ? e.a : e.b;
    return Follow(e, from, fans_++) != from;
  }
  // Numbers the fans, those of many triangles first: what vanishes with time is small. False when
  // the vertex stays: when it has more than one fan without being on a chain, or is an end of
  // creases.
  bool FindFans(uint32_t creases) {
    fans_ = 0;
    bool chain = creases == 0 || creases == 2;
    for (Edge& e : edges_) {
      if (e.fan != kNone32) continue;
      const bool begins = At(e.a).order() != 0 || (e.two_sided && At(e.b).order() != 0);
      if (begins) chain &= FollowOpen(e);
    }
    const uint32_t open = fans_;
    for (Edge& e : edges_) {
      if (e.fan == kNone32) Follow(e, e.a, fans_++);
    }
    // Of a chain, each fan runs from one crease to the other.
    chain &= creases == 0 ? fans_ == 1 : fans_ == open && fans_ <= kMostOrder;
    if (fans_ > 1 && (fans_ <= kMostOrder || keys_ != nullptr)) SortFans();
    return chain;
  }
  // Of equal ones the first in the input's order comes first.
  void SortFans() {
    sorted_fans_.assign(fans_, {0, kNone32, 0});
    for (const Edge& e : edges_) {
      SortedFan& fan = sorted_fans_[e.fan];
      --fan.minus_size;
      fan.place = std::min(fan.place, e.place);
      fan.number = e.fan;
    }
    std::sort(sorted_fans_.begin(), sorted_fans_.end());
    ranks_.resize(fans_);
    for (uint32_t i = 0; i < fans_; ++i) ranks_[sorted_fans_[i].number] = i;
    for (Edge& e : edges_) e.fan = ranks_[e.fan];
  }

  enum class End : uint8_t { kIn, kOut, kOfTwoSided };

  std::vector<Edge> edges_;  // sorted by a
  std::vector<std::pair<uint32_t, End>> ends_;
  std::vector<std::pair<uint32_t, uint32_t>> two_sided_;  // ends, places in edges_; sorted
  std::vector<Neighbour> neighbours_;
  uint32_t fans_ = 0;
  struct SortedFan {
    int64_t minus_size = 0;  // how many triangles
    uint32_t place = kNone32, number = 0;
    friend auto operator<=>(const SortedFan&, const SortedFan&) = default;
  };
  std::vector<SortedFan> sorted_fans_;
  std::vector<uint32_t> ranks_;
  const CornerKeys* keys_ = nullptr;
};

class Join {
 public:
  Join(InputMesh& input, const Grid& grid, const JoinOptions& options, JoinTotals& totals)
      : input_(input),
        grid_(grid),
        options_(options),
        totals_(totals),
        orientation_(options.table_bytes) {
    const uint64_t vertices = input.vertices();
    const uint64_t triangles = input.triangles();
    const uint64_t need =
        3 * triangles * (kCornerMemory + (input.textured() ? kTexturedMemory : 0)) +
        vertices * (kVertexMemory + input.row_bytes());
    // A range is a power of two, and small enough that its tables stay near the processor.
    const unsigned threads = std::max(1u, options.threads);
    const uint64_t room = std::max<uint64_t>(options.table_bytes, 1);
    const uint64_t ranges =
        std::max({need / (room / threads + 1) + 1, need / kHandyRange + 1, uint64_t{1}});
    range_bits_ = 0;
    while ((vertices >> range_bits_) >= std::min(ranges, kMaxRanges)) ++range_bits_;
    const uint64_t count = ((vertices - 1) >> range_bits_) + 1;
    range_need_ = need / count;
    workers_ = static_cast<unsigned>(std::clamp<uint64_t>(room / (range_need_ + 1), 1, threads));
    first_fans_.resize(count);
    for (uint64_t r = 0; r < count; ++r) {
      questions_.emplace_back(options.space, options.memory_bytes / 4 / count);
      answers_.emplace_back(options.space, options.memory_bytes / 4 / count);
    }
  }

  Status Run(const BlockReceiver& receive) {
    // Ranges that are as many as may be, and still too long.
    constexpr uint64_t kLeastTableBytes = uint64_t{1} << 20;
    if (range_need_ > std::max<uint64_t>(options_.table_bytes, kLeastTableBytes)) {
      return Status(StatusCode::kBudgetExceeded,
                    std::to_string(input_.vertices()) + " vertices of " +
                        std::to_string(input_.row_bytes()) + " bytes of attributes need " +
                        std::to_string((range_need_ >> 20) + 1) + " MiB to be joined, " +
                        std::to_string(options_.table_bytes >> 20) +
                        " MiB are left for that; allow more --memory");
    }
    MTDB_RETURN_IF_ERROR(Ask());
    std::vector<Status> statuses(workers_);
    std::vector<Worker> workers(workers_);
    ParallelFor(questions_.size(), workers_, [&](unsigned worker, size_t r) {
      if (!statuses[worker].ok()) return;
      statuses[worker] = Answer(r, workers[worker]);
    });
    for (const Status& status : statuses) MTDB_RETURN_IF_ERROR(status);
    for (const Worker& worker : workers) {
      const JoinTotals& part = worker.totals;
      totals_.vertices += part.vertices;
      totals_.unreferenced_vertices += part.unreferenced_vertices;
      totals_.duplicate_triangles += part.duplicate_triangles;
      totals_.two_sided_triangles += part.two_sided_triangles;
      totals_.edges += part.edges;
      totals_.boundary_edges += part.boundary_edges;
      totals_.nonmanifold_edges += part.nonmanifold_edges;
      totals_.inconsistent_edges += part.inconsistent_edges;
      totals_.nonmanifold_vertices += part.nonmanifold_vertices;
      totals_.rounding_error = std::max(totals_.rounding_error, part.rounding_error);
    }
    input_.DropVertices();
    workers.clear();
    if (totals_.inconsistent_edges > 0 && !options_.sheets_known) {
      MTDB_ASSIGN_OR_RETURN(totals_.sheets, CountSheets(input_.triangle_spool(), input_.vertices(),
                                                        options_.space, options_.table_bytes));
    }
    MTDB_RETURN_IF_ERROR(NumberFans());
    return Collect(receive);
  }

 private:
  static constexpr uint64_t kMaxRanges = 256;
  static constexpr uint64_t kHandyRange = uint64_t{16} << 20;  // bytes of its tables
  // Triangles that are given on at once; fewer when their rows are long.
  size_t block_triangles() const {
    constexpr size_t kBlockTriangles = 8192;
    constexpr size_t kRowBytes = size_t{2} << 20;
    return std::clamp<size_t>(kRowBytes / (3 * CornerRowBytes(input_) + 1), 1, kBlockTriangles);
  }
  // What a thread keeps from range to range.
  struct Worker {
    Link link;
    JoinTotals totals;
    std::vector<Vec3i> positions;
    std::vector<double> displaced;
    Bytes rows;
    std::vector<Corner> corners;
    std::vector<CornerKeys> keys;       // of textured meshes
    std::vector<uint32_t> own_numbers;  // likewise: of fans that have them
    std::vector<uint32_t> begin, places;
    std::vector<uint16_t> flags;
    std::vector<SheetTurn> turns;
    std::vector<uint32_t> numbers;  // of vertices with fans: of their first ones, in the range
    uint32_t fans = 0;              // of the range's vertices that have several
  };
  Status Ask() {
    SpoolReader reader(&input_.triangle_spool());
    SpoolReader corner_reader(&input_.corners().spool());
    TriangleCorners corners;
    for (uint64_t t = 0; t < input_.triangles(); ++t) {
      std::array<uint32_t, 3> v;
      if (!reader.Get(&v)) return reader.status();
      if (input_.textured() && !corner_reader.Get(&corners)) return corner_reader.status();
      input_.corners().Round(corners);
      const TriangleKeys keys = input_.textured() ? KeysOf(v, corners) : TriangleKeys{};
      const uint32_t range = v[0] >> range_bits_;
      const bool whole = range == v[1] >> range_bits_ && range == v[2] >> range_bits_;
      for (size_t c = 0; c < (whole ? 1 : 3); ++c) {
        const TriangleKeys from_here{keys[c], keys[(c + 1) % 3], keys[(c + 2) % 3], keys[3]};
        MTDB_RETURN_IF_ERROR(
            questions_[v[c] >> range_bits_].Ask({v[c], v[(c + 1) % 3], v[(c + 2) % 3]}, whole,
                                                input_.textured() ? &from_here : nullptr));
      }
    }
    for (Questions& q : questions_) MTDB_RETURN_IF_ERROR(q.Finish());
    return Status::Ok();
  }

  // Answers the questions of range `r`, whose vertices are numbered from `first`.
  Status Answer(size_t r, Worker& w) {
    const uint64_t first = uint64_t{r} << range_bits_;
    MTDB_RETURN_IF_ERROR(LoadVertices(first, w));
    MTDB_RETURN_IF_ERROR(LoadCorners(r, first, w));
    for (size_t v = 0; v < w.positions.size(); ++v) {
      if (w.begin[v] == w.begin[v + 1]) {
        ++w.totals.unreferenced_vertices;
        continue;
      }
      ++w.totals.vertices;
      w.totals.rounding_error = std::max(w.totals.rounding_error, w.displaced[v]);
      const Link::Counts counts =
          w.link.Analyse(std::span(w.places).subspan(w.begin[v], w.begin[v + 1] - w.begin[v]),
                         w.corners.data(), input_.textured() ? w.keys.data() : nullptr,
                         w.flags.data(), w.own_numbers.data(), w.turns);
      w.totals.two_sided_triangles += counts.two_sided;
      w.totals.duplicate_triangles += counts.duplicates;
      w.totals.edges += counts.edges;
      w.totals.boundary_edges += counts.border_edges;
      w.totals.nonmanifold_edges += counts.nonmanifold_edges;
      w.totals.inconsistent_edges += counts.inconsistent_edges;
      w.totals.nonmanifold_vertices += counts.nonmanifold;
      w.numbers[v] = w.fans;
      w.fans += counts.fans;
      // Each such fan is a vertex.
      if (counts.fans > kMostOrder) w.totals.vertices += counts.fans - 1;
    }
    orientation_.Add(w.turns);
    w.turns.clear();
    first_fans_[r] = w.fans;
    return WriteAnswers(r, first, w);
  }

  Status LoadVertices(uint64_t first, Worker& w) {
    const auto vertices =
        static_cast<uint32_t>(std::min(uint64_t{1} << range_bits_, input_.vertices() - first));
    const size_t row = input_.row_bytes();
    w.positions.resize(vertices);
    w.displaced.resize(vertices);
    w.numbers.assign(vertices, 0);
    w.fans = 0;
    w.rows.resize(vertices * row);
    SpoolReader vertex_reader(&input_.vertex_spool(), first * input_.vertex_bytes(),
                              (first + vertices) * input_.vertex_bytes());
    for (uint32_t v = 0; v < vertices; ++v) {
      const std::byte* bytes = vertex_reader.Next(input_.vertex_bytes());
      if (bytes == nullptr) return vertex_reader.status();
      const Vec3d position = input_.Position(bytes);
      w.positions[v] = grid_.Quantize(position);
      w.displaced[v] = grid_.Displacement(position);
      std::copy_n(input_.Row(bytes), row, w.rows.data() + v * row);
    }
    return Status::Ok();
  }

  // The questions' corners, and the places of each vertex's among them.
  Status LoadCorners(size_t r, uint64_t first, Worker& w) {
    const uint64_t count = questions_[r].count();
    if (count >= kNone32) {
      return Status(StatusCode::kBudgetExceeded,
                    "some vertices have billions of triangles; such a mesh cannot be built");
    }
    const auto n = static_cast<uint32_t>(count);
    w.corners.resize(n);
    if (input_.textured()) {
      w.keys.resize(n);
      w.own_numbers.assign(n, 0);
    }
    MTDB_RETURN_IF_ERROR(questions_[r].Take(&w.corners, input_.textured() ? &w.keys : nullptr));
    // Counted, summed up, filled from the back.
    const size_t vertices = w.positions.size();
    w.begin.assign(vertices + 1, 0);
    for (const Corner& c : w.corners) ++w.begin[c.vertex - first];
    for (size_t v = 0; v < vertices; ++v) w.begin[v + 1] += w.begin[v];
    w.places.resize(n);
    for (uint32_t i = n; i-- > 0;) w.places[--w.begin[w.corners[i].vertex - first]] = i;
    w.flags.assign(n, 0);
    return Status::Ok();
  }

  Status WriteAnswers(size_t r, uint64_t first, const Worker& w) {
    const size_t row = input_.row_bytes();
    AnswerPacking packing(row);
    Bytes answer(packing.max_bytes());
    for (size_t i = 0; i < w.corners.size(); ++i) {
      const uint64_t v = w.corners[i].vertex - first;
      const uint32_t own = (w.flags[i] & kOwnNumber) ? w.own_numbers[i] : 0;
      const size_t size = packing.Put(w.corners[i].vertex, w.positions[v], w.rows.data() + v * row,
                                      w.flags[i], w.numbers[v] + own, answer.data());
      MTDB_RETURN_IF_ERROR(answers_[r].Append(answer.data(), size));
    }
    return answers_[r].Finish();
  }

  // The fans of vertices with several have the numbers behind the input's, range by range.
  Status NumberFans() {
    uint64_t next = input_.vertices();
    for (uint64_t& fans : first_fans_) next += std::exchange(fans, next);
    if (next < kNone32) return Status::Ok();
    return Status(StatusCode::kUnsupported, std::to_string(next) + " fans of vertices; at most " +
                                                std::to_string(kNone32 - 1) +
                                                " can be built at once");
  }

  Status Collect(const BlockReceiver& receive) {
    SpoolReader reader = input_.TakeTriangles();
    SpoolReader corner_reader(&input_.corners().spool());
    TriangleCorners corners;
    const size_t block =
        std::clamp<size_t>(options_.memory_bytes / 8 / answers_.size(), 4096, Spool::kBlock);
    const size_t row = input_.row_bytes();
    const size_t corner_row = CornerRowBytes(input_);
    std::vector<SpoolReader> answers;
    for (Spool& a : answers_) answers.push_back(SpoolReader::Consuming(&a, block));
    std::vector<AnswerPacking> packings(answers_.size(), AnswerPacking(row));
    const size_t most = packings[0].max_bytes();
    const size_t block_size = block_triangles();
    TriangleBlock out;
    for (uint64_t t = 0; t < input_.triangles(); ++t) {
      std::array<uint32_t, 3> vertices;
      if (!reader.Get(&vertices)) return reader.status();
      if (input_.textured() && !corner_reader.Get(&corners)) return corner_reader.status();
      input_.corners().Round(corners);
      if (out.triangles.empty()) {
        out.triangles.reserve(block_size);
        out.rows.reserve(3 * corner_row * block_size);
      }
      TileTriangle& triangle = out.triangles.emplace_back();
      triangle.vertices = vertices;
      uint16_t all = 0;
      for (uint32_t c = 0; c < 3; ++c) {
        const size_t range = vertices[c] >> range_bits_;
        const std::byte* const bytes = answers[range].Peek(most);
        if (bytes == nullptr) return answers[range].status();
        AnswerPacking::Answer answer;
        const std::byte* const end = packings[range].Get(vertices[c], bytes, &answer);
        answers[range].Skip(static_cast<size_t>(end - bytes));
        all |= answer.flags;
        SetCorner(answer, first_fans_[range], c, triangle);
        out.rows.insert(out.rows.end(), answer.row, answer.row + row);
        if (!input_.textured()) continue;
        const ByteSpan corner = std::as_bytes(std::span(corners).subspan(c, 1));
        out.rows.insert(out.rows.end(), corner.begin(), corner.end());
      }
      if (all & kDropped) {
        out.triangles.pop_back();
        out.rows.resize(out.rows.size() - 3 * corner_row);
        continue;
      }
      if (all & kTwoSided) {
        triangle.set_two_sided(true);
        if (orientation_.Turned(vertices))
          TurnOver(triangle, std::span(out.rows).last(3 * corner_row));
      }
      if (input_.textured()) {
        AddLengths(triangle.positions, grid_, corners, input_.corners().step(), &totals_.lengths,
                   &totals_.texture_lengths);
      }
      totals_.triangles += triangle.sides();
      if (out.triangles.size() < block_size) continue;
      MTDB_RETURN_IF_ERROR(receive(std::exchange(out, TriangleBlock{})));
    }
    return out.triangles.empty() ? Status::Ok() : receive(std::move(out));
  }

  // `first_fan`: the number of the first fan of the vertex's range.
  static void SetCorner(const AnswerPacking::Answer& answer, uint64_t first_fan, uint32_t c,
                        TileTriangle& triangle) {
    triangle.positions[c] = answer.position;
    triangle.set_order(c, answer.flags & kOrderMask);
    triangle.set_fixed(c, (answer.flags & kFixed) != 0);
    triangle.set_more_fans(c, (answer.flags & kMoreFans) != 0);
    if (answer.flags & kFans) {
      const uint32_t fan = answer.flags >> kFanShift & kMostOrder;
      triangle.vertices[c] = static_cast<uint32_t>(first_fan + answer.number + fan);
      triangle.set_fan(c, fan);
    } else if (answer.flags & kOwnNumber) {
      triangle.vertices[c] = static_cast<uint32_t>(first_fan + answer.number);
    }
  }

  // Exchanges the last two corners; `rows`: of the corners.
  static void TurnOver(TileTriangle& triangle, std::span<std::byte> rows) {
    const TileTriangle old = triangle;
    constexpr std::array<uint32_t, 3> kCorners = {0, 2, 1};
    constexpr std::array<uint32_t, 3> kEdges = {2, 1, 0};
    for (uint32_t c = 0; c < 3; ++c) {
      triangle.vertices[c] = old.vertices[kCorners[c]];
      triangle.positions[c] = old.positions[kCorners[c]];
      triangle.set_fan(c, old.fan(kCorners[c]));
      triangle.set_more_fans(c, old.more_fans(kCorners[c]));
      triangle.set_fixed(c, old.fixed(kCorners[c]));
      triangle.set_order(c, old.order(kEdges[c]));
    }
    const size_t row = rows.size() / 3;
    std::ranges::swap_ranges(rows.subspan(row, row), rows.subspan(2 * row, row));
  }

  InputMesh& input_;
  const Grid& grid_;
  const JoinOptions& options_;
  JoinTotals& totals_;
  SheetOrientation orientation_;
  uint64_t range_need_ = 0;           // bytes of a range's tables, on average
  int range_bits_ = 0;                // of the number of vertices in a range
  unsigned workers_ = 1;              // ranges at work at a time
  std::vector<Questions> questions_;  // per range
  std::vector<Spool> answers_;        // per range, by AnswerPacking
  // Per range: how many fans its vertices with several have; then the number of the first one.
  std::vector<uint64_t> first_fans_;
};

}  // namespace

Status JoinCorners(InputMesh& input, const Grid& grid, const JoinOptions& options,
                   JoinTotals* totals, const BlockReceiver& receive) {
  return Join(input, grid, options, *totals).Run(receive);
}

}  // namespace mtdb::internal
