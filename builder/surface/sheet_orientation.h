// SPDX-License-Identifier: Apache-2.0
// SheetOrientation: which two-sided triangles to turn over, so that neighbours run alike.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "builder/disk/parity_sets.h"
#include "store/base/ids.h"
#include "store/base/open_table.h"

namespace mtdb::internal {

// Two two-sided triangles, by their keys, share an edge with each other and with no other triangle.
struct SheetTurn {
  uint64_t a = 0, b = 0;
  bool turned = false;  // they run through it in the same direction: one of them is to be turned
};

// Of two triangles back to back one stands for both; which one is arbitrary, and so the ones that
// were chosen may run against each other. Sheets are sets with a parity beside each member; the
// member with the smallest key stays as it is. A sheet that has one side only, like a Moebius
// strip, stays as it came: the edges at which it runs against itself keep their ends for ever. So
// do all sheets where the memory does not suffice.
//
// Add() is safe for several threads.
class SheetOrientation {
 public:
  // About so much memory is taken at most.
  explicit SheetOrientation(size_t memory_bytes) : most_(memory_bytes / kBytesEach + kFew) {}

  // Of a triangle by its vertices, in any order.
  static uint64_t KeyOf(uint32_t a, uint32_t b, uint32_t c);

  void Add(std::span<const SheetTurn> turns);
  // When all are added.
  bool Turned(const std::array<uint32_t, 3>& vertices);

 private:
  static constexpr size_t kBytesEach = 32;
  static constexpr size_t kFew = 1 << 16;
  struct Member {
    uint64_t key = 0;
    bool one_sided = false;  // of a sheet's first member
  };
  uint32_t NumberOf(uint64_t key);
  void Join(const SheetTurn& turn);

  const size_t most_;
  std::mutex mutex_;
  std::vector<Member> members_;
  ParitySets sets_;              // of their numbers
  OpenTable<uint32_t> numbers_;  // by keys
  bool too_many_ = false;
};

}  // namespace mtdb::internal
