// SPDX-License-Identifier: Apache-2.0
#include "store/object_record.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "store/texture_pages.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {
namespace {

ObjectRecord FullRecord() {
  ObjectRecord o = MakeObject({.seed = 4, .clusters = 300}).record;
  o.id = ObjectId{77};
  o.name = std::string("Lucy \xc3\xa9");
  o.grid.mode = PositionMode::kLossless;
  o.grid.origin = {1.5, -2e300, 3e-300};
  o.grid.step = 0.125;
  o.grid.error_unit = 1e-6;
  o.bits = 32;
  o.error_measure = ErrorMeasure::kVertical;
  o.attributes.attributes = {{"id", ScalarType::kUint32},
                             {"nx", ScalarType::kFloat32, 0, 10},
                             {"ny", ScalarType::kFloat32},
                             {"nz", ScalarType::kFloat32},
                             {"quality", ScalarType::kFloat64, 0.001}};
  o.double_positions = true;
  o.rounding_error = 0.0625;
  o.georeference = std::string("EPSG:25832");
  o.up = {{0.6, 0, -0.8}, true};
  o.input = {1, 2, 3, 4, 5, 6, ~uint64_t{0}, 7, 8, 9, 10};
  o.triangles = uint64_t{1} << 40;
  o.components = 3;
  o.boundary_edges = 100;
  o.boundary_loops = 2;
  o.euler_characteristic = -1234567890123;
  o.depth = 82;
  o.max_degree = 12;
  o.error_code_max = 200;
  o.degree_limit = 12;
  o.tile_triangles = 8192;
  o.surface_digest = 0x1122334455667788;
  o.border_digest = 0x99aabbccddeeff00;
  o.payload_bytes = 1 << 20;
  o.stored_bytes = 1 << 21;
  o.digest_low = 0x0123456789abcdef;
  o.digest_high = 0xfedcba9876543210;
  return o;
}

ObjectRecord RasterRecord() {
  ObjectRecord o = FullRecord();
  RasterFrame f;
  f.columns = 1201;
  f.rows = 2401;
  f.geotransform = {-120, 1.0 / 1200, 0, 39, 0, -1.0 / 1200};
  f.transform_of_samples = true;
  f.is_area = false;
  f.nodata = -32768;
  f.sample_type = "int16";
  f.height_units = "m";
  f.vertical_datum = "EGM96";
  f.filled = 300;
  o.raster = f;
  o.grid = GridOf(f, 0.5, 100);
  return o;
}

ObjectRecord TexturedRecord() {
  ObjectRecord o = FullRecord();
  TextureRecord& t = o.texture.emplace();
  t.step = 1.0 / 4096;
  t.scale = 12.5;
  t.rounding = 1.0 / 8192;
  t.pages = {{"atlas.jpg", "image/jpeg", 4096, 2048, kMostPageBytes, ~uint64_t{0}},
             {"caf\xc3\xa9 2.png", "", 0, 0, 0, 0}};
  return o;
}

TEST_CASE("a record comes back from its bytes, and the bytes from the record", "[store]") {
  for (const ObjectRecord& o : {FullRecord(), RasterRecord(), TexturedRecord(), [] {
                                  ObjectRecord least;
                                  least.id = ObjectId{1};
                                  least.name = std::string(500, 'n');
                                  return least;
                                }()}) {
    const Bytes bytes = EncodeObjectRecord(o);
    const auto decoded = DecodeObjectRecord(bytes, "r");
    REQUIRE(decoded.status().message() == "");
    CHECK(EncodeObjectRecord(*decoded) == bytes);
    CHECK(decoded->id == o.id);
    CHECK(decoded->name == o.name);
    CHECK(decoded->grid == o.grid);
    CHECK(decoded->bits == o.bits);
    CHECK(decoded->error_measure == o.error_measure);
    CHECK(decoded->attributes == o.attributes);
    CHECK(decoded->double_positions == o.double_positions);
    CHECK(decoded->rounding_error == o.rounding_error);
    CHECK(decoded->bounds == o.bounds);
    CHECK(decoded->units == o.units);
    CHECK(decoded->georeference == o.georeference);
    CHECK(decoded->raster == o.raster);
    CHECK(decoded->texture == o.texture);
    CHECK(decoded->up == o.up);
    CHECK(decoded->input == o.input);
    CHECK(decoded->vertices == o.vertices);
    CHECK(decoded->triangles == o.triangles);
    CHECK(decoded->components == o.components);
    CHECK(decoded->boundary_edges == o.boundary_edges);
    CHECK(decoded->boundary_loops == o.boundary_loops);
    CHECK(decoded->euler_characteristic == o.euler_characteristic);
    CHECK(decoded->nodes == o.nodes);
    CHECK(decoded->clusters == o.clusters);
    CHECK(decoded->root_pieces == o.root_pieces);
    CHECK(decoded->root_vertices == o.root_vertices);
    CHECK(decoded->root_triangles == o.root_triangles);
    CHECK(decoded->depth == o.depth);
    CHECK(decoded->max_degree == o.max_degree);
    CHECK(decoded->error_code_max == o.error_code_max);
    CHECK(decoded->rounds == o.rounds);
    CHECK(decoded->degree_limit == o.degree_limit);
    CHECK(decoded->tile_triangles == o.tile_triangles);
    CHECK(decoded->surface_digest == o.surface_digest);
    CHECK(decoded->border_digest == o.border_digest);
    CHECK(decoded->payload_bytes == o.payload_bytes);
    CHECK(decoded->stored_bytes == o.stored_bytes);
    CHECK(decoded->digest_hex() == o.digest_hex());
  }
  CHECK(FullRecord().digest_hex() == "fedcba98765432100123456789abcdef");
}

TEST_CASE("a record of a raster has a raster, and no other has", "[store]") {
  ObjectRecord o = RasterRecord();
  o.grid.mode = PositionMode::kGrid;
  CHECK(!DecodeObjectRecord(EncodeObjectRecord(o), "r").ok());
  o = RasterRecord();
  o.raster.reset();
  CHECK(!DecodeObjectRecord(EncodeObjectRecord(o), "r").ok());
  o = RasterRecord();
  o.grid.plane = {1, 2, 2, 4};
  CHECK(!DecodeObjectRecord(EncodeObjectRecord(o), "r").ok());
  o = RasterRecord();
  o.raster->rows = 0;
  CHECK(!DecodeObjectRecord(EncodeObjectRecord(o), "r").ok());
}

TEST_CASE("what is up has length 1, and records of older programs do not say it", "[store]") {
  ObjectRecord o = FullRecord();
  o.input = {};  // the view is the last section then
  o.up = {{0, 0, 1.001}, false};
  CHECK(DecodeObjectRecord(EncodeObjectRecord(o), "r").status().code() == StatusCode::kCorrupt);
  o.up = {{0, std::nan(""), 1}, false};
  CHECK(DecodeObjectRecord(EncodeObjectRecord(o), "r").status().code() == StatusCode::kCorrupt);
  o.up = {{0, 1, 0}, true};
  Bytes bytes = EncodeObjectRecord(o);
  bytes.back() = std::byte{2};  // neither found nor given
  CHECK(DecodeObjectRecord(bytes, "r").status().code() == StatusCode::kCorrupt);
  o.up.reset();
  const auto older = DecodeObjectRecord(EncodeObjectRecord(o), "r");
  REQUIRE(older.ok());
  CHECK(!older->up.has_value());
}

TEST_CASE("pages that no folder could hold, and files that are too large, are refused", "[store]") {
  const auto decodes = [](const auto& change) {
    ObjectRecord o = TexturedRecord();
    change(*o.texture);
    return DecodeObjectRecord(EncodeObjectRecord(o), "r").ok();
  };
  CHECK(decodes([](TextureRecord&) {}));
  CHECK(decodes([](TextureRecord& t) { t.pages.clear(); }));
  for (const std::string& name :
       {std::string(), std::string("."), std::string(".."), std::string("../a.jpg"),
        std::string("/a.jpg"), std::string("a\\b.jpg"), std::string("a\nb.jpg"),
        std::string("a\0b", 3), std::string("\xff.jpg"), std::string(256, 'a')}) {
    INFO(name);
    CHECK_FALSE(decodes([&](TextureRecord& t) { t.pages[1].name = name; }));
  }
  CHECK(decodes([](TextureRecord& t) { t.pages[1].name = std::string(255, 'a'); }));
  CHECK_FALSE(decodes([](TextureRecord& t) { t.pages[1].media_type = "image/jpeg\n"; }));
  CHECK_FALSE(decodes([](TextureRecord& t) { t.pages[0].bytes = kMostPageBytes + 1; }));
  CHECK_FALSE(decodes([](TextureRecord& t) { t.pages[0].bytes = 0; }));  // but a checksum
  CHECK_FALSE(decodes([](TextureRecord& t) { t.step = -1; }));
  CHECK_FALSE(decodes([](TextureRecord& t) { t.scale = std::nan(""); }));
}

TEST_CASE("every prefix of a record, and every longer record, fails", "[store]") {
  Bytes bytes = EncodeObjectRecord(GENERATE(RasterRecord(), TexturedRecord()));
  for (size_t size = 0; size < bytes.size(); ++size) {
    INFO(size);
    const auto decoded = DecodeObjectRecord(ByteSpan(bytes).first(size), "r");
    REQUIRE(!decoded.ok());
    CHECK(decoded.status().code() == StatusCode::kCorrupt);
  }
  bytes.push_back(std::byte{0});
  CHECK(!DecodeObjectRecord(bytes, "r").ok());
}

TEST_CASE("a changed record gives an error or another valid record, never more", "[store]") {
  const Bytes plain = EncodeObjectRecord(FullRecord());
  const Bytes raster = EncodeObjectRecord(RasterRecord());
  const Bytes textured = EncodeObjectRecord(TexturedRecord());
  std::mt19937_64 random(3);
  for (int i = 0; i < 30000; ++i) {
    Bytes changed = i % 3 == 0 ? plain : i % 3 == 1 ? raster : textured;
    for (uint64_t k = random() % 3 + 1; k > 0; --k) {
      changed[random() % changed.size()] = static_cast<std::byte>(random());
    }
    const auto decoded = DecodeObjectRecord(changed, "r");
    if (!decoded.ok()) continue;
    // Varints may be longer than need be: compare what the bytes mean.
    const auto again = DecodeObjectRecord(EncodeObjectRecord(*decoded), "r");
    REQUIRE(again.ok());
    REQUIRE(EncodeObjectRecord(*again) == EncodeObjectRecord(*decoded));
  }
}

TEST_CASE("unknown sections are ignored or refused by their must-understand bit", "[store]") {
  Bytes bytes = EncodeObjectRecord(FullRecord());
  bytes[4] = static_cast<std::byte>(static_cast<uint8_t>(bytes[4]) + 1);  // one more section
  Bytes optional = bytes;
  for (const int b : {0x20, 2, 1, 2}) optional.push_back(static_cast<std::byte>(b));
  CHECK(DecodeObjectRecord(optional, "r").ok());
  Bytes required = bytes;
  for (const int b : {0xa0, 2, 1, 2}) required.push_back(static_cast<std::byte>(b));
  CHECK(DecodeObjectRecord(required, "r").status().code() == StatusCode::kUnsupported);
  Bytes later = EncodeObjectRecord(FullRecord());
  later[0] = std::byte{2};
  CHECK(DecodeObjectRecord(later, "r").status().code() == StatusCode::kUnsupported);
}

TEST_CASE("attributes that no codec could use are refused", "[store]") {
  const auto decodes = [](const auto& change) {
    ObjectRecord o = FullRecord();
    change(o.attributes.attributes);
    return DecodeObjectRecord(EncodeObjectRecord(o), "r").ok();
  };
  using Attributes = std::vector<VertexAttribute>;
  CHECK(decodes([](Attributes&) {}));
  CHECK_FALSE(decodes([](Attributes& a) { a[0].step = 1; }));  // of integers
  CHECK_FALSE(decodes([](Attributes& a) { a[1].normal_bits = 17; }));
  CHECK_FALSE(decodes([](Attributes& a) { a[1].normal_bits = 3; }));
  CHECK_FALSE(decodes([](Attributes& a) { a[2].normal_bits = 10; }));  // within another
  CHECK_FALSE(decodes([](Attributes& a) { a[3].step = 1; }));
  CHECK_FALSE(decodes([](Attributes& a) { a.erase(a.begin() + 2); }));
}

TEST_CASE("numbers that are not finite are refused", "[store]") {
  const double inf = std::numeric_limits<double>::infinity();
  ObjectRecord o = FullRecord();
  o.grid.origin.y = inf;
  CHECK(!DecodeObjectRecord(EncodeObjectRecord(o), "r").ok());
  o = FullRecord();
  o.grid.step = std::nan("");
  CHECK(!DecodeObjectRecord(EncodeObjectRecord(o), "r").ok());
  o = FullRecord();
  o.grid.step = 0;
  CHECK(!DecodeObjectRecord(EncodeObjectRecord(o), "r").ok());
}

}  // namespace
}  // namespace mtdb::test
