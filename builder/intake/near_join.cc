// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/near_join.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <unordered_map>
#include <vector>

#include "builder/disk/disjoint_sets.h"
#include "store/base/hash.h"
#include "store/base/ids.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMaxParts = 256;
constexpr int64_t kBlockCells = 64;
constexpr uint32_t kMostInCell = 64;
// A vertex of a part: the record, its place in the table of cells, its set.
constexpr size_t kRecordMemory = 96;

using Cell = Vec3<int64_t>;

struct CellHash {
  size_t operator()(const Cell& c) const {
    return Mix64(static_cast<uint64_t>(c.x) +
                 Mix64(static_cast<uint64_t>(c.y) + Mix64(static_cast<uint64_t>(c.z))));
  }
};

struct Record {
  Vec3d position;
  uint32_t number = 0;
  uint32_t unused = 0;
};

class NearJoin {
 public:
  NearJoin(const NearJoinInput& input, const SpoolSpace* space, size_t memory_bytes)
      : input_(input), space_(space), memory_bytes_(memory_bytes) {
    const uint64_t vertices = input.vertices->size() / input.vertex_bytes;
    parts_ = std::min(kMaxParts, vertices * kRecordMemory / room() + 1);
    for (uint64_t p = 0; p < parts_; ++p) records_.emplace_back(space, memory_bytes / 4 / parts_);
  }

  Result<NearJoinTotals> Run(Spool* left, Spool* numbers) {
    MTDB_RETURN_IF_ERROR(Spread());
    for (Spool& part : records_) {
      MTDB_RETURN_IF_ERROR(part.Finish());
      MTDB_RETURN_IF_ERROR(Search(part));
      part = Spool(space_, 0);
    }
    return Number(left, numbers);
  }

 private:
  // Bytes that a part should take.
  uint64_t room() const { return std::max<uint64_t>(memory_bytes_ / 2, 1 << 20); }

  // An edge between vertices of one set.
  struct Near {
    uint32_t first, second;  // numbers; first < second
  };

  Status CellOf(Vec3d p, Cell* cell) const {
    for (int i = 0; i < 3; ++i) {
      const double at = std::floor(p[i] / input_.tolerance);
      if (!(std::abs(at) < 0x1p53)) {
        return InvalidArgument("a tolerance of " + Short(input_.tolerance) +
                               " is below the precision of the coordinates; weld equal positions "
                               "(0), or choose a larger one");
      }
      (*cell)[i] = static_cast<int64_t>(at);
    }
    return Status::Ok();
  }
  static std::string Short(double value) {
    char text[32];
    std::snprintf(text, sizeof(text), "%.6g", value);
    return text;
  }
  uint64_t PartOf(const Cell& block) const { return (CellHash()(block) >> 20) % parts_; }

  // Each vertex to the part of its block, and of the blocks beside which it lies.
  Status Spread() {
    SpoolReader reader(input_.vertices);
    Record record;
    for (uint32_t number = 0; reader.remaining() != 0; ++number) {
      const std::byte* bytes = reader.Next(input_.vertex_bytes);
      if (bytes == nullptr) return reader.status();
      record.position = input_.position(bytes);
      record.number = number;
      Cell cell;
      MTDB_RETURN_IF_ERROR(CellOf(record.position, &cell));
      std::array<uint64_t, 8> parts;
      size_t count = 0;
      for (int side = 0; side < 8; ++side) {
        Cell block;
        for (int i = 0; i < 3; ++i) {
          // The cells beside this one reach into one other block at most.
          const int64_t low = Block(cell[i] - 1);
          const int64_t high = Block(cell[i] + 1);
          block[i] = (side >> i & 1) == 0 ? low : high;
        }
        const uint64_t part = PartOf(block);
        if (std::find(parts.begin(), parts.begin() + count, part) != parts.begin() + count) {
          continue;
        }
        parts[count++] = part;
        MTDB_RETURN_IF_ERROR(records_[part].Append(&record, sizeof(record)));
      }
    }
    return Status::Ok();
  }
  static int64_t Block(int64_t cell) {
    return (cell >= 0 ? cell : cell - kBlockCells + 1) / kBlockCells;
  }

  Status Search(const Spool& part) {
    const uint64_t all = part.size() / sizeof(Record);
    if (all == 0) return Status::Ok();
    // Of a tolerance far too large, all of the mesh is one part: so many tell as much.
    const uint64_t count = std::min(all, 2 * room() / kRecordMemory);
    std::vector<Record> records(count);
    MTDB_RETURN_IF_ERROR(part.Read(0, records.data(), count * sizeof(Record)));
    std::unordered_map<Cell, std::pair<uint32_t, uint32_t>, CellHash> cells;  // last, how many
    cells.reserve(count);
    std::vector<uint32_t> before(count, kNone32);  // of the same cell
    DisjointSets sets(count);
    const double most = input_.tolerance * input_.tolerance;
    for (uint32_t i = 0; i < count; ++i) {
      Cell cell;
      MTDB_RETURN_IF_ERROR(CellOf(records[i].position, &cell));
      for (int n = 0; n < 27; ++n) {
        const auto there = cells.find(cell + Cell{n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1});
        if (there == cells.end()) continue;
        for (uint32_t j = there->second.first; j != kNone32; j = before[j]) {
          if (SquaredLength(records[i].position - records[j].position) <= most) sets.Join(i, j);
        }
      }
      const auto [own, fresh] = cells.try_emplace(cell, i, 1);
      if (fresh) continue;
      before[i] = own->second.first;
      own->second.first = i;
      if (++own->second.second > kMostInCell) {
        return InvalidArgument("a tolerance of " + Short(input_.tolerance) + " would weld " +
                               std::to_string(kMostInCell) +
                               " and more vertices in one place; choose one below the lengths of "
                               "the mesh's edges");
      }
    }
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t first = sets.Find(i);
      if (first != i) near_.push_back({records[first].number, records[i].number});
    }
    if (count < all) {
      return Status(StatusCode::kBudgetExceeded,
                    "a tolerance of " + Short(input_.tolerance) + " has to compare " +
                        std::to_string(all) +
                        " vertices in one place; allow more --memory, or choose a smaller one");
    }
    if (near_.size() * (sizeof(Near) + sizeof(Record) + 12) > memory_bytes_ / 2) {
      return Status(StatusCode::kBudgetExceeded,
                    "a tolerance of " + Short(input_.tolerance) + " welds more than " +
                        std::to_string(near_.size()) +
                        " vertices; allow more --memory, or choose a smaller tolerance");
    }
    return Status::Ok();
  }

  // Joins the sets of the parts, and numbers what is left.
  Result<NearJoinTotals> Number(Spool* left, Spool* numbers) {
    std::vector<uint32_t> met;  // vertices that have near ones
    for (const Near& n : near_) met.insert(met.end(), {n.first, n.second});
    std::sort(met.begin(), met.end());
    met.erase(std::unique(met.begin(), met.end()), met.end());
    const auto place = [&](uint32_t number) {
      return static_cast<uint32_t>(std::lower_bound(met.begin(), met.end(), number) - met.begin());
    };
    DisjointSets sets(met.size());
    for (const Near& n : near_) sets.Join(place(n.first), place(n.second));
    near_ = {};
    std::vector<uint32_t> new_number(met.size());
    std::vector<Vec3d> positions(met.size());
    NearJoinTotals totals;
    SpoolReader reader(input_.vertices);
    size_t next = 0;  // in `met`
    for (uint32_t number = 0; reader.remaining() != 0; ++number) {
      const std::byte* bytes = reader.Next(input_.vertex_bytes);
      if (bytes == nullptr) return reader.status();
      auto became = static_cast<uint32_t>(totals.vertices);
      bool stays = true;
      if (next < met.size() && met[next] == number) {
        const uint32_t first = sets.Find(static_cast<uint32_t>(next));
        positions[next] = input_.position(bytes);
        stays = first == next;
        if (stays) new_number[next] = became;
        became = new_number[first];
        totals.displacement =
            std::max(totals.displacement, Length(positions[next] - positions[first]));
        ++next;
      }
      MTDB_RETURN_IF_ERROR(numbers->Append(&became, sizeof(became)));
      if (!stays) continue;
      ++totals.vertices;
      MTDB_RETURN_IF_ERROR(left->Append(bytes, input_.vertex_bytes));
    }
    return totals;
  }

  const NearJoinInput& input_;
  const SpoolSpace* space_;
  const size_t memory_bytes_;
  uint64_t parts_ = 1;
  std::vector<Spool> records_;  // per part
  std::vector<Near> near_;
};

}  // namespace

Result<NearJoinTotals> JoinNear(const NearJoinInput& input, const SpoolSpace* space,
                                size_t memory_bytes, Spool* left, Spool* numbers) {
  return NearJoin(input, space, memory_bytes).Run(left, numbers);
}

}  // namespace mtdb::internal
