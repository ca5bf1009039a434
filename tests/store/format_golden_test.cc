// SPDX-License-Identifier: Apache-2.0
// The worked example of store/FORMAT.md: the bytes that the code makes are the ones on the page.
#include <catch2/catch.hpp>
#include <sstream>

#include "store/lmdb/environment.h"
#include "store/pages/catalog_entry.h"
#include "store/records/index_codec.h"
#include "store/records/keys.h"
#include "store/records/page_parts.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

std::string Hex(ByteSpan bytes) {
  std::string text;
  for (size_t i = 0; i < bytes.size(); ++i) {
    static constexpr char kDigits[] = "0123456789abcdef";
    const auto b = static_cast<unsigned>(bytes[i]);
    if (i > 0) text += i % 16 == 0 ? "\n    " : " ";
    text += kDigits[b >> 4];
    text += kDigits[b & 15];
  }
  return "\n    " + text + "\n";
}

std::string FormatPage() {
  const Bytes bytes = ReadFile(std::string(MTDB_SOURCE_DIR) + "/store/FORMAT.md");
  return std::string(AsString(bytes));
}

struct Example {
  const char* what;
  Bytes bytes;
};

std::vector<Example> Examples() {
  std::vector<Example> all;
  const Bytes super_key = SuperblockKey();
  all.push_back({"superblock", SealValue(Table::kCatalog, super_key,
                                         EncodeSuperblock({2, uint64_t{1} << 40, 3}))});
  const Bytes building_key = BuildingKey(ObjectId{1});
  all.push_back({"building key", building_key});
  all.push_back({"building entry",
                 SealValue(Table::kCatalog, building_key, EncodePendingEntry({"bunny", 4711}))});
  all.push_back({"unit key", UnitKey(ObjectId{1}, 1, 5, 0)});
  const ByteSpan payload = AsBytes("mesh");

  ClusterIndex index;
  UnitEntry e;
  e.round = 1;
  e.hilbert = 5;
  e.bounds.Add(Vec3i{-1, 2, 300});
  e.bounds.Add(Vec3i{9, 2, 400});
  e.nodes = 3;
  e.in_triangles = 10;
  e.out_triangles = 16;
  e.external_vertices = 8;
  e.error_code_min = 7;
  e.error_code_max = 30;
  index.Add(e, {0, 0, 4, Hash64(payload, UnitSeed(0, 1, 5))}, {});
  e.hilbert = 6;
  e.explicit_arcs = true;
  index.Add(e, {0, 4, 4, Hash64(payload, UnitSeed(1, 1, 6))}, {});
  UnitEntry piece;
  piece.round = kRootRound;
  piece.bounds = e.bounds;
  piece.out_triangles = 12;
  piece.external_vertices = 8;
  const UnitId children[] = {0, 1};
  index.Add(piece, {0, 8, 4, Hash64(payload, UnitSeed(2, kRootRound, 0))}, children);
  const Bytes key = IndexKey(ObjectId{1}, 0);
  all.push_back({"index key", key});
  all.push_back({"index value", SealValue(Table::kIndex, key, EncodeIndexRows(index, 0, 3))});
  const Bytes texture_key = TextureKey(ObjectId{1}, 2, 0);
  all.push_back({"texture key", texture_key});
  all.push_back({"texture value", SealValue(Table::kTextures, texture_key, AsBytes("a picture"))});
  ObjectRecord record;
  record.id = ObjectId{1};
  record.name = std::string("bunny");
  record.bounds = {{0, 0, 0}, {1, 1, 1}};
  record.clusters = 2;
  record.nodes = 6;
  record.root_pieces = 1;
  record.root_vertices = 8;
  record.root_triangles = 12;
  record.rounds.resize(1);
  all.push_back({"object record", EncodeObjectRecord(record)});
  record.texture.emplace();
  record.texture->step = 0.5;
  record.texture->pages = {{"a.png", "image/png", 640, 480, 9, Hash64(AsBytes("a picture"))}};
  const Bytes textured = EncodeObjectRecord(record);
  // The last section: a tag, a length of one byte.
  const size_t section = 2 + 3 * 8 + 1 + 6 + 10 + 2 + 2 + 1 + 8 + 1 + 8;
  all.push_back({"texture of a record", Bytes(textured.end() - section, textured.end())});
  return all;
}

TEST_CASE("the format page shows the bytes that are written", "[store]") {
  const std::string page = FormatPage();
  REQUIRE(page.find("## Example") != std::string::npos);
  for (const Example& example : Examples()) {
    INFO(example.what << ":" << Hex(example.bytes));
    CHECK(page.find(Hex(example.bytes)) != std::string::npos);
  }
}

TEST_CASE("sizes and numbers of the format are pinned", "[store]") {
  CHECK(kSuperblockBytes == 48);
  CHECK(kUnitKeyBytes == UnitKey(ObjectId{1}, 1, 0, 0).size());
  CHECK(kIndexKeyBytes == IndexKey(ObjectId{1}, 0).size());
  CHECK(kTextureKeyBytes == TextureKey(ObjectId{1}, 0, 0).size());
  CHECK(OverflowPages(kChecksumBytes + kPagePartBytes, 4096) == 64);
  CHECK(OverflowPages(kChecksumBytes + kPagePartBytes + 1, 4096) == 65);
  CHECK(kStoreVersion == 1);
  CHECK(MaxNodeBytes(4096) == 2038);
  CHECK(OverflowPages(4080, 4096) == 1);
  CHECK(OverflowPages(4081, 4096) == 2);
  CHECK(MixAll(1, 2) == Mix64(Mix64(1) ^ 2));
  // The coarsest round comes first, whatever the curve says.
  CHECK(CompareKeys(KeyOrder::kBytes, UnitKey(ObjectId{1}, 3, ~uint64_t{0}, 0),
                    UnitKey(ObjectId{1}, 2, 0, 0)) < 0);
}

TEST_CASE("another version of the store is refused by name", "[store]") {
  Bytes body = EncodeSuperblock({2, 1 << 20, 3});
  CHECK(DecodeSuperblock(body, "s").ok());
  for (size_t size = 0; size < body.size(); ++size) {
    CHECK(!DecodeSuperblock(ByteSpan(body).first(size), "s").ok());
  }
  body[16] = std::byte{2};
  const auto later = DecodeSuperblock(body, "s");
  CHECK(later.status().code() == StatusCode::kUnsupported);
  CHECK(later.status().message().find("version 2") != std::string::npos);
  body[16] = std::byte{1};
  body[20] = std::byte{1};
  CHECK(DecodeSuperblock(body, "s").status().code() == StatusCode::kUnsupported);
}

}  // namespace
}  // namespace mtdb::test
