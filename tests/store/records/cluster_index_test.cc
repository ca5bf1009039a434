// SPDX-License-Identifier: Apache-2.0
#include "store/cluster_index.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <set>

#include "store/records/index_codec.h"
#include "store/records/value_packing.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

ClusterIndex MakeIndex(const SyntheticObject& object) {
  ClusterIndex index;
  uint32_t value = 0;
  uint32_t offset = 0;
  for (size_t i = 0; i < object.units.size(); ++i) {
    const auto& u = object.units[i];
    if (i > 0 && (i % 5 == 0 || u.entry.round != object.units[i - 1].entry.round)) {
      ++value;
      offset = 0;
    }
    const auto length = static_cast<uint32_t>(u.payload.size());
    index.Add(u.entry, {value, offset, length, Hash64(u.payload)}, u.children);
    offset += length;
  }
  index.Finish(object.record.root_vertices);
  return index;
}

TEST_CASE("the index derives parents and vertex numbers", "[store]") {
  const SyntheticObject object = MakeObject({.seed = 11, .clusters = 200});
  const ClusterIndex index = MakeIndex(object);
  CHECK(index.cluster_count() == object.record.clusters);
  CHECK(index.root_piece_count() == object.record.root_pieces);
  std::vector<std::set<UnitId>> parents(object.units.size());
  for (UnitId p = 0; p < object.units.size(); ++p) {
    for (const UnitId c : object.units[p].children) parents[c].insert(p);
  }
  VertexIndex next = object.record.root_vertices;
  for (UnitId id = 0; id < index.unit_count(); ++id) {
    CHECK(index.first_vertex(id) == next);
    next += index.unit(id).nodes;
    CHECK(std::ranges::equal(index.parents(id), parents[id]));
  }
  CHECK(next == object.record.vertices);
}

TEST_CASE("an empty index is an index", "[store]") {
  ClusterIndex index;
  index.Finish(3);
  CHECK(index.cluster_count() == 0);
  CHECK(index.root_piece_count() == 0);
  CHECK(index.root_vertices() == 3);
}

TEST_CASE("index rows come back from their bytes; every prefix fails", "[store]") {
  const SyntheticObject object = MakeObject({.seed = 12, .clusters = 150});
  const ClusterIndex index = MakeIndex(object);
  const std::string where = "i";
  for (const uint32_t per_value : {7u, 512u}) {
    ClusterIndex decoded;
    const uint32_t rows = index.unit_count();
    for (uint32_t first = 0; first < rows; first += per_value) {
      const uint32_t count = std::min(per_value, rows - first);
      const Bytes body = EncodeIndexRows(index, first, count);
      REQUIRE(DecodeIndexRows(body, count, where, &decoded).message() == "");
      for (size_t size = 0; size < body.size(); size += 1 + size / 50) {
        ClusterIndex scratch = decoded;
        REQUIRE(DecodeIndexRows(ByteSpan(body).first(size), count, where, &scratch).code() ==
                StatusCode::kCorrupt);
      }
    }
    decoded.Finish(object.record.root_vertices);
    REQUIRE(decoded.cluster_count() == index.cluster_count());
    for (UnitId id = 0; id < index.unit_count(); ++id) {
      REQUIRE(decoded.unit(id) == index.unit(id));
      REQUIRE(decoded.location(id) == index.location(id));
      REQUIRE(std::ranges::equal(decoded.children(id), index.children(id)));
    }
  }
}

TEST_CASE("hostile index rows are refused", "[store]") {
  const std::string where = "i";
  ClusterIndex index;
  // A count of rows that the bytes cannot hold.
  Bytes small(40, std::byte{0});
  CHECK(DecodeIndexRows(small, 500000000, where, &index).code() == StatusCode::kCorrupt);
  CHECK(index.cluster_count() == 0);
  // A count of children that the bytes cannot hold.
  ByteWriter w;
  w.PutVarint(0);
  w.PutVarint(0);
  w.Put(uint8_t{2});  // begins a value
  w.Put(uint8_t{1});  // round
  w.PutVarint(0);
  for (int i = 0; i < 6; ++i) w.PutVarint(0);
  for (int i = 0; i < 4; ++i) w.PutVarint(1);
  w.Put(uint8_t{0});
  w.Put(uint8_t{0});
  ByteWriter empty = w;
  empty.PutVarint(0);  // a payload of no bytes
  empty.Put(uint64_t{0});
  empty.PutVarint(0);
  ClusterIndex none;
  CHECK(DecodeIndexRows(empty.bytes(), 1, where, &none).code() == StatusCode::kCorrupt);
  w.PutVarint(10);
  w.Put(uint64_t{0});  // checksum
  ByteWriter good = w;
  good.PutVarint(0);
  CHECK(DecodeIndexRows(good.bytes(), 1, where, &index).message() == "");
  w.PutVarint(uint64_t{1} << 60);
  ClusterIndex other;
  CHECK(DecodeIndexRows(w.bytes(), 1, where, &other).code() == StatusCode::kCorrupt);
  // What has a cluster's nodes and the root's round, or is after the root, or errors without nodes.
  const auto row = [&](uint8_t flags, uint8_t round, uint32_t nodes, uint32_t in, uint8_t code) {
    ByteWriter one;
    one.Put(flags);
    one.Put(round);
    for (int i = 0; i < 7; ++i) one.PutVarint(0);
    for (const uint32_t n : {nodes, in, 1u, 1u}) one.PutVarint(n);
    one.Put(uint8_t{0});
    one.Put(code);
    one.PutVarint(10);
    one.Put(uint64_t{0});
    one.PutVarint(0);
    return one.Take();
  };
  const auto decode = [&](const std::vector<Bytes>& rows) {
    ByteWriter body;
    body.PutVarint(0);
    body.PutVarint(0);
    for (const Bytes& r : rows) body.PutBytes(r);
    ClusterIndex fresh;
    return DecodeIndexRows(body.bytes(), static_cast<uint32_t>(rows.size()), where, &fresh).code();
  };
  CHECK(decode({row(2, 1, 5, 1, 9), row(2, kRootRound, 0, 0, 0)}) == StatusCode::kOk);
  CHECK(decode({row(2, kRootRound, 5, 0, 0)}) == StatusCode::kCorrupt);
  CHECK(decode({row(2, kRootRound, 0, 1, 0)}) == StatusCode::kCorrupt);
  CHECK(decode({row(2, kRootRound, 0, 0, 1)}) == StatusCode::kCorrupt);
  CHECK(decode({row(3, kRootRound, 0, 0, 0)}) == StatusCode::kCorrupt);
  CHECK(decode({row(2, 1, 0, 0, 0)}) == StatusCode::kCorrupt);
  CHECK(decode({row(2, kRootRound, 0, 0, 0), row(2, 1, 5, 1, 9)}) == StatusCode::kCorrupt);
  // Random changes: an error, or rows that encode to rows that decode alike.
  const SyntheticObject object = MakeObject({.seed = 13, .clusters = 60});
  const ClusterIndex whole = MakeIndex(object);
  const Bytes body = EncodeIndexRows(whole, 0, whole.unit_count());
  std::mt19937_64 random(8);
  for (int i = 0; i < 5000; ++i) {
    Bytes changed = body;
    changed[random() % changed.size()] = static_cast<std::byte>(random());
    ClusterIndex scratch;
    const Status status = DecodeIndexRows(changed, whole.unit_count(), where, &scratch);
    if (status.ok()) REQUIRE(scratch.unit_count() == whole.unit_count());
  }
}

TEST_CASE("values are cut where little of their pages is wasted", "[store]") {
  std::mt19937_64 random(1);
  std::vector<uint64_t> waiting;
  uint64_t bytes = 0;
  uint64_t pages = 0;
  for (int i = 0; i < 5000; ++i) {
    waiting.push_back(8000 + random() % 12000);
    while (const size_t count = PayloadsOfNextValue(waiting, i == 4999)) {
      uint64_t size = 0;
      for (size_t k = 0; k < count; ++k) size += waiting[k];
      if (i < 4999) CHECK(size >= kMinValueBytes);
      CHECK(size <= kMaxValueBytes);
      bytes += size;
      pages += (16 + size + 4095) / 4096;
      waiting.erase(waiting.begin(), waiting.begin() + static_cast<ptrdiff_t>(count));
    }
  }
  CHECK(waiting.empty());
  const double waste = 1 - static_cast<double>(bytes) / (static_cast<double>(pages) * 4096);
  CHECK(waste < 0.015);
  CHECK(PayloadsOfNextValue(std::vector<uint64_t>{500000}, false) == 1);
  CHECK(PayloadsOfNextValue(std::vector<uint64_t>{10, 500000}, false) == 1);
  CHECK(PayloadsOfNextValue(std::vector<uint64_t>{10, 20}, false) == 0);
  CHECK(PayloadsOfNextValue(std::vector<uint64_t>{10, 20}, true) == 2);
  CHECK(PayloadsOfNextValue({}, true) == 0);
}

}  // namespace
}  // namespace mtdb::test
