// SPDX-License-Identifier: Apache-2.0
#include "store/records/index_codec.h"

#include <algorithm>
#include <vector>

#include "store/records/index_row.h"

namespace mtdb::internal {
namespace {

constexpr uint8_t kBeginsValue = 0x02;

// The least bytes of a row: a hostile count is found before memory is taken for it.
constexpr size_t kMinRowBytes = 25;

// Where payloads lie, row after row.
class LocationReader {
 public:
  explicit LocationReader(RowReader* r) : r_(*r) {
    begun_ = r_.Get32("number of values");
    end_ = r_.Get64();
    if (end_ > kNone32) r_.Fail("offset in the value", end_);
  }

  PayloadLocation Get(bool begins_value) {
    const uint32_t length = r_.GetLength();
    if (begins_value) {
      if (begun_ == kNone32) r_.Fail("number of values", begun_);
      ++begun_;
      end_ = 0;
    } else if (begun_ == 0 || end_ == 0) {
      r_.Fail("offset of a payload that begins no value", end_);
    }
    PayloadLocation location;
    location.value = begun_ - 1;
    location.offset = static_cast<uint32_t>(end_);
    location.length = length;
    location.checksum = r_.GetChecksum();
    end_ += length;
    if (end_ > kNone32) r_.Fail("end of the payload", end_);
    return location;
  }

 private:
  RowReader& r_;
  uint32_t begun_ = 0;  // values that begin before the next row
  uint64_t end_ = 0;    // of the payload before, in its value
};

void DecodeRow(RowReader* r, LocationReader* locations, UnitEntry* previous, ClusterIndex* index) {
  uint8_t flags = 0;
  const UnitEntry e = r->GetEntry(kBeginsValue, *previous, &flags);
  if (e.round < kRootRound && index->root_piece_count() > 0) r->Fail("round", e.round);
  const PayloadLocation location = locations->Get((flags & kBeginsValue) != 0);
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
  previous.bounds.min = Vec3i{};
  for (UnitId i = first; i < first + count; ++i) {
    const PayloadLocation& location = index.location(i);
    const UnitEntry& e = index.unit(i);
    PutRowEntry(location.offset == 0 ? kBeginsValue : 0, e, previous, &w);
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
  LocationReader locations(&r);
  if (r.remaining() / kMinRowBytes < count) r.Fail("number of rows", count);
  UnitEntry previous;
  for (uint32_t i = 0; i < count && r.ok(); ++i) DecodeRow(&r, &locations, &previous, index);
  return r.Finish();
}

}  // namespace mtdb::internal
