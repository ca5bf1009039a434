// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/corner_join.h"

#include <algorithm>
#include <utility>

#include "builder/disk/packed_numbers.h"
#include "builder/disk/parallel.h"

namespace mtdb::internal {

namespace {

// A corner at vertex v of triangle (v, a, b): a link edge of v.
struct Corner {
  uint32_t vertex, a, b;
};
constexpr uint8_t kFixed = 1;      // v is at a non-manifold vertex or edge
constexpr uint8_t kBorder = 2;     // edge (v, a) is on the border
constexpr uint8_t kDuplicate = 4;  // the triangle repeats an earlier one
// Memory that a range takes per corner: the corner, its place in the vertex's list, its answer.
constexpr size_t kCornerMemory = sizeof(Corner) + sizeof(uint32_t) + 1;

// What is asked of the vertices of a range, in the input's order: their corners, as differences to
// the one before. A triangle whose vertices all lie in the range is there once, for its corners.
class Questions {
 public:
  Questions(const SpoolSpace* space, size_t memory_bytes) : spool_(space, memory_bytes) {}

  Status Ask(const Corner& corner, bool whole) {
    std::byte bytes[3 * kMaxVarintBytes];
    std::byte* to =
        PutVarint(bytes, ZigZag(int64_t{corner.vertex} - int64_t{last_}) << 1 | uint64_t{whole});
    to = PutNear(PutNear(to, corner.a, corner.vertex), corner.b, corner.vertex);
    last_ = corner.vertex;
    count_ += whole ? 3 : 1;
    return spool_.Append(bytes, static_cast<size_t>(to - bytes));
  }
  Status Finish() { return spool_.Finish(); }
  uint64_t count() const { return count_; }

  // All of them; gives their room back.
  Status Take(std::vector<Corner>* corners) {
    SpoolReader reader = SpoolReader::Consuming(&spool_);
    uint32_t last = 0;
    for (size_t i = 0; i < corners->size();) {
      const std::byte* const bytes = reader.Peek(3 * kMaxVarintBytes);
      if (bytes == nullptr) return reader.status();
      uint64_t head = 0;
      Corner corner{};
      const std::byte* from = GetVarint(bytes, &head);
      corner.vertex = last = static_cast<uint32_t>(int64_t{last} + UnZigZag(head >> 1));
      from = GetNear(GetNear(from, &corner.a, last), &corner.b, last);
      reader.Skip(static_cast<size_t>(from - bytes));
      (*corners)[i++] = corner;
      if (!(head & 1)) continue;
      MTDB_CHECK(i + 2 <= corners->size(), "questions that nobody asked");
      (*corners)[i++] = {corner.a, corner.b, corner.vertex};
      (*corners)[i++] = {corner.b, corner.vertex, corner.a};
    }
    spool_ = Spool(nullptr, 0);
    return Status::Ok();
  }

 private:
  Spool spool_;
  uint32_t last_ = 0;
  uint64_t count_ = 0;
};

// An answer is a byte: flags, and whether the vertex is known from an answer not long ago. Else its
// position follows, as a difference to the one that was said last, and its row.
class AnswerPacking {
 public:
  explicit AnswerPacking(size_t row_bytes) : row_bytes_(row_bytes) {
    constexpr size_t kKnownBytes = size_t{1} << 14;  // rows are many in few ranges, or few
    while (known_ > 1 && known_ * (sizeof(Known) + row_bytes) > kKnownBytes) known_ /= 2;
    table_.resize(known_);
    rows_.resize(known_ * row_bytes);
  }
  size_t max_bytes() const { return 1 + 3 * kMaxNearBytes + row_bytes_; }

  size_t Put(uint32_t vertex, Vec3i position, const std::byte* row, uint8_t flags,
             std::byte* bytes) {
    const size_t at = vertex & (known_ - 1);
    const bool known = table_[at].vertex == vertex;
    std::byte* to = bytes;
    *to++ = static_cast<std::byte>(flags << 1 | known);
    if (known) return 1;
    to = PutNear(to, position, last_);
    std::copy_n(row, row_bytes_, to);
    Remember(at, vertex, position, row);
    return static_cast<size_t>(to - bytes) + row_bytes_;
  }
  // `vertex` as it was put; of max_bytes() that may be looked at. Returns what follows. `row` is
  // valid until the next call.
  const std::byte* Get(uint32_t vertex, const std::byte* from, Vec3i* position,
                       const std::byte** row, uint8_t* flags) {
    const size_t at = vertex & (known_ - 1);
    const auto head = static_cast<uint8_t>(*from++);
    *flags = head >> 1;
    if (!(head & 1)) {
      from = GetNear(from, position, last_);
      Remember(at, vertex, *position, from);
      from += row_bytes_;
    }
    *position = table_[at].position;
    *row = rows_.data() + at * row_bytes_;
    return from;
  }

 private:
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
    uint64_t border_edges = 0;       // running away from the vertex
    uint64_t nonmanifold_edges = 0;  // to a larger vertex
    bool fixed = false;
  };
  // `places` index `corners` in the input's order; sets their `flags`.
  Counts Analyse(std::span<const uint32_t> places, const Corner* corners, uint8_t* flags) {
    Counts counts;
    edges_.clear();
    for (const uint32_t i : places) edges_.push_back({corners[i].a, corners[i].b, i});
    if (OneCycle()) return counts;
    std::sort(edges_.begin(), edges_.end(), [](const Edge& x, const Edge& y) {
      return std::tie(x.a, x.b, x.place) < std::tie(y.a, y.b, y.place);
    });
    // Duplicates go; counted at the smallest of the three vertices.
    size_t kept = 0;
    for (size_t i = 0; i < edges_.size(); ++i) {
      const Edge& e = edges_[i];
      if (i > 0 && e.a == edges_[i - 1].a && e.b == edges_[i - 1].b) {
        flags[e.place] |= kDuplicate;
        const uint32_t v = corners[e.place].vertex;
        counts.duplicates += v < e.a && v < e.b;
      } else {
        edges_[kept++] = e;
      }
    }
    edges_.resize(kept);

    // Neighbours with the number of link edges that begin and end there.
    ends_.clear();
    for (const Edge& e : edges_) {
      ends_.push_back({e.a, true});
      ends_.push_back({e.b, false});
    }
    std::sort(ends_.begin(), ends_.end());
    const uint32_t v = corners[places[0]].vertex;
    neighbours_.clear();
    for (size_t i = 0; i < ends_.size();) {
      Neighbour n{ends_[i].first, 0, 0};
      for (; i < ends_.size() && ends_[i].first == n.vertex; ++i) {
        (ends_[i].second ? n.out : n.in) += 1;
      }
      const bool border = n.out + n.in == 1;
      const bool manifold = border || (n.out == 1 && n.in == 1);
      if (!manifold) {
        counts.fixed = true;
        counts.nonmanifold_edges += v < n.vertex;
      }
      counts.border_edges += border && n.out == 1;
      neighbours_.push_back(n);
    }
    for (const Edge& e : edges_) {
      const Neighbour& n = At(e.a);
      if (n.out == 1 && n.in == 0) flags[e.place] |= kBorder;
    }
    if (!counts.fixed && !edges_.empty()) counts.fixed = !OnePiece();
    if (counts.fixed) {
      for (const Edge& e : edges_) flags[e.place] |= kFixed;
    }
    return counts;
  }

 private:
  struct Edge {
    uint32_t a, b, place;
  };
  struct Neighbour {
    uint32_t vertex;
    uint32_t out, in;
  };
  // True when the edges, in any order, are one cycle: most vertices. A walk that returns to its
  // first edge after as many steps as there are edges has met each once, and no two begin alike.
  bool OneCycle() const {
    constexpr size_t kFew = 16;  // all pairs are compared
    if (edges_.size() > kFew) return false;
    size_t at = 0;
    for (size_t step = 1;; ++step) {
      const uint32_t next = edges_[at].b;
      for (at = 0; at < edges_.size() && edges_[at].a != next;) ++at;
      if (at == edges_.size()) return false;
      if (at == 0) return step == edges_.size();
      if (step == edges_.size()) return false;
    }
  }
  const Neighbour& At(uint32_t vertex) const {
    return *std::lower_bound(neighbours_.begin(), neighbours_.end(), vertex,
                             [](const Neighbour& n, uint32_t x) { return n.vertex < x; });
  }
  // Every neighbour has at most one edge in and one out: walks from the path's begin, if any.
  bool OnePiece() const {
    uint32_t start = edges_[0].a;
    for (const Edge& e : edges_) {
      if (At(e.a).in == 0) start = e.a;
    }
    size_t met = 0;
    for (uint32_t x = start; met <= edges_.size();) {
      const auto e = std::lower_bound(edges_.begin(), edges_.end(), x,
                                      [](const Edge& edge, uint32_t y) { return edge.a < y; });
      if (e == edges_.end() || e->a != x) break;
      ++met;
      x = e->b;
      if (x == start) break;
    }
    return met == edges_.size();
  }

  std::vector<Edge> edges_;  // sorted by a
  std::vector<std::pair<uint32_t, bool>> ends_;
  std::vector<Neighbour> neighbours_;
};

class Join {
 public:
  Join(InputMesh& input, const Grid& grid, const JoinOptions& options, JoinTotals& totals)
      : input_(input), grid_(grid), options_(options), totals_(totals) {
    const uint64_t vertices = input.vertices();
    const uint64_t triangles = input.triangles();
    const uint64_t need =
        3 * triangles * kCornerMemory +
        vertices * (sizeof(Vec3i) + sizeof(double) + input.row_bytes() + sizeof(uint32_t));
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
      totals_.boundary_edges += part.boundary_edges;
      totals_.nonmanifold_edges += part.nonmanifold_edges;
      totals_.nonmanifold_vertices += part.nonmanifold_vertices;
      totals_.rounding_error = std::max(totals_.rounding_error, part.rounding_error);
    }
    input_.DropVertices();
    return Collect(receive);
  }

 private:
  static constexpr uint64_t kMaxRanges = 256;
  static constexpr uint64_t kHandyRange = uint64_t{16} << 20;  // bytes of its tables
  // Triangles that are given on at once; fewer when their rows are long.
  size_t block_triangles() const {
    constexpr size_t kBlockTriangles = 8192;
    constexpr size_t kRowBytes = size_t{2} << 20;
    return std::clamp<size_t>(kRowBytes / (3 * input_.row_bytes() + 1), 1, kBlockTriangles);
  }
  // What a thread keeps from range to range.
  struct Worker {
    Link link;
    JoinTotals totals;
    std::vector<Vec3i> positions;
    std::vector<double> displaced;
    Bytes rows;
    std::vector<Corner> corners;
    std::vector<uint32_t> begin, places;
    std::vector<uint8_t> flags;
  };
  Status Ask() {
    SpoolReader reader(&input_.triangle_spool());
    for (uint64_t t = 0; t < input_.triangles(); ++t) {
      std::array<uint32_t, 3> v;
      if (!reader.Get(&v)) return reader.status();
      const uint32_t range = v[0] >> range_bits_;
      const bool whole = range == v[1] >> range_bits_ && range == v[2] >> range_bits_;
      for (size_t c = 0; c < (whole ? 1 : 3); ++c) {
        MTDB_RETURN_IF_ERROR(
            questions_[v[c] >> range_bits_].Ask({v[c], v[(c + 1) % 3], v[(c + 2) % 3]}, whole));
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
                         w.corners.data(), w.flags.data());
      w.totals.duplicate_triangles += counts.duplicates;
      w.totals.boundary_edges += counts.border_edges;
      w.totals.nonmanifold_edges += counts.nonmanifold_edges;
      w.totals.nonmanifold_vertices += counts.fixed;
    }
    return WriteAnswers(r, first, w);
  }

  Status LoadVertices(uint64_t first, Worker& w) {
    const auto vertices =
        static_cast<uint32_t>(std::min(uint64_t{1} << range_bits_, input_.vertices() - first));
    const size_t row = input_.row_bytes();
    w.positions.resize(vertices);
    w.displaced.resize(vertices);
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
    MTDB_RETURN_IF_ERROR(questions_[r].Take(&w.corners));
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
      const size_t size = packing.Put(w.corners[i].vertex, w.positions[v], w.rows.data() + v * row,
                                      w.flags[i], answer.data());
      MTDB_RETURN_IF_ERROR(answers_[r].Append(answer.data(), size));
    }
    return answers_[r].Finish();
  }

  Status Collect(const BlockReceiver& receive) {
    SpoolReader reader = input_.TakeTriangles();
    const size_t block =
        std::clamp<size_t>(options_.memory_bytes / 8 / answers_.size(), 4096, Spool::kBlock);
    const size_t row = input_.row_bytes();
    std::vector<SpoolReader> answers;
    for (Spool& a : answers_) answers.push_back(SpoolReader::Consuming(&a, block));
    std::vector<AnswerPacking> packings(answers_.size(), AnswerPacking(row));
    const size_t most = packings[0].max_bytes();
    const size_t block_size = block_triangles();
    TriangleBlock out;
    for (uint64_t t = 0; t < input_.triangles(); ++t) {
      std::array<uint32_t, 3> vertices;
      if (!reader.Get(&vertices)) return reader.status();
      if (out.triangles.empty()) {
        out.triangles.reserve(block_size);
        out.rows.reserve(3 * row * block_size);
      }
      TileTriangle& triangle = out.triangles.emplace_back();
      triangle.vertices = vertices;
      uint8_t all = 0;
      for (size_t c = 0; c < 3; ++c) {
        const size_t range = vertices[c] >> range_bits_;
        const std::byte* const answer = answers[range].Peek(most);
        if (answer == nullptr) return answers[range].status();
        uint8_t flags = 0;
        const std::byte* its_row = nullptr;
        const std::byte* const end =
            packings[range].Get(vertices[c], answer, &triangle.positions[c], &its_row, &flags);
        answers[range].Skip(static_cast<size_t>(end - answer));
        all |= flags;
        triangle.fixed_corners |= static_cast<uint8_t>(((flags & kFixed) != 0) << c);
        triangle.border_edges |= static_cast<uint8_t>(((flags & kBorder) != 0) << c);
        out.rows.insert(out.rows.end(), its_row, its_row + row);
      }
      if (all & kDuplicate) {
        out.triangles.pop_back();
        out.rows.resize(out.rows.size() - 3 * row);
        continue;
      }
      ++totals_.triangles;
      if (out.triangles.size() == block_size) {
        MTDB_RETURN_IF_ERROR(receive(std::exchange(out, TriangleBlock{})));
      }
    }
    return out.triangles.empty() ? Status::Ok() : receive(std::move(out));
  }

  InputMesh& input_;
  const Grid& grid_;
  const JoinOptions& options_;
  JoinTotals& totals_;
  uint64_t range_need_ = 0;           // bytes of a range's tables, on average
  int range_bits_ = 0;                // of the number of vertices in a range
  unsigned workers_ = 1;              // ranges at work at a time
  std::vector<Questions> questions_;  // per range
  std::vector<Spool> answers_;        // per range, by AnswerPacking
};

}  // namespace

Status JoinCorners(InputMesh& input, const Grid& grid, const JoinOptions& options,
                   JoinTotals* totals, const BlockReceiver& receive) {
  return Join(input, grid, options, *totals).Run(receive);
}

}  // namespace mtdb::internal
