#include "store/cluster_index.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <set>

#include "store/internal/index_codec.h"
#include "store/internal/value_packing.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {
namespace {

ClusterIndex MakeIndex(const SyntheticObject& object) {
  ClusterIndex index;
  uint32_t value = 0;
  uint32_t offset = 0;
  for (size_t i = 0; i < object.clusters.size(); ++i) {
    const auto& c = object.clusters[i];
    if (i > 0 && (i % 5 == 0 || c.entry.round != object.clusters[i - 1].entry.round)) {
      ++value;
      offset = 0;
    }
    const auto length = static_cast<uint32_t>(c.payload.size());
    index.AddCluster(c.entry, {value, offset, length, Hash64(c.payload)}, c.children);
    offset += length;
  }
  value = offset = 0;
  for (const auto& p : object.pieces) {
    const auto length = static_cast<uint32_t>(p.payload.size());
    index.AddRootPiece(p.entry, {value, offset, length, Hash64(p.payload)}, p.children);
    offset += length;
  }
  index.Finish(object.record.root_vertices);
  return index;
}

TEST_CASE("the index derives parents and vertex numbers", "[store]") {
  const SyntheticObject object = MakeObject({.seed = 11, .clusters = 200});
  const ClusterIndex index = MakeIndex(object);
  std::vector<std::set<uint32_t>> parents(object.clusters.size());
  std::vector<std::set<uint32_t>> root_parents(object.clusters.size());
  for (uint32_t p = 0; p < object.clusters.size(); ++p) {
    for (const ClusterId c : object.clusters[p].children) parents[c.value].insert(p);
  }
  for (uint32_t p = 0; p < object.pieces.size(); ++p) {
    for (const ClusterId c : object.pieces[p].children) root_parents[c.value].insert(p);
  }
  VertexIndex next = object.record.root_vertices;
  for (uint32_t i = 0; i < index.cluster_count(); ++i) {
    const ClusterId id{i};
    CHECK(index.first_vertex(id) == next);
    next += index.cluster(id).nodes;
    const auto same = [](const auto& found, const std::set<uint32_t>& expected) {
      return std::ranges::equal(found, expected, {}, [](auto x) { return x.value; });
    };
    CHECK(same(index.parents(id), parents[i]));
    CHECK(same(index.root_parents(id), root_parents[i]));
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
    for (const IndexKind kind : {IndexKind::kClusters, IndexKind::kRootPieces}) {
      const uint32_t rows =
          kind == IndexKind::kClusters ? index.cluster_count() : index.root_piece_count();
      for (uint32_t first = 0; first < rows; first += per_value) {
        const uint32_t count = std::min(per_value, rows - first);
        const Bytes body = EncodeIndexRows(index, kind, first, count);
        REQUIRE(DecodeIndexRows(body, kind, count, where, &decoded).message() == "");
        for (size_t size = 0; size < body.size(); size += 1 + size / 50) {
          ClusterIndex scratch = decoded;
          REQUIRE(
              DecodeIndexRows(ByteSpan(body).first(size), kind, count, where, &scratch).code() ==
              StatusCode::kCorrupt);
        }
      }
    }
    decoded.Finish(object.record.root_vertices);
    for (uint32_t i = 0; i < index.cluster_count(); ++i) {
      const ClusterId id{i};
      REQUIRE(decoded.cluster(id) == index.cluster(id));
      REQUIRE(decoded.location(id) == index.location(id));
      REQUIRE(std::ranges::equal(decoded.children(id), index.children(id)));
    }
    for (uint32_t i = 0; i < index.root_piece_count(); ++i) {
      const RootPieceId id{i};
      REQUIRE(decoded.root_piece(id) == index.root_piece(id));
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
  CHECK(DecodeIndexRows(small, IndexKind::kClusters, 500000000, where, &index).code() ==
        StatusCode::kCorrupt);
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
  CHECK(DecodeIndexRows(empty.bytes(), IndexKind::kClusters, 1, where, &none).code() ==
        StatusCode::kCorrupt);
  w.PutVarint(10);
  w.Put(uint64_t{0});  // checksum
  ByteWriter good = w;
  good.PutVarint(0);
  CHECK(DecodeIndexRows(good.bytes(), IndexKind::kClusters, 1, where, &index).message() == "");
  w.PutVarint(uint64_t{1} << 60);
  ClusterIndex other;
  CHECK(DecodeIndexRows(w.bytes(), IndexKind::kClusters, 1, where, &other).code() ==
        StatusCode::kCorrupt);
  // Random changes: an error, or rows that encode to rows that decode alike.
  const SyntheticObject object = MakeObject({.seed = 13, .clusters = 60});
  const ClusterIndex whole = MakeIndex(object);
  const Bytes body = EncodeIndexRows(whole, IndexKind::kClusters, 0, whole.cluster_count());
  std::mt19937_64 random(8);
  for (int i = 0; i < 5000; ++i) {
    Bytes changed = body;
    changed[random() % changed.size()] = static_cast<std::byte>(random());
    ClusterIndex scratch;
    const Status status =
        DecodeIndexRows(changed, IndexKind::kClusters, whole.cluster_count(), where, &scratch);
    if (status.ok()) REQUIRE(scratch.cluster_count() == whole.cluster_count());
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
