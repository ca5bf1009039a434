// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/soup_join.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <string>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/position_hash.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMaxParts = 256;

template <typename Position>
class SoupJoin {
  static constexpr size_t kCornerBytes = sizeof(Position);
  // A part's memory per corner: its position, and two slots of the table in the worst case.
  static constexpr size_t kPartMemory = kCornerBytes + 2 * sizeof(uint32_t);

 public:
  SoupJoin(const Spool& soup, size_t row_bytes, const SpoolSpace* space, size_t memory_bytes)
      : soup_(soup), row_bytes_(row_bytes), space_(space) {
    const uint64_t corners = soup.size() / stride();
    parts_ = std::min(kMaxParts, corners * kPartMemory / std::max<size_t>(memory_bytes / 2, 1) + 1);
    part_memory_ = memory_bytes / 2 / parts_ / 4;
  }

  Result<uint64_t> Run(Spool* vertices, const std::function<Status(uint32_t)>& receive) {
    MTDB_RETURN_IF_ERROR(Spread());
    MTDB_RETURN_IF_ERROR(Group());
    MTDB_ASSIGN_OR_RETURN(const uint64_t count, Number(vertices));
    MTDB_RETURN_IF_ERROR(Translate());
    SpoolReader reader(&soup_);
    std::vector<SpoolReader> numbers = Readers(numbers_);
    while (reader.remaining() != 0) {
      const std::byte* corner = reader.Next(stride());
      if (corner == nullptr) return reader.status();
      SpoolReader& from = numbers[Part(Normalized(corner))];
      uint32_t number = 0;
      if (!from.Get(&number)) return from.status();
      MTDB_RETURN_IF_ERROR(receive(number));
    }
    return count;
  }

 private:
  static Position Normalized(const std::byte* bytes) {
    Position p;
    std::memcpy(&p, bytes, sizeof(p));
    return p + Position{};  // -0 + 0 = +0
  }
  uint64_t Part(Position p) const { return (HashOfPosition(p) >> 40) % parts_; }

  std::vector<Spool> Spools() const {
    std::vector<Spool> spools;
    for (uint64_t r = 0; r < parts_; ++r) spools.emplace_back(space_, part_memory_);
    return spools;
  }
  std::vector<SpoolReader> Readers(const std::vector<Spool>& spools) const {
    const size_t block = std::clamp<size_t>(part_memory_, 4096, Spool::kBlock);
    std::vector<SpoolReader> readers;
    for (const Spool& s : spools) readers.emplace_back(&s, 0, ~uint64_t{0}, block);
    return readers;
  }
  static Status FinishAll(std::vector<Spool>& spools) {
    for (Spool& s : spools) MTDB_RETURN_IF_ERROR(s.Finish());
    return Status::Ok();
  }

  // Corners to the parts of their positions.
  Status Spread() {
    positions_ = Spools();
    SpoolReader reader(&soup_);
    while (reader.remaining() != 0) {
      const std::byte* corner = reader.Next(stride());
      if (corner == nullptr) return reader.status();
      const Position p = Normalized(corner);
      MTDB_RETURN_IF_ERROR(positions_[Part(p)].Append(&p, kCornerBytes));
    }
    return FinishAll(positions_);
  }

  // Within a part, equal positions get a number of the part's own, in the order of first sight.
  Status Group() {
    groups_ = Spools();
    std::vector<Position> known;
    std::vector<uint32_t> slots;
    for (uint64_t r = 0; r < parts_; ++r) {
      known.clear();
      const uint64_t corners = positions_[r].size() / kCornerBytes;
      if (corners >= kNone32) {
        return Status(
            StatusCode::kBudgetExceeded,
            "billions of corners have positions of one hash; such a mesh cannot be built");
      }
      slots.assign(std::bit_ceil(corners + corners / 2 + 2), kNone32);
      SpoolReader reader(&positions_[r]);
      for (uint64_t i = 0; i < corners; ++i) {
        Position p;
        if (!reader.Get(&p)) return reader.status();
        size_t slot = HashOfPosition(p) & (slots.size() - 1);
        while (slots[slot] != kNone32 && known[slots[slot]] != p) {
          slot = (slot + 1) & (slots.size() - 1);
        }
        if (slots[slot] == kNone32) {
          slots[slot] = static_cast<uint32_t>(known.size());
          known.push_back(p);
        }
        MTDB_RETURN_IF_ERROR(groups_[r].Append(&slots[slot], sizeof(uint32_t)));
      }
      positions_[r] = Spool(space_, 0);
    }
    return FinishAll(groups_);
  }

  // The soup's order decides the vertices' numbers: a part's group is new when its number is.
  Result<uint64_t> Number(Spool* vertices) {
    first_numbers_ = Spools();
    std::vector<SpoolReader> groups = Readers(groups_);
    std::vector<uint32_t> seen(parts_, 0);
    SpoolReader reader(&soup_);
    uint64_t count = 0;
    while (reader.remaining() != 0) {
      const std::byte* corner = reader.Next(stride());
      if (corner == nullptr) return reader.status();
      const Position p = Normalized(corner);
      const uint64_t r = Part(p);
      uint32_t group = 0;
      if (!groups[r].Get(&group)) return groups[r].status();
      if (group != seen[r]) continue;
      ++seen[r];
      if (count == kMaxVertices) return TooManyVertices();
      const auto number = static_cast<uint32_t>(count++);
      MTDB_RETURN_IF_ERROR(vertices->Append(&p, kCornerBytes));
      MTDB_RETURN_IF_ERROR(vertices->Append(corner + kCornerBytes, row_bytes_));
      MTDB_RETURN_IF_ERROR(first_numbers_[r].Append(&number, sizeof(number)));
    }
    MTDB_RETURN_IF_ERROR(FinishAll(first_numbers_));
    return count;
  }

  // Group numbers to vertex numbers, part by part.
  Status Translate() {
    numbers_ = Spools();
    std::vector<uint32_t> number_of;
    for (uint64_t r = 0; r < parts_; ++r) {
      number_of.resize(first_numbers_[r].size() / sizeof(uint32_t));
      MTDB_RETURN_IF_ERROR(
          first_numbers_[r].Read(0, number_of.data(), number_of.size() * sizeof(uint32_t)));
      SpoolReader reader(&groups_[r]);
      while (reader.remaining() != 0) {
        uint32_t group = 0;
        if (!reader.Get(&group)) return reader.status();
        MTDB_RETURN_IF_ERROR(numbers_[r].Append(&number_of[group], sizeof(uint32_t)));
      }
      groups_[r] = Spool(space_, 0);
    }
    return FinishAll(numbers_);
  }

  size_t stride() const { return kCornerBytes + row_bytes_; }

  const Spool& soup_;
  const size_t row_bytes_;
  const SpoolSpace* space_;
  uint64_t parts_ = 1;
  size_t part_memory_ = 0;
  std::vector<Spool> positions_, groups_, first_numbers_, numbers_;  // per part
};

}  // namespace

Status TooManyVertices() {
  return {StatusCode::kUnsupported,
          "more than " + std::to_string(kMaxVertices) +
              " vertices in one object; ingest the parts as objects of their own"};
}

Result<uint64_t> JoinEqualPositions(const Spool& points, bool doubles, size_t row_bytes,
                                    const SpoolSpace* space, size_t memory_bytes, Spool* vertices,
                                    const std::function<Status(uint32_t)>& receive) {
  if (doubles) {
    return SoupJoin<Vec3d>(points, row_bytes, space, memory_bytes).Run(vertices, receive);
  }
  return SoupJoin<Vec3f>(points, row_bytes, space, memory_bytes).Run(vertices, receive);
}

Result<uint64_t> JoinSoup(const Spool& soup, bool doubles, const SpoolSpace* space,
                          size_t memory_bytes, Spool* vertices,
                          const std::function<Status(const std::array<uint32_t, 3>&)>& receive) {
  std::array<uint32_t, 3> triangle{};
  size_t corner = 0;
  return JoinEqualPositions(soup, doubles, 0, space, memory_bytes, vertices, [&](uint32_t number) {
    triangle[corner] = number;
    corner = (corner + 1) % 3;
    return corner == 0 ? receive(triangle) : Status::Ok();
  });
}

}  // namespace mtdb::internal
