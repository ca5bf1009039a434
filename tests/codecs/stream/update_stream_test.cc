// SPDX-License-Identifier: Apache-2.0
// The update stream between an encoder and a decoder: the same mesh after every update, whatever
// the client remembers; every prefix is a mesh; damaged bytes are refused.
#include "codecs/stream/update_stream.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <sstream>
#include <string>

#include "codecs/stream/internal/update_coder.h"
#include "tests/codecs/update_fixture.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {
namespace {

std::vector<ClusterOptions> AllOptions() {
  return {{.side = 16},
          {.surface = Surface::kSheet, .side = 16},
          {.surface = Surface::kSheet, .side = 16, .pierced = true},
          {.surface = Surface::kBook, .side = 16},
          {.surface = Surface::kBook, .side = 12, .pages = 5, .attributes = true},
          {.side = 12, .numbers = Numbers::kLossless, .attributes = true},
          {.side = 12, .numbers = Numbers::kWild},
          {.side = 12, .numbers = Numbers::kCoincident, .attributes = true},
          {.side = 16, .rounded_attributes = true},
          {.surface = Surface::kTerrain, .side = 16},
          {.surface = Surface::kTerrain, .side = 12, .attributes = true},
          {.surface = Surface::kSheet, .side = 12, .rounded_attributes = true, .pierced = true}};
}

std::vector<bool> RandomSet(const UpdateFixture& f, std::mt19937& random) {
  const double share = std::pow(std::uniform_real_distribution<double>(0, 1)(random), 3);
  std::vector<bool> set(f.cluster().nodes());
  for (size_t i = 0; i < set.size(); ++i) set[i] = std::bernoulli_distribution(share)(random);
  return f.Closed(set);
}

void Require(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

// The start and the records of a short walk.
Bytes ShortStream(const UpdateFixture& f, uint32_t remembered, std::vector<size_t>* ends) {
  UpdateEncoder encoder(f.options(remembered), f.base());
  Bytes stream = encoder.start();
  ends->push_back(stream.size());
  std::mt19937 random(5);
  std::vector<bool> at(f.cluster().nodes());
  for (int step = 0; step < 6; ++step) {
    const std::vector<bool> to = RandomSet(f, random);
    const Bytes bytes = encoder.Encode(f.Batches(at, to));
    stream.insert(stream.end(), bytes.begin(), bytes.end());
    ends->push_back(stream.size());
    at = to;
  }
  return stream;
}

}  // namespace

TEST_CASE("a client has the sender's mesh after every update of a random walk") {
  std::mt19937 random(1);
  for (const ClusterOptions& options : AllOptions()) {
    const UpdateFixture f(options);
    for (const uint32_t remembered : {0u, 7u, 1000u}) {
      UpdateEncoder encoder(f.options(remembered), f.base());
      UpdateDecoder decoder;
      Require(decoder.Feed(encoder.start()));
      std::vector<bool> at(f.cluster().nodes());
      REQUIRE(ClientTriangles(decoder.mesh()) == f.Triangles(at));
      for (int step = 0; step < 60; ++step) {
        const std::vector<bool> to = RandomSet(f, random);
        Require(decoder.Feed(encoder.Encode(f.Batches(at, to))));
        at = to;
        REQUIRE(decoder.at_record());
        REQUIRE(ClientTriangles(decoder.mesh()) == f.Triangles(at));
        REQUIRE(ClientMeshFault(decoder.mesh()).empty());
        REQUIRE(SenderMeshFault(encoder.mesh()).empty());
      }
      if (remembered == 1000) CHECK(encoder.recalled_vertices() > 0);
      if (!options.pierced && options.surface != Surface::kBook)
        CHECK(encoder.listed_updates() == 0);
    }
  }
}

TEST_CASE("slots that travel in several groups are those of the updates") {
  const UpdateFixture f({.side = 64});
  const std::vector<bool> none(f.cluster().nodes());
  const std::vector<bool> all(f.cluster().nodes(), true);
  const std::vector<UpdateBatch> in = f.Batches(none, all);
  const std::vector<UpdateBatch> out = f.Batches(all, none);
  REQUIRE(in.front().nodes.size() > internal::kSlotGroup);
  REQUIRE(std::any_of(out.begin(), out.end(), [](const UpdateBatch& batch) {
    return batch.nodes.size() > internal::kSlotGroup;
  }));
  UpdateEncoder encoder(f.options(0), f.base());
  UpdateDecoder decoder;
  Require(decoder.Feed(encoder.start()));
  for (int step = 0; step < 4; ++step) {
    Require(decoder.Feed(encoder.Encode(step % 2 == 0 ? in : out)));
    CHECK(ClientMeshFault(decoder.mesh()).empty());
    CHECK(ClientTriangles(decoder.mesh()) == f.Triangles(step % 2 == 0 ? all : none));
  }
  CHECK(encoder.listed_updates() == 0);
}

TEST_CASE("a vertex travels once while the client remembers it") {
  const UpdateFixture f({.side = 16, .attributes = true});
  UpdateEncoder encoder(f.options(1000), f.base());
  UpdateEncoder forgetful(f.options(0), f.base());
  const std::vector<bool> none(f.cluster().nodes());
  const std::vector<bool> all(f.cluster().nodes(), true);
  const size_t first = encoder.Encode(f.Batches(none, all)).size();
  CHECK(encoder.recalled_vertices() == 0);
  encoder.Encode(f.Batches(all, none));
  const size_t again = encoder.Encode(f.Batches(none, all)).size();
  CHECK(encoder.recalled_vertices() == f.cluster().nodes());
  CHECK(again < first / 2);
  forgetful.Encode(f.Batches(none, all));
  forgetful.Encode(f.Batches(all, none));
  forgetful.Encode(f.Batches(none, all));
  CHECK(forgetful.recalled_vertices() == 0);
}

TEST_CASE("every prefix of an update stream is a conforming mesh or waits for more") {
  for (const bool sheet : {false, true}) {
    const UpdateFixture f({.surface = sheet ? Surface::kSheet : Surface::kTorus, .side = 10});
    std::vector<size_t> ends;
    const Bytes stream = ShortStream(f, 5, &ends);
    UpdateDecoder decoder;
    for (size_t i = 0; i < stream.size(); ++i) {
      Require(decoder.Feed(ByteSpan(stream).subspan(i, 1)));
      const bool end = std::find(ends.begin(), ends.end(), i + 1) != ends.end();
      REQUIRE((!end || decoder.at_record()));
      if (!end) continue;
      // A cluster's part of a mesh may hang together by single vertices.
      MeshCheck check = CheckMesh(Compacted(decoder.mesh()));
      check.nonmanifold_vertices = 0;
      REQUIRE(check.ok());
      REQUIRE(ClientMeshFault(decoder.mesh()).empty());
    }
  }
}

TEST_CASE("a flipped bit of an update stream is refused") {
  const UpdateFixture f({.side = 8, .attributes = true});
  std::vector<size_t> ends;
  const Bytes stream = ShortStream(f, 5, &ends);
  for (size_t bit = 0; bit < 8 * stream.size(); bit += 3) {
    Bytes bad = stream;
    bad[bit / 8] ^= static_cast<std::byte>(1 << bit % 8);
    UpdateDecoder decoder;
    const Status status = decoder.Feed(bad);
    // A longer record may just be waited for.
    REQUIRE((!status.ok() || !decoder.at_record()));
    REQUIRE((!decoder.started() || ClientMeshFault(decoder.mesh()).empty()));
    if (!status.ok()) REQUIRE(!decoder.Feed(stream).ok());
  }
}

TEST_CASE("updates that cannot be found by walking are listed") {
  // The square a b c d, whose diagonal a third triangle shares; v in its middle; w, which opens the
  // edge from b to v, so that it stays open when w goes.
  enum : VertexIndex { kA, kB, kC, kD, kE, kV, kW };
  BaseMesh base;
  base.vertices = {kA, kB, kC, kD, kE};
  base.positions = {{0, 0, 0}, {100, 0, 0}, {100, 100, 0}, {0, 100, 0}, {50, 50, 100}};
  base.triangles = {{kA, kB, kC}, {kA, kC, kD}, {kA, kC, kE}};
  base.triangle_keys = {0, 1, 2};
  UpdateBatch v;
  v.nodes = {{kV, {40, 60, 3}, false, 10, 0, 4, 0}};
  v.ring = {kA, kB, kC, kD};
  v.holes = {{0, {0, 1, 2}}, {1, {0, 2, 3}}};
  UpdateBatch w;
  w.nodes = {{kW, {60, 20, 1}, true, 20, 0, 3, 0}};
  w.ring = {kV, kA, kB};
  w.holes = {{10, {0, 1, 2}}};
  const auto removal = [](UpdateBatch batch) {
    batch.insert = false;
    return batch;
  };
  for (const uint32_t remembered : {0u, 1u}) {
    UpdateEncoder encoder({{}, {}, remembered}, base);
    UpdateDecoder decoder;
    Require(decoder.Feed(encoder.start()));
    const std::multiset<std::string> before = ClientTriangles(decoder.mesh());
    std::multiset<std::string> full;
    for (int round = 0; round < 2; ++round) {
      Require(decoder.Feed(encoder.Encode(std::vector{v, w})));
      REQUIRE(decoder.mesh().triangle_count() == 6);
      if (round == 1) REQUIRE(ClientTriangles(decoder.mesh()) == full);
      full = ClientTriangles(decoder.mesh());
      Require(decoder.Feed(encoder.Encode(std::vector{removal(w), removal(v)})));
      REQUIRE(ClientTriangles(decoder.mesh()) == before);
      REQUIRE(ClientMeshFault(decoder.mesh()).empty());
    }
    // v twice out, once in: its second hole's triangles lie side by side.
    CHECK(encoder.listed_updates() == 3);
  }
}

TEST_CASE("damage that the checksum does not see leaves a mesh whose parts agree") {
  std::mt19937 random(11);
  for (const ClusterOptions& options : AllOptions()) {
    const UpdateFixture f(options);
    UpdateEncoder encoder(f.options(20), f.base());
    std::vector<Bytes> bodies;
    std::vector<bool> at(f.cluster().nodes());
    for (int step = 0; step < 4; ++step) {
      const std::vector<bool> to = RandomSet(f, random);
      const Bytes record = encoder.Encode(f.Batches(at, to));
      at = to;
      ByteReader reader(record);
      const uint64_t length = reader.GetVarint();
      if (record.empty() || reader.remaining() != length + 4) continue;
      bodies.emplace_back(record.end() - static_cast<std::ptrdiff_t>(length), record.end());
    }
    int refused = 0;
    for (int round = 0; round < 150; ++round) {
      UpdateDecoder decoder({.triangles = 20000, .vertices = 20000});
      Require(decoder.Feed(encoder.start()));
      for (Bytes body : bodies) {
        Damage(random, &body);
        if (decoder.Feed(UpdateRecord(body)).ok()) continue;
        ++refused;
        break;
      }
      const std::string fault = ClientMeshFault(decoder.mesh());
      INFO(fault);
      REQUIRE(fault.empty());
    }
    CHECK(refused > 100);
  }
}

TEST_CASE("the bytes of a terrain's stream are those of the golden one", "[golden]") {
  const std::string path = std::string(MTDB_SOURCE_DIR) + "/tests/golden/terrain.mtus";
  const UpdateFixture f({.surface = Surface::kTerrain, .side = 24});
  UpdateEncoder encoder(f.options(40), f.base());
  Bytes stream = encoder.start();
  std::vector<bool> at(f.cluster().nodes());
  std::mt19937 random(3);
  for (int step = 0; step < 12; ++step) {
    const std::vector<bool> to =
        step % 3 == 0 ? std::vector<bool>(at.size(), step % 2 == 0) : RandomSet(f, random);
    const Bytes records = encoder.Encode(f.Batches(at, to));
    stream.insert(stream.end(), records.begin(), records.end());
    at = to;
  }
  const std::string text(reinterpret_cast<const char*>(stream.data()), stream.size());
  if (std::getenv("MTDB_WRITE_GOLDEN") != nullptr) std::ofstream(path) << text;
  std::ostringstream golden;
  golden << std::ifstream(path, std::ios::binary).rdbuf();
  CHECK((text == golden.str()));
}

TEST_CASE("a sender has no arrays for a GPU") {
  const UpdateFixture f({.side = 12});
  UpdateEncoder encoder(f.options(4), f.base());
  std::vector<bool> at(f.cluster().nodes());
  std::mt19937 random(3);
  for (int step = 0; step < 4; ++step) {
    const std::vector<bool> to = RandomSet(f, random);
    encoder.Encode(f.Batches(at, to));
    at = to;
    CHECK(encoder.mesh().indices().empty());
    CHECK(encoder.mesh().positions().empty());
  }
}

TEST_CASE("an update tells which slots it changed") {
  const UpdateFixture f({.side = 12});
  UpdateEncoder encoder(f.options(4), f.base());
  UpdateDecoder decoder;
  Require(decoder.Feed(encoder.start()));
  decoder.TakeChanges();
  std::mt19937 random(3);
  std::vector<bool> at(f.cluster().nodes());
  for (int step = 0; step < 20; ++step) {
    const std::vector<uint32_t> indices(decoder.mesh().indices().begin(),
                                        decoder.mesh().indices().end());
    const std::vector<float> positions(decoder.mesh().positions().begin(),
                                       decoder.mesh().positions().end());
    const std::vector<bool> to = RandomSet(f, random);
    Require(decoder.Feed(encoder.Encode(f.Batches(at, to))));
    at = to;
    const ClientMesh::Changes changes = decoder.TakeChanges();
    const auto in = [](const std::vector<ClientMesh::Range>& ranges, size_t slot) {
      return std::any_of(ranges.begin(), ranges.end(), [&](const ClientMesh::Range& r) {
        return r.begin <= slot && slot < r.end;
      });
    };
    const auto now = decoder.mesh().indices();
    for (size_t i = 0; i < now.size(); ++i) {
      if (i >= indices.size() || now[i] != indices[i]) REQUIRE(in(changes.triangles, i / 3));
    }
    const auto floats = decoder.mesh().positions();
    for (size_t i = 0; i < floats.size(); ++i) {
      if (i >= positions.size() || floats[i] != positions[i]) REQUIRE(in(changes.vertices, i / 3));
    }
  }
}

TEST_CASE("a client with room for next to nothing refuses every insertion") {
  const UpdateFixture f({.side = 12});
  BaseMesh nothing;
  for (const uint32_t triangles : {0u, 1u, 2u}) {
    // The start is empty: all comes as records.
    const auto everywhere = [](const Triangle3d&) { return true; };
    const auto nowhere = [](const Triangle3d&) { return false; };
    UpdateEncoder encoder(f.options(0), f.base(), nowhere);
    UpdateDecoder decoder({.triangles = triangles, .vertices = 100});
    Require(decoder.Feed(encoder.start()));
    CHECK(decoder.Feed(encoder.Encode({}, everywhere)).code() == StatusCode::kCorrupt);
    CHECK(decoder.mesh().triangle_count() <= triangles);
  }
  // One triangle, and a vertex in its middle.
  nothing.vertices = {0, 1, 2};
  nothing.positions = {{0, 0, 0}, {9, 0, 0}, {0, 9, 0}};
  nothing.triangles = {{0, 1, 2}};
  nothing.triangle_keys = {0};
  UpdateBatch batch;
  batch.nodes = {{3, {3, 3, 0}, false, 10, 0, 3, 0}};
  batch.ring = {0, 1, 2};
  batch.holes = {{0, {0, 1, 2}}};
  for (const uint32_t triangles : {1u, 2u, 3u}) {
    UpdateEncoder encoder({{}, {}, 0}, nothing);
    UpdateDecoder decoder({.triangles = triangles, .vertices = 100});
    Require(decoder.Feed(encoder.start()));
    CHECK(decoder.Feed(encoder.Encode(std::span(&batch, 1))).ok() == (triangles == 3));
    CHECK(decoder.mesh().triangle_count() == (triangles == 3 ? 3u : 1u));
  }
}

TEST_CASE("a record is refused when it is shorter than what it does may be") {
  // Flat and even, so that what it does takes hardly a bit.
  constexpr uint32_t kSide = 60;
  BaseMesh base;
  for (uint32_t v = 0; v < kSide * kSide; ++v) {
    base.vertices.push_back(v);
    base.positions.push_back(
        {static_cast<int32_t>(v % kSide) * 16, static_cast<int32_t>(v / kSide) * 16, 0});
  }
  for (uint32_t v = 0; v < kSide * (kSide - 1); ++v) {
    if (v % kSide == kSide - 1) continue;
    for (const bool upper : {false, true}) {
      base.triangle_keys.push_back(base.triangles.size());
      base.triangles.push_back(
          {v, upper ? v + 1 + kSide : v + 1, upper ? v + kSide : v + 1 + kSide});
    }
  }
  UpdateEncoder encoder({{}, {}, 0}, base, [](const Triangle3d&) { return false; });
  const Bytes record = encoder.Encode({}, {});
  ByteReader reader(record);
  const uint64_t length = reader.GetVarint();
  static_cast<void>(reader.Get<uint32_t>());
  const ByteSpan body = reader.GetBytes(length);
  REQUIRE(reader.remaining() == 0);
  REQUIRE(body[body.size() - 1] == std::byte{0});
  const auto feed = [&](ByteSpan some) {
    UpdateDecoder decoder;
    Require(decoder.Feed(encoder.start()));
    const Status status = decoder.Feed(UpdateRecord(some));
    CHECK(ClientMeshFault(decoder.mesh()).empty());
    return status;
  };
  CHECK(feed(body).ok());
  CHECK(feed(body.first(body.size() - 1)).code() == StatusCode::kCorrupt);
  Bytes dirty(body.begin(), body.end());
  dirty.back() = std::byte{1};
  CHECK(feed(dirty).code() == StatusCode::kCorrupt);
}

TEST_CASE("a record longer than 2^28 bytes is refused by its length, before it has come") {
  for (const uint64_t length : {uint64_t{0}, (uint64_t{1} << 28) + 1, uint64_t{1} << 40}) {
    ByteWriter w;
    for (const char c : internal::kUpdateMagic) w.Put(c);
    w.Put<uint8_t>(internal::kUpdateVersion);
    w.PutVarint(length);
    w.Put<uint64_t>(0);
    UpdateDecoder decoder;
    const Status status = decoder.Feed(w.bytes());
    CHECK(status.code() == StatusCode::kCorrupt);
    CHECK(status.message().find("a record of " + std::to_string(length) + " bytes") !=
          std::string::npos);
  }
  // What a sender may start with is counted before it is made.
  BaseMesh base;
  ClientMeshOptions options;
  base.positions.resize(1000);
  base.rows.resize(UpdateEncoder::kMaxStartBytes / 8);
  CHECK(UpdateEncoder::StartBytes(options, base) < UpdateEncoder::kMaxStartBytes);
  base.triangles.resize(UpdateEncoder::kMaxStartBytes / 16);
  CHECK(UpdateEncoder::StartBytes(options, base) > UpdateEncoder::kMaxStartBytes);
}

TEST_CASE("a client refuses what exceeds its limits, and other versions") {
  const UpdateFixture f({.side = 12});
  UpdateEncoder encoder(f.options(0), f.base());
  const std::vector<bool> none(f.cluster().nodes());
  const std::vector<bool> all(f.cluster().nodes(), true);
  const Bytes bytes = encoder.Encode(f.Batches(none, all));
  UpdateDecoder small({.triangles = 10, .vertices = 10});
  CHECK(small.Feed(encoder.start()).code() == StatusCode::kCorrupt);
  UpdateDecoder medium({.triangles = 200, .vertices = 100000});
  Require(medium.Feed(encoder.start()));
  CHECK(medium.Feed(bytes).code() == StatusCode::kCorrupt);
  CHECK(ClientMeshFault(medium.mesh()).empty());
  Bytes other = encoder.start();
  other[4] = std::byte{9};
  UpdateDecoder decoder;
  CHECK(decoder.Feed(other).code() == StatusCode::kUnsupported);
  CHECK(UpdateDecoder().Feed(AsBytes("ply\n")).code() == StatusCode::kCorrupt);
}

}  // namespace mtdb::testing
