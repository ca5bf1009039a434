#include "store/internal/index_codec.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace mtdb::internal {
namespace {

constexpr uint8_t kExplicitArcs = 0x01;
constexpr uint8_t kBeginsValue = 0x02;

// The least bytes of a row: a hostile count is found before memory is taken for it.
constexpr size_t kMinRowBytes = 25;

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

// Reads rows; the first violation is kept and ends the reading.
class RowReader {
 public:
  RowReader(ByteSpan body, const std::string& where) : r_(body), where_(where) {
    begun_ = Get32("number of values");
    end_ = r_.GetVarint();
    if (end_ > kNone32) Fail("offset in the value", end_);
  }

  bool ok() const { return status_.ok() && !r_.failed(); }
  size_t remaining() const { return r_.remaining(); }

  Status Finish() {
    if (status_.ok() && (r_.failed() || r_.remaining() != 0)) {
      status_ = Corrupt(where_ + ": expected whole rows and nothing after them, found " +
                        std::to_string(r_.remaining()) + " bytes after byte " +
                        std::to_string(r_.position()));
    }
    return status_;
  }

  void Fail(const std::string& what, uint64_t found) {
    if (!ok()) return;
    status_ = Corrupt(where_ + ": byte " + std::to_string(r_.position()) + ": " + what + ": " +
                      std::to_string(found) + " is not possible");
  }

  uint8_t Get8() { return r_.Get<uint8_t>(); }
  uint64_t Get64() { return r_.GetVarint(); }
  uint32_t Get32(const char* what) {
    const uint64_t v = r_.GetVarint();
    if (v > std::numeric_limits<uint32_t>::max()) {
      Fail(what, v);
      return 0;
    }
    return static_cast<uint32_t>(v);
  }

  Box3i GetBounds() {
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

  PayloadLocation GetLocation(bool begins_value) {
    const uint32_t length = Get32("length of the payload");
    if (length == 0) Fail("length of the payload", 0);
    if (begins_value) {
      if (begun_ == kNone32) Fail("number of values", begun_);
      ++begun_;
      end_ = 0;
    } else if (begun_ == 0 || end_ == 0) {
      Fail("offset of a payload that begins no value", end_);
    }
    PayloadLocation location;
    location.value = begun_ - 1;
    location.offset = static_cast<uint32_t>(end_);
    location.length = length;
    location.checksum = r_.Get<uint64_t>();
    end_ += length;
    if (end_ > kNone32) Fail("end of the payload", end_);
    return location;
  }

  const std::vector<UnitId>& GetChildren(uint32_t below) {
    const uint64_t count = r_.GetVarint();
    children_.clear();
    if (count > r_.remaining()) {
      Fail("number of children", count);
      return children_;
    }
    children_.resize(count);
    uint64_t next = below;
    for (uint64_t i = count; i-- > 0;) {
      const uint64_t gap = r_.GetVarint();
      if (gap >= next) {
        Fail("child", gap);
        children_.clear();
        return children_;
      }
      next -= gap + 1;
      children_[i] = static_cast<UnitId>(next);
    }
    return children_;
  }

 private:
  ByteReader r_;
  const std::string& where_;
  Status status_;
  Vec3i previous_min_;
  uint32_t begun_ = 0;  // values that begin before the next row
  uint64_t end_ = 0;    // of the payload before, in its value
  std::vector<UnitId> children_;
};

void DecodeRow(RowReader* r, UnitEntry* previous, ClusterIndex* index) {
  const uint8_t flags = r->Get8();
  if ((flags & ~(kExplicitArcs | kBeginsValue)) != 0) r->Fail("flags", flags);
  UnitEntry e;
  e.explicit_arcs = (flags & kExplicitArcs) != 0;
  e.round = r->Get8();
  if (e.round == 0 || e.round < previous->round) r->Fail("round", e.round);
  if (e.round < kRootRound && index->root_piece_count() > 0) r->Fail("round", e.round);
  const uint64_t hilbert = r->Get64();
  e.hilbert = e.round == previous->round ? previous->hilbert + hilbert : hilbert;
  if (e.hilbert < hilbert) r->Fail("hilbert code", hilbert);
  e.bounds = r->GetBounds();
  e.nodes = r->Get32("nodes");
  if ((e.nodes == 0) != (e.round == kRootRound)) r->Fail("nodes", e.nodes);
  e.in_triangles = r->Get32("in-triangles");
  e.out_triangles = r->Get32("out-triangles");
  e.external_vertices = r->Get32("external vertices");
  e.error_code_min = r->Get8();
  e.error_code_max = r->Get8();
  if (e.error_code_min > e.error_code_max) r->Fail("smallest error code", e.error_code_min);
  if (e.nodes == 0) {
    if (e.in_triangles != 0) r->Fail("in-triangles", e.in_triangles);
    if (e.explicit_arcs) r->Fail("flags", flags);
    if (e.error_code_max != 0) r->Fail("largest error code", e.error_code_max);
  }
  const PayloadLocation location = r->GetLocation((flags & kBeginsValue) != 0);
  const std::vector<UnitId>& children = r->GetChildren(index->cluster_count());
  if (!r->ok()) return;
  index->Add(e, location, children);
  *previous = e;
}

}  // namespace

Bytes EncodeIndexRows(const ClusterIndex& index, uint32_t first, uint32_t count) {
  ByteWriter w;
  if (count == 0) return w.Take();
  const PayloadLocation& start = index.location(first);
  w.PutVarint(start.offset == 0 ? start.value : uint64_t{start.value} + 1);
  w.PutVarint(start.offset);
  UnitEntry previous;
  Vec3i previous_min;
  for (UnitId i = first; i < first + count; ++i) {
    const PayloadLocation& location = index.location(i);
    const UnitEntry& e = index.unit(i);
    uint8_t flags = location.offset == 0 ? kBeginsValue : 0;
    if (e.explicit_arcs) flags |= kExplicitArcs;
    w.Put(flags);
    w.Put(e.round);
    w.PutVarint(e.round == previous.round ? e.hilbert - previous.hilbert : e.hilbert);
    PutBounds(e.bounds, previous_min, &w);
    previous_min = e.bounds.min;
    w.PutVarint(e.nodes);
    w.PutVarint(e.in_triangles);
    w.PutVarint(e.out_triangles);
    w.PutVarint(e.external_vertices);
    w.Put(e.error_code_min);
    w.Put(e.error_code_max);
    w.PutVarint(location.length);
    w.Put(location.checksum);
    PutChildren(index.children(i), std::min(i, index.cluster_count()), &w);
    previous = e;
  }
  return w.Take();
}

Status DecodeIndexRows(ByteSpan body, uint32_t count, const std::string& where,
                       ClusterIndex* index) {
  RowReader r(body, where);
  if (r.remaining() / kMinRowBytes < count) r.Fail("number of rows", count);
  UnitEntry previous;
  for (uint32_t i = 0; i < count && r.ok(); ++i) DecodeRow(&r, &previous, index);
  return r.Finish();
}

}  // namespace mtdb::internal
