// SPDX-License-Identifier: Apache-2.0
#include "builder/surface/sheet_links.h"

#include <algorithm>
#include <array>
#include <string>
#include <tuple>
#include <vector>

#include "builder/disk/packed_numbers.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMaxRanges = 128;
constexpr size_t kLeastMemory = size_t{1} << 20;

// Which edges of a triangle a range looks at: those at its smallest vertex, the one at the next, or
// all.
enum class Edges : uint8_t { kFirstTwo, kLast, kAll };

// A triangle, from its smallest vertex to its largest.
struct Corners {
  std::array<uint32_t, 3> v;
  bool forward = true;  // it runs from the first to the second vertex
  Edges edges = Edges::kAll;
  uint64_t triangle = 0;
};
// With an edge's end for each edge, about.
constexpr size_t kCornersBytes = sizeof(Corners) + 3 * sizeof(uint32_t);

Corners Sorted(const std::array<uint32_t, 3>& t, uint64_t triangle) {
  Corners c{t, true, Edges::kAll, triangle};
  const auto order = [&](size_t i, size_t j) {
    if (c.v[i] < c.v[j]) return;
    std::swap(c.v[i], c.v[j]);
    c.forward = !c.forward;
  };
  order(0, 1);
  order(1, 2);
  order(0, 1);
  return c;
}

// The triangles of a range, as differences to the one before.
class RangeSpool {
 public:
  RangeSpool(const SpoolSpace* space, size_t memory_bytes) : spool_(space, memory_bytes) {}

  Status Add(const Corners& c, Edges edges) {
    std::byte bytes[4 * kMaxVarintBytes];
    const uint64_t marks = uint64_t{c.forward} << 2 | static_cast<uint64_t>(edges);
    std::byte* to = PutVarint(bytes, ZigZag(int64_t{c.v[0]} - int64_t{last_}) << 3 | marks);
    to = PutNear(PutNear(to, c.v[1], c.v[0]), c.v[2], c.v[1]);
    to = PutVarint(to, c.triangle - last_triangle_);
    last_ = c.v[0];
    last_triangle_ = c.triangle;
    ++count_;
    return spool_.Append(bytes, static_cast<size_t>(to - bytes));
  }
  Status Finish() { return spool_.Finish(); }
  uint64_t count() const { return count_; }

  // All of them; gives their room back.
  Status Take(std::vector<Corners>* all) {
    all->resize(count_);
    SpoolReader reader = SpoolReader::Consuming(&spool_);
    uint32_t last = 0;
    uint64_t triangle = 0;
    for (Corners& c : *all) {
      const std::byte* const bytes = reader.Peek(4 * kMaxVarintBytes);
      if (bytes == nullptr) return reader.status();
      uint64_t head = 0, step = 0;
      const std::byte* from = GetVarint(bytes, &head);
      std::array<uint32_t, 3>& v = c.v;
      v[0] = last = static_cast<uint32_t>(int64_t{last} + UnZigZag(head >> 3));
      from = GetNear(from, &v[1], v[0]);
      from = GetNear(from, &v[2], v[1]);
      from = GetVarint(from, &step);
      reader.Skip(static_cast<size_t>(from - bytes));
      c.triangle = triangle += step;
      c.forward = (head & 4) != 0;
      c.edges = static_cast<Edges>(head & 3);
    }
    spool_ = Spool(nullptr, 0);
    return Status::Ok();
  }

 private:
  Spool spool_;
  uint32_t last_ = 0;
  uint64_t last_triangle_ = 0;
  uint64_t count_ = 0;
};

// A triangle at an edge from a vertex to a larger one.
struct Side {
  uint32_t high, third;
  uint64_t triangle;
  bool forward;
};

class LinkFinder {
 public:
  LinkFinder(const Spool& triangles, uint64_t vertices, const SpoolSpace* space,
             size_t memory_bytes, const SheetLinkReceiver& receive)
      : triangles_(triangles), vertices_(vertices), memory_(memory_bytes), receive_(receive) {
    const uint64_t count = triangles.size() / (3 * sizeof(uint32_t));
    const uint64_t ranges = count * kCornersBytes / std::max<size_t>(memory_bytes, 1) + 1;
    while ((vertices >> range_bits_) >= std::min(ranges, kMaxRanges)) ++range_bits_;
    const uint64_t used = ((vertices - 1) >> range_bits_) + 1;
    for (uint64_t r = 0; r < used; ++r) ranges_.emplace_back(space, memory_bytes / 4 / used);
  }

  Result<uint64_t> Run() {
    MTDB_RETURN_IF_ERROR(Spread());
    for (size_t r = 0; r < ranges_.size(); ++r) MTDB_RETURN_IF_ERROR(Look(r));
    return disagreeing_;
  }

 private:
  Status Spread() {
    SpoolReader reader(&triangles_);
    for (uint64_t t = 0; reader.remaining() != 0; ++t) {
      std::array<uint32_t, 3> v;
      if (!reader.Get(&v)) return reader.status();
      const Corners c = Sorted(v, t);
      RangeSpool& first = ranges_[c.v[0] >> range_bits_];
      RangeSpool& second = ranges_[c.v[1] >> range_bits_];
      const bool one = &first == &second;
      MTDB_RETURN_IF_ERROR(first.Add(c, one ? Edges::kAll : Edges::kFirstTwo));
      if (!one) MTDB_RETURN_IF_ERROR(second.Add(c, Edges::kLast));
    }
    for (RangeSpool& range : ranges_) MTDB_RETURN_IF_ERROR(range.Finish());
    return Status::Ok();
  }

  // Calls f(smaller end of an edge, number in corners_) for the range's edges.
  template <typename F>
  void ForEachEnd(F&& f) const {
    for (uint32_t i = 0; i < corners_.size(); ++i) {
      const Corners& c = corners_[i];
      if (c.edges != Edges::kLast) f(c.v[0], i);
      if (c.edges != Edges::kFirstTwo) f(c.v[1], i);
    }
  }

  Status Look(size_t range) {
    const uint64_t bytes = ranges_[range].count() * kCornersBytes;
    if (bytes > 2 * std::max(memory_, kLeastMemory)) {
      return Status(StatusCode::kBudgetExceeded,
                    "finding out how triangles hang together needs " + std::to_string(bytes >> 20) +
                        " MiB for those of near vertices; allow more --memory");
    }
    MTDB_RETURN_IF_ERROR(ranges_[range].Take(&corners_));
    // Ends are counted, summed up, filled from the back.
    const uint64_t first = uint64_t{range} << range_bits_;
    const uint64_t size = std::min(uint64_t{1} << range_bits_, vertices_ - first);
    begin_.assign(size + 1, 0);
    ForEachEnd([&](uint32_t v, uint32_t) { ++begin_[v - first]; });
    for (size_t v = 0; v < size; ++v) begin_[v + 1] += begin_[v];
    places_.resize(begin_[size]);
    ForEachEnd([&](uint32_t v, uint32_t i) { places_[--begin_[v - first]] = i; });
    for (size_t v = 0; v < size; ++v) {
      sides_.clear();
      for (size_t p = begin_[v]; p < begin_[v + 1]; ++p) {
        AddSides(static_cast<uint32_t>(first + v), corners_[places_[p]]);
      }
      MTDB_RETURN_IF_ERROR(LookAtSides());
    }
    return Status::Ok();
  }

  // The edges of a triangle whose smaller end is v.
  void AddSides(uint32_t v, const Corners& c) {
    if (c.v[1] == v) {
      sides_.push_back({c.v[2], c.v[0], c.triangle, c.forward});
      return;
    }
    sides_.push_back({c.v[1], c.v[2], c.triangle, c.forward});
    sides_.push_back({c.v[2], c.v[1], c.triangle, !c.forward});
  }

  Status LookAtSides() {
    std::sort(sides_.begin(), sides_.end(), [](const Side& a, const Side& b) {
      return std::tie(a.high, a.third, a.forward, a.triangle) <
             std::tie(b.high, b.third, b.forward, b.triangle);
    });
    for (size_t from = 0, to = 0; from < sides_.size(); from = to) {
      // The triangles at an edge: of those that are of the same vertices, the first.
      size_t different = 0;
      std::array<const Side*, 2> two{};
      bool any_two_sided = false;
      const uint32_t high = sides_[from].high;
      while (to < sides_.size() && sides_[to].high == high) {
        const Side& side = sides_[to];
        const bool smallest = high < side.third;  // of the triangle's edges
        bool two_sided = false;
        size_t next = to + 1;
        for (;
             next < sides_.size() && sides_[next].high == high && sides_[next].third == side.third;
             ++next) {
          two_sided |= sides_[next].forward != side.forward;
        }
        for (size_t i = to + 1; i < next && smallest && !two_sided; ++i) {
          MTDB_RETURN_IF_ERROR(receive_({side.triangle, sides_[i].triangle, false}));
        }
        if (different < 2) two[different] = &side;
        ++different;
        any_two_sided |= two_sided;
        to = next;
      }
      if (different != 2 || any_two_sided) continue;
      const bool turned = two[0]->forward == two[1]->forward;
      disagreeing_ += turned;
      const auto [a, b] = std::minmax(two[0]->triangle, two[1]->triangle);
      MTDB_RETURN_IF_ERROR(receive_({a, b, turned}));
    }
    return Status::Ok();
  }

  const Spool& triangles_;
  const uint64_t vertices_;
  const size_t memory_;
  const SheetLinkReceiver& receive_;
  int range_bits_ = 0;
  std::vector<RangeSpool> ranges_;
  std::vector<Corners> corners_;  // of the range at work
  std::vector<uint32_t> begin_;   // in places_, of the edges at each vertex
  std::vector<uint32_t> places_;  // in corners_
  std::vector<Side> sides_;       // of a vertex
  uint64_t disagreeing_ = 0;
};

}  // namespace

Result<uint64_t> FindSheetLinks(const Spool& triangles, uint64_t vertices, const SpoolSpace* space,
                                size_t memory_bytes, const SheetLinkReceiver& receive) {
  if (triangles.size() == 0) return uint64_t{0};
  return LinkFinder(triangles, vertices, space, memory_bytes, receive).Run();
}

}  // namespace mtdb::internal
