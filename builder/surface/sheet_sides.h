// SPDX-License-Identifier: Apache-2.0
// SheetSides: which triangles are to be turned over so that their sheets are consistent, out of
// core.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "builder/disk/parity_sets.h"
#include "builder/disk/spool.h"
#include "builder/surface/sheet_links.h"
#include "store/base/status.h"

namespace mtdb::internal {

struct SheetCounts {
  uint64_t sheets = 0;            // single triangles, too
  uint64_t unorientable = 0;      // have one side only, as a Moebius band
  uint64_t turned_triangles = 0;  // are to be turned over
};

// A sheet gets the orientation that most of its triangles have, so that the fewest turn over; when
// as many have the other one, that of its first triangle. A sheet that no orientation suits stays
// as it is. The result does not depend on the blocks.
//
// Triangles are cut into blocks of consecutive numbers. Count() takes them from the first to the
// last: the links inside of a block join its triangles to sets with parities. The links of a set
// to later blocks go: one stays, to the set's successor, and each other one becomes a link between
// its end and the successor, in their blocks. So a set is known by its successor alone, to which
// its counts go. What has no successor is a whole sheet. Resolve() goes back, from the last block
// to the first, and tells each set what became of its successor.
class SheetSides {
 public:
  struct Options {
    uint64_t triangles = 0;
    uint32_t block = 1;  // triangles; takes kTriangleBytes each
    const SpoolSpace* space = nullptr;
    size_t memory_bytes = 0;  // of spools
  };
  static constexpr size_t kTriangleBytes = 48;
  explicit SheetSides(const Options& options);

  Status Link(const SheetLink& link);
  // After the last link.
  Result<SheetCounts> Count();
  // After that.
  Status Resolve();
  // Then, for each triangle in their order: whether it is to be turned over.
  Result<bool> NextIsTurned();

 private:
  // What is known of a set of triangles, seen from its first one.
  struct Set {
    uint64_t successor = 0;               // a later triangle, or 0: none
    uint64_t first = 0;                   // the first triangle in the input's order
    std::array<uint64_t, 2> triangles{};  // that run as it does, and that are turned against it
    bool successor_turned = false;
    bool first_turned = false;
    bool one_sided = false;

    // `other` is turned against it.
    void Add(const Set& other, bool turned);
  };
  // From a set to its successor.
  struct Message {
    uint64_t from = 0;
    Set set;
  };
  enum class Fate : uint8_t { kStays, kTurns, kOneSided };  // of a set's first triangle
  struct Answer {
    uint32_t place = 0;  // in the block
    Fate fate = Fate::kStays;
  };
  // Links whose first triangle is in the block, as differences to the ones before.
  struct LinkSpool {
    Spool spool;
    uint64_t last = 0;
  };
  size_t BlockOf(uint64_t triangle) const { return triangle / options_.block; }
  uint64_t FirstOf(size_t block) const { return uint64_t{block} * options_.block; }
  uint32_t SizeOf(size_t block) const;
  // f(link) for those of the block.
  template <typename F>
  Status ForEachLink(size_t block, F&& f);
  Status JoinInside(size_t block);
  Status AddMessages(size_t block);
  Status PassOn(size_t block);
  Status Finish(size_t block);
  Fate FateOf(const Set& set);

  const Options options_;
  std::vector<LinkSpool> links_;  // by blocks, as all of these
  std::vector<Spool> messages_;
  std::vector<Spool> answers_;
  Spool places_;  // of all triangles: the set's first in the block, and the parity
  Spool turned_;  // a byte a triangle, the last block first
  SheetCounts counts_;
  ParitySets sets_;       // of the block at work
  std::vector<Set> all_;  // by the first triangle of each set
  // Of NextIsTurned().
  uint64_t next_ = 0;
  std::vector<uint8_t> buffer_;
};

}  // namespace mtdb::internal
