// SPDX-License-Identifier: Apache-2.0
#include "tools/request/root_reason.h"

#include <algorithm>

namespace mtdb {

// The last round, which removed next to nothing, says why vertices stayed. It counts those that it
// never removes, where chains of creases end or meet, once for each of their fans; what vanished
// with time has left fewer of them than the input had.
RootReasons ReasonsOf(const ObjectRecord& record) {
  RootReasons r;
  uint64_t left = record.root_vertices;
  const auto take = [&](uint64_t count) {
    const uint64_t taken = std::min(count, left);
    left -= taken;
    return taken;
  };
  if (record.rounds.empty()) {
    r.nonmanifold = take(record.input.nonmanifold_vertices);
  } else {
    const RoundReport& last = record.rounds.back();
    r.topology = take(last.stuck_topology);
    r.degree = take(last.stuck_degree);
    r.nonmanifold = take(std::min(record.input.nonmanifold_vertices, last.locked_vertices));
    // Those on seams are counted once for each of their tiles, two at least.
    const uint64_t locked = last.locked_vertices - std::min(last.locked_vertices, r.nonmanifold);
    if (last.tiles > 1) r.seams = take(locked / 2);
  }
  r.bound = left;
  return r;
}

std::string RootReasonText(const ObjectRecord& record) {
  const RootReasons r = ReasonsOf(record);
  std::string text = "no coarser mesh is stored: of the " + std::to_string(record.root_vertices) +
                     " vertices of the coarsest one";
  const char* separator = ", ";
  const auto add = [&](uint64_t count, const std::string& one, const std::string& many) {
    if (count == 0) return;
    text += separator + std::to_string(count) + " " + (count == 1 ? one : many);
    separator = ", ";
  };
  add(r.nonmanifold, "is at a non-manifold place", "are at non-manifold places");
  add(r.topology, "holds a part or a border of the surface together",
      "hold a part or a border of the surface together");
  const std::string neighbours =
      " more than " + std::to_string(record.degree_limit) + " neighbours";
  add(r.degree, "has" + neighbours, "have" + neighbours);
  add(r.seams, "is on a seam of tiles", "are on seams of tiles");
  add(r.bound, "would cost more than the largest error that a step may have",
      "would cost more than the largest error that a step may have");
  return text;
}

}  // namespace mtdb
