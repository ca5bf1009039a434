// SPDX-License-Identifier: Apache-2.0
#include "store/records/index_row.h"

#include <limits>

namespace mtdb::internal {

void PutBounds(const Box3i& bounds, const Vec3i& previous_min, ByteWriter* w) {
  for (int i = 0; i < 3; ++i) {
    w->PutSignedVarint(int64_t{bounds.min[i]} - previous_min[i]);
  }
  for (int i = 0; i < 3; ++i) {
    w->PutVarint(static_cast<uint64_t>(int64_t{bounds.max[i]} - bounds.min[i]));
  }
}

void PutChildren(std::span<const UnitId> children, uint32_t below, ByteWriter* w) {
  w->PutVarint(children.size());
  uint32_t next = below;
  for (size_t i = children.size(); i-- > 0;) {
    w->PutVarint(next - children[i] - 1);
    next = children[i];
  }
}

void PutRowEntry(uint8_t flags, const UnitEntry& entry, const UnitEntry& previous, ByteWriter* w) {
  w->Put(static_cast<uint8_t>(flags | (entry.explicit_arcs ? kExplicitArcs : 0)));
  w->Put(entry.round);
  w->PutVarint(entry.round == previous.round ? entry.hilbert - previous.hilbert : entry.hilbert);
  PutBounds(entry.bounds, previous.bounds.min, w);
  w->PutVarint(entry.nodes);
  w->PutVarint(entry.in_triangles);
  w->PutVarint(entry.out_triangles);
  w->PutVarint(entry.external_vertices);
  w->Put(entry.error_code_min);
  w->Put(entry.error_code_max);
}

Status RowReader::Finish() {
  if (status_.ok() && (r_.failed() || r_.remaining() != 0)) {
    status_ = Corrupt(where_ + ": expected whole rows and nothing after them, found " +
                      std::to_string(r_.remaining()) + " bytes after byte " +
                      std::to_string(r_.position()));
  }
  return status_;
}

void RowReader::Fail(const std::string& what, uint64_t found) {
  if (!ok()) return;
  status_ = Corrupt(where_ + ": byte " + std::to_string(r_.position()) + ": " + what + ": " +
                    std::to_string(found) + " is not possible");
}

uint32_t RowReader::Get32(const char* what) {
  const uint64_t v = r_.GetVarint();
  if (v > std::numeric_limits<uint32_t>::max()) {
    Fail(what, v);
    return 0;
  }
  return static_cast<uint32_t>(v);
}

uint32_t RowReader::GetLength() {
  const uint32_t length = Get32("length of the payload");
  if (length == 0) Fail("length of the payload", 0);
  return length;
}

Box3i RowReader::GetBounds() {
  Box3i bounds;
  for (int i = 0; i < 3; ++i) {
    const int64_t delta = r_.GetSignedVarint();
    constexpr int64_t kSpan = int64_t{1} << 33;
    const int64_t v = delta > -kSpan && delta < kSpan ? previous_min_[i] + delta : kSpan;
    if (v < std::numeric_limits<int32_t>::min() || v > std::numeric_limits<int32_t>::max()) {
      Fail("bounds", static_cast<uint64_t>(delta));
      return {};
    }
    bounds.min[i] = static_cast<int32_t>(v);
  }
  for (int i = 0; i < 3; ++i) {
    const int64_t extent = Get32("extent of the bounds");
    if (bounds.min[i] + extent > std::numeric_limits<int32_t>::max()) {
      Fail("bounds", static_cast<uint64_t>(extent));
      return {};
    }
    bounds.max[i] = static_cast<int32_t>(bounds.min[i] + extent);
  }
  previous_min_ = bounds.min;
  return bounds;
}

void RowReader::GetCodes(uint8_t* smallest, uint8_t* largest) {
  *smallest = r_.Get<uint8_t>();
  *largest = r_.Get<uint8_t>();
  if (*smallest > *largest) Fail("smallest error code", *smallest);
}

UnitEntry RowReader::GetEntry(uint8_t allowed, const UnitEntry& previous, uint8_t* flags) {
  UnitEntry e;
  *flags = r_.Get<uint8_t>();
  if ((*flags & ~(kExplicitArcs | allowed)) != 0) Fail("flags", *flags);
  e.explicit_arcs = (*flags & kExplicitArcs) != 0;
  e.round = r_.Get<uint8_t>();
  if (e.round == 0 || e.round < previous.round) Fail("round", e.round);
  const uint64_t hilbert = r_.GetVarint();
  e.hilbert = e.round == previous.round ? previous.hilbert + hilbert : hilbert;
  if (e.hilbert < hilbert) Fail("hilbert code", hilbert);
  e.bounds = GetBounds();
  e.nodes = Get32("nodes");
  if ((e.nodes == 0) != (e.round == kRootRound)) Fail("nodes", e.nodes);
  e.in_triangles = Get32("in-triangles");
  e.out_triangles = Get32("out-triangles");
  e.external_vertices = Get32("external vertices");
  GetCodes(&e.error_code_min, &e.error_code_max);
  if (e.nodes == 0) {
    if (e.in_triangles != 0) Fail("in-triangles", e.in_triangles);
    if (e.explicit_arcs) Fail("flags", *flags);
    if (e.error_code_max != 0) Fail("largest error code", e.error_code_max);
  }
  return e;
}

const std::vector<UnitId>& RowReader::GetChildren(uint32_t below) {
  const uint64_t count = r_.GetVarint();
  units_.clear();
  if (count > r_.remaining()) {
    Fail("number of children", count);
    return units_;
  }
  units_.resize(count);
  uint64_t next = below;
  for (uint64_t i = count; i-- > 0;) {
    const uint64_t gap = r_.GetVarint();
    if (gap >= next) {
      Fail("child", gap);
      units_.clear();
      return units_;
    }
    next -= gap + 1;
    units_[i] = static_cast<UnitId>(next);
  }
  return units_;
}

const std::vector<UnitId>& RowReader::GetParents(UnitId unit, uint32_t end) {
  const uint64_t count = r_.GetVarint();
  units_.clear();
  if (count > r_.remaining()) {
    Fail("number of parents", count);
    return units_;
  }
  units_.resize(count);
  uint64_t next = uint64_t{unit} + 1;
  for (UnitId& parent : units_) {
    const uint64_t gap = r_.GetVarint();
    if (next + gap >= end || next + gap < next) {
      Fail("parent", gap);
      units_.clear();
      return units_;
    }
    parent = static_cast<UnitId>(next + gap);
    next += gap + 1;
  }
  return units_;
}

}  // namespace mtdb::internal
