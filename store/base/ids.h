// SPDX-License-Identifier: Apache-2.0
// Identifiers that do not convert into each other, and the numbers that several layers share.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace mtdb {

// An integer with a meaning. Explicit both ways: ObjectId{3}, id.value.
template <typename Tag, typename Rep>
struct StrongId {
  using RepType = Rep;
  Rep value = 0;
  constexpr StrongId() = default;
  constexpr explicit StrongId(Rep v) : value(v) {}
  friend constexpr auto operator<=>(StrongId, StrongId) = default;
};

// An object of a store. Never reused within a store.
using ObjectId = StrongId<struct ObjectTag, uint64_t>;
// A unit of an object: a cluster, or a piece of the root mesh, which is a cluster without nodes and
// in-triangles. Units are numbered from 0 in the order in which the builder makes them, finest
// round first and the root last, so that a parent has a larger id than its child.
using UnitId = uint32_t;
// A node (update) within its cluster.
using NodeIndex = uint32_t;
// A vertex of an object: root vertices first, then cluster after cluster, node after node.
using VertexIndex = uint64_t;

inline constexpr uint32_t kNone32 = 0xffffffffu;

}  // namespace mtdb

template <typename Tag, typename Rep>
struct std::hash<mtdb::StrongId<Tag, Rep>> {
  size_t operator()(mtdb::StrongId<Tag, Rep> id) const noexcept {
    return std::hash<Rep>{}(id.value);
  }
};
