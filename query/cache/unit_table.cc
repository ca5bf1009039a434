// SPDX-License-Identifier: Apache-2.0
#include "query/cache/unit_table.h"

#include <algorithm>
#include <functional>
#include <unordered_map>

namespace mtdb::internal {

UnitTable::UnitTable(const ObjectRecord& record, const ClusterIndex& index, bool payloads_count,
                     ByteBudget& budget)
    : record_(record),
      index_(index),
      payloads_count_(payloads_count),
      budget_(budget),
      entries_(index.unit_count()) {}

void UnitTable::NoteSize(UnitId unit, size_t decoded_bytes) {
  Entry& entry = entries_[unit];
  entry.decoded_bytes = decoded_bytes;
  if (entry.overhead == 0) entry.overhead = LoadBytes(unit) - decoded_bytes;
}

// Six star triangles a node are usual.
size_t UnitTable::EstimateBytes(UnitId unit) const {
  const size_t row_bytes = record_.attributes.row_bytes();
  const UnitEntry& entry = index_.unit(unit);
  const size_t stars = size_t{6} * entry.nodes;
  const size_t listed = entry.nodes > 0 ? 0 : entry.out_triangles;
  const size_t slots = entry.in_triangles + stars + listed;
  const size_t corners = 3 * (entry.in_triangles + listed) + entry.nodes;
  return sizeof(LoadedUnit) + (record_.texture ? 12 * (slots + corners) : 0) +
         entry.in_triangles * size_t{16} + stars * size_t{6} + listed * size_t{9} +
         entry.nodes * (size_t{13} + row_bytes) +
         entry.external_vertices * (size_t{6} + sizeof(VertexIndex) + 4 + row_bytes);
}

// Some 60 bytes a node are usual.
size_t UnitTable::TypicalBytes() const {
  return sizeof(LoadedUnit) + (60 + (record_.texture ? 120 : 0) + record_.attributes.row_bytes()) *
                                  (record_.nodes / std::max(1u, record_.clusters));
}

size_t UnitTable::LargestEstimate() const {
  size_t largest = 0;
  for (UnitId u = 0; u < size(); ++u) {
    if (index_.Has(u)) largest = std::max(largest, EstimateBytes(u));
  }
  return largest;
}

size_t UnitTable::LoadBytes(UnitId unit) const {
  std::vector<UnitId> order{unit};
  std::unordered_map<UnitId, uint32_t> users;  // units of `order` that a unit is a parent of
  for (size_t i = 0; i < order.size(); ++i) {
    for (const UnitId p : index_.parents(order[i])) {
      if (users[p]++ == 0) order.push_back(p);
    }
  }
  std::ranges::sort(order, std::greater<>());
  size_t held = 0, most = 0;
  for (const UnitId u : order) {
    const size_t bytes = entries_[u].decoded_bytes;
    const size_t payload = payloads_count_ ? index_.location(u).length : 0;
    most = std::max(most, held + payload + std::max(bytes, EstimateBytes(u)));
    held += bytes;
    for (const UnitId p : index_.parents(u)) {
      if (--users[p] == 0) held -= entries_[p].decoded_bytes;
    }
  }
  return most;
}

}  // namespace mtdb::internal
