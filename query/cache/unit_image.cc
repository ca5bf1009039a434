// SPDX-License-Identifier: Apache-2.0
#include "query/cache/unit_image.h"

#include <cstring>
#include <type_traits>

#include "store/base/hash.h"

namespace mtdb::internal {
namespace {

// Calls f(array) for each array of the unit.
template <typename Unit, typename F>
void ForEachArray(Unit& unit, F&& f) {
  auto& cluster = unit.cluster;
  f(cluster.triangles);
  f(cluster.positions.parts().near);
  f(cluster.positions.parts().far);
  f(cluster.vertices);
  f(cluster.rows);
  f(cluster.error_codes);
  f(cluster.ring_begin);
  f(cluster.ring_vertices);
  f(cluster.star_begin);
  f(cluster.hole_begin);
  f(cluster.hole_slots);
  f(cluster.removers.codes());
  f(cluster.children);
  f(cluster.explicit_arcs);
  f(cluster.vertex_begin);
  f(cluster.created_corners);
  f(cluster.fans);
  f(cluster.later_fans);
  f(cluster.mirrors);
  f(cluster.corners);
  f(cluster.corner_places);
  f(unit.parents);
  f(unit.origins);
  f(unit.by_origin);
  f(unit.owners);
  f(unit.drain);
  f(unit.creators);
  f(unit.out_begin);
  f(unit.out_slots);
}

struct Head {
  uint64_t checksum = 0;  // of all that follows it
  UnitId id = 0;
  uint32_t first_own_slot = 0;
  Vec3i base{};  // of the positions
  uint32_t unused = 0;
};

template <typename Array>
using ElementOf = typename std::remove_cvref_t<Array>::value_type;

}  // namespace

// Head, the arrays' lengths, the arrays.
Bytes MakeUnitImage(const LoadedUnit& unit) {
  size_t size = sizeof(Head);
  ForEachArray(unit, [&](const auto& array) {
    static_assert(std::is_trivially_copyable_v<ElementOf<decltype(array)>>);
    size += sizeof(uint64_t) + array.size() * sizeof(ElementOf<decltype(array)>);
  });
  Bytes image(size);
  std::byte* at = image.data() + sizeof(Head);
  const auto put = [&](const void* bytes, size_t count) {
    if (count > 0) std::memcpy(at, bytes, count);
    at += count;
  };
  ForEachArray(unit, [&](const auto& array) {
    const uint64_t count = array.size();
    put(&count, sizeof(count));
  });
  ForEachArray(unit, [&](const auto& array) {
    put(array.data(), array.size() * sizeof(ElementOf<decltype(array)>));
  });
  Head head{0, unit.id, unit.cluster.first_own_slot, unit.cluster.positions.parts().base, 0};
  std::memcpy(image.data(), &head, sizeof(head));
  head.checksum = Hash64(ByteSpan(image).subspan(sizeof(head.checksum)));
  std::memcpy(image.data(), &head.checksum, sizeof(head.checksum));
  return image;
}

LoadedUnitPtr UnitFromImage(ByteSpan image) {
  Head head;
  if (image.size() < sizeof(head)) return nullptr;
  std::memcpy(&head, image.data(), sizeof(head));
  if (Hash64(image.subspan(sizeof(head.checksum))) != head.checksum) return nullptr;
  const auto unit = std::make_shared<LoadedUnit>();
  unit->id = head.id;
  unit->cluster.first_own_slot = head.first_own_slot;
  unit->cluster.positions.parts().base = head.base;
  const std::byte* lengths = image.data() + sizeof(head);
  const std::byte* at = lengths;
  ForEachArray(*unit, [&](const auto&) { at += sizeof(uint64_t); });
  ForEachArray(*unit, [&](auto& array) {
    using Element = ElementOf<decltype(array)>;
    uint64_t count = 0;
    std::memcpy(&count, lengths, sizeof(count));
    lengths += sizeof(count);
    array.resize(count);
    if (count > 0) std::memcpy(array.data(), at, count * sizeof(Element));
    at += count * sizeof(Element);
  });
  return unit;
}

}  // namespace mtdb::internal
