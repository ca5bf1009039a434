// SPDX-License-Identifier: Apache-2.0
// The update stream of a client that is clipped to a region: after every call it holds just the
// triangles of the cut that meet the region, whatever it remembers and wherever the region jumps.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <random>
#include <set>

#include "codecs/stream/internal/clip_coder.h"
#include "codecs/stream/update_stream.h"
#include "tests/codecs/mesh_file_testing.h"
#include "tests/codecs/update_fixture.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {

using namespace internal;

namespace {

struct Case {
  ClusterOptions options;
  bool manifold = true;
};

std::vector<Case> AllCases() {
  return {
      {{.side = 20}},
      {{.surface = Surface::kSheet, .side = 20}},
      {{.surface = Surface::kSheet, .side = 16, .pierced = true}, false},
      {{.surface = Surface::kBook, .side = 16}, false},
      {{.surface = Surface::kSheet, .side = 14, .numbers = Numbers::kLossless, .attributes = true}},
      {{.side = 12, .numbers = Numbers::kWild}},
      {{.side = 12, .numbers = Numbers::kCoincident, .attributes = true}},
      {{.surface = Surface::kSheet, .side = 16, .rounded_attributes = true}}};
}

void Require(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

// Regions of the size of the fixture's mesh: nothing, a box, a ball, all.
class Regions {
 public:
  explicit Regions(const UpdateFixture& f) : grid_(f.options(0).grid) {
    for (uint32_t v = 0; v < f.cluster().external_vertices() + f.cluster().nodes(); ++v) {
      box_.Add(grid_.Position(f.cluster().position(v)));
    }
  }
  MeetsRegion Box(Vec3d centre, double half_side) const {
    const Vec3d half = (box_.max - box_.min) * half_side;
    Box3d box;
    box.Add(centre - half);
    box.Add(centre + half);
    return [box](const Triangle3d& t) { return TriangleMeetsBox(t, box); };
  }
  Vec3d Point(double x, double y, double z) const {
    const Vec3d size = box_.max - box_.min;
    return {box_.min.x + x * size.x, box_.min.y + y * size.y, box_.min.z + z * size.z};
  }
  Vec3d RandomPoint(std::mt19937& random) const {
    std::uniform_real_distribution<double> part(0, 1);
    const double x = part(random);
    const double y = part(random);
    return Point(x, y, part(random));
  }

 private:
  Grid grid_;
  Box3d box_;
};

std::vector<bool> RandomSet(const UpdateFixture& f, std::mt19937& random) {
  const double share = std::pow(std::uniform_real_distribution<double>(0, 1)(random), 2);
  std::vector<bool> set(f.cluster().nodes());
  for (size_t i = 0; i < set.size(); ++i) set[i] = std::bernoulli_distribution(share)(random);
  return f.Closed(set);
}

// Every edge that occurs once in each direction has its two triangles as neighbours.
bool NeighboursFound(const ClientMesh& mesh) {
  std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> half_edges;
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    if (!mesh.has_triangle(slot)) continue;
    const auto& c = mesh.triangle(slot).corners;
    for (uint32_t i = 0; i < 3; ++i) half_edges[{c[i], c[(i + 1) % 3]}].push_back(4 * slot + i);
  }
  for (const auto& [edge, all] : half_edges) {
    const auto twins = half_edges.find({edge.second, edge.first});
    const bool two = all.size() == 1 && twins != half_edges.end() && twins->second.size() == 1;
    for (const uint32_t h : all) {
      const uint32_t o = mesh.triangle(h >> 2).opposite[h & 3];
      if (two && o != twins->second[0]) return false;
    }
  }
  return true;
}

// The start and the records of a walk of cuts and regions.
Bytes ClippedWalk(const UpdateFixture& f, uint32_t remembered, int steps,
                  std::vector<size_t>* ends) {
  const Regions regions(f);
  std::mt19937 random(5);
  UpdateEncoder encoder(f.options(remembered), f.base(), regions.Box(regions.Point(0, 0, 0), 0.5));
  Bytes stream = encoder.start();
  ends->push_back(stream.size());
  std::vector<bool> at(f.cluster().nodes());
  for (int step = 0; step < steps; ++step) {
    const std::vector<bool> to = RandomSet(f, random);
    const double along = (step + 1.0) / steps;
    const Bytes bytes =
        encoder.Encode(f.Batches(at, to), regions.Box(regions.Point(along, along, along), 0.4));
    stream.insert(stream.end(), bytes.begin(), bytes.end());
    ends->push_back(stream.size());
    at = to;
  }
  return stream;
}

void RequireClip(const UpdateFixture& f, const std::vector<bool>& at, const MeetsRegion& region,
                 const ClientMesh& mesh, bool manifold) {
  REQUIRE(ClientTriangles(mesh) == f.Triangles(at, region));
  const std::string fault = ClientMeshFault(mesh);
  INFO(fault);
  REQUIRE(fault.empty());
  REQUIRE((!manifold || NeighboursFound(mesh)));
}

}  // namespace

TEST_CASE("a clipped client holds what of the cut meets its region, after every call") {
  std::mt19937 random(1);
  for (const Case& c : AllCases()) {
    const UpdateFixture f(c.options);
    const Regions regions(f);
    for (const uint32_t remembered : {0u, 7u, 1000u}) {
      std::vector<bool> at(f.cluster().nodes());
      MeetsRegion region = regions.Box(regions.RandomPoint(random), 0.2);
      UpdateEncoder encoder(f.options(remembered), f.base(), region);
      UpdateDecoder decoder;
      Require(decoder.Feed(encoder.start()));
      RequireClip(f, at, region, decoder.mesh(), c.manifold);
      double half_side = 0.2;
      Vec3d centre = regions.RandomPoint(random);
      for (int step = 0; step < 40; ++step) {
        const std::vector<bool> to = random() % 4 == 0 ? at : RandomSet(f, random);
        if (random() % 3 == 0) half_side = std::uniform_real_distribution<double>(0, 0.5)(random);
        centre = random() % 4 == 0 ? regions.RandomPoint(random)
                                   : centre * 0.9 + regions.RandomPoint(random) * 0.1;
        region = random() % 8 == 0 ? MeetsRegion() : regions.Box(centre, half_side);
        Require(decoder.Feed(encoder.Encode(f.Batches(at, to), region)));
        at = to;
        REQUIRE(decoder.at_record());
        RequireClip(f, at, region, decoder.mesh(), c.manifold);
        REQUIRE(SenderMeshFault(encoder.mesh()).empty());
      }
      if (remembered == 1000) CHECK(encoder.recalled_vertices() > 0);
    }
  }
}

TEST_CASE("a vertex travels once while a clipped client remembers it") {
  const UpdateFixture f({.side = 20});
  const Regions regions(f);
  std::mt19937 random(2);
  UpdateEncoder encoder(f.options(1000), f.base(), regions.Box(regions.Point(0, 0, 0), 0.3));
  UpdateDecoder decoder;
  Require(decoder.Feed(encoder.start()));
  std::vector<bool> at(f.cluster().nodes());
  for (int step = 0; step < 100; ++step) {
    const std::vector<bool> to = RandomSet(f, random);
    const MeetsRegion region = regions.Box(regions.RandomPoint(random), 0.3);
    Require(decoder.Feed(encoder.Encode(f.Batches(at, to), region)));
    at = to;
  }
  // Nothing was forgotten, so that no slot was used twice: what travelled is still there.
  std::set<std::array<int32_t, 3>> positions;
  for (uint32_t v = 0; v < decoder.mesh().vertex_slots(); ++v) {
    const Vec3i p = decoder.mesh().position(v);
    positions.insert({p.x, p.y, p.z});
  }
  CHECK(decoder.mesh().vertex_slots() == encoder.sent_vertices());
  CHECK(positions.size() == encoder.sent_vertices());
  CHECK(encoder.sent_vertices() <= f.cluster().external_vertices() + f.cluster().nodes());
  CHECK(encoder.recalled_vertices() > 10 * encoder.sent_vertices());
}

TEST_CASE("what enters in one call comes in records that end with a conforming mesh each") {
  const UpdateFixture f({.surface = Surface::kSheet, .side = 110});
  const std::vector<bool> none(f.cluster().nodes());
  const std::vector<bool> all(f.cluster().nodes(), true);
  for (const bool emptied : {false, true}) {
    const auto nothing = [](const Triangle3d&) { return false; };
    UpdateEncoder encoder(f.options(0), f.base(), emptied ? MeetsRegion() : nothing);
    UpdateDecoder decoder;
    Require(decoder.Feed(encoder.start()));
    if (emptied) Require(decoder.Feed(encoder.Encode({}, nothing)));
    REQUIRE(decoder.mesh().triangle_count() == 0);
    REQUIRE(decoder.mesh().vertex_count() == 0);
    const Bytes bytes = encoder.Encode(f.Batches(none, all), {});
    int records = 0;
    for (ByteReader reader(bytes); reader.remaining() > 0; ++records) {
      const uint64_t length = reader.GetVarint();
      static_cast<void>(reader.Get<uint32_t>());
      Require(decoder.Feed(UpdateRecord(reader.GetBytes(length))));
      REQUIRE(decoder.at_record());
      MeshCheck check = CheckMesh(Compacted(decoder.mesh()));
      check.nonmanifold_vertices = 0;
      REQUIRE(check.ok());
    }
    CHECK(records == 2);
    REQUIRE(ClientTriangles(decoder.mesh()) == f.Triangles(all));
    REQUIRE(NeighboursFound(decoder.mesh()));
    CHECK(decoder.mesh().origin() == UpdateEncoder(f.options(0), f.base()).mesh().origin());
  }
}

TEST_CASE("a record of what can hardly be shorter has the bytes that its triangles need") {
  constexpr uint32_t kSide = 80;
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
  UpdateEncoder encoder({{}, {}, 0}, base);
  UpdateDecoder decoder;
  Require(decoder.Feed(encoder.start()));
  for (int round = 0; round < 8; ++round) {
    Require(decoder.Feed(encoder.Encode({}, [](const Triangle3d& t) { return t[0].x < 100; })));
    const uint32_t missing =
        static_cast<uint32_t>(base.triangles.size()) - decoder.mesh().triangle_count();
    const Bytes bytes = encoder.Encode({}, {});
    Require(decoder.Feed(bytes));
    REQUIRE(decoder.mesh().triangle_count() == base.triangles.size());
    // A quarter of a byte for each triangle and half of one for each vertex, of which there are
    // half as many, are as little as a client accepts.
    if (round > 4) CHECK(bytes.size() < missing / 2 + 2 * kSide);
    if (round > 4) CHECK(bytes.size() > missing / 2);
  }
}

TEST_CASE("a client refuses what exceeds its limits when it is attached") {
  const UpdateFixture f({.side = 20});
  const auto nothing = [](const Triangle3d&) { return false; };
  UpdateEncoder encoder(f.options(0), f.base(), nothing);
  const Bytes all = encoder.Encode({}, {});
  const auto triangles = static_cast<uint32_t>(f.base().triangles.size());
  const auto vertices = static_cast<uint32_t>(f.base().vertices.size());
  for (const auto& [limits, enough] :
       {std::pair(UpdateDecoder::Limits{triangles, vertices}, true),
        std::pair(UpdateDecoder::Limits{triangles - 1, vertices}, false),
        std::pair(UpdateDecoder::Limits{triangles, vertices - 1}, false)}) {
    UpdateDecoder decoder(limits);
    Require(decoder.Feed(encoder.start()));
    CHECK(decoder.Feed(all).ok() == enough);
    CHECK(ClientMeshFault(decoder.mesh()).empty());
  }
}

TEST_CASE("a flipped bit of a clipped client's stream is refused, every prefix waits for more") {
  const UpdateFixture f({.surface = Surface::kSheet, .side = 8, .attributes = true});
  std::vector<size_t> ends;
  const Bytes stream = ClippedWalk(f, 5, 6, &ends);
  for (size_t bit = 0; bit < 8 * stream.size(); bit += 3) {
    Bytes bad = stream;
    bad[bit / 8] ^= static_cast<std::byte>(1 << bit % 8);
    UpdateDecoder decoder;
    const Status status = decoder.Feed(bad);
    REQUIRE((!status.ok() || !decoder.at_record()));
    REQUIRE((!decoder.started() || ClientMeshFault(decoder.mesh()).empty()));
  }
  UpdateDecoder decoder;
  for (size_t i = 0; i < stream.size(); ++i) {
    Require(decoder.Feed(ByteSpan(stream).subspan(i, 1)));
    const bool end = std::find(ends.begin(), ends.end(), i + 1) != ends.end();
    REQUIRE((!end || decoder.at_record()));
    if (!end) continue;
    MeshCheck check = CheckMesh(Compacted(decoder.mesh()));
    check.nonmanifold_vertices = 0;
    REQUIRE(check.ok());
  }
}

TEST_CASE("damage of a clip that the checksum does not see leaves a mesh whose parts agree") {
  std::mt19937 random(12);
  for (const Case& c : AllCases()) {
    const UpdateFixture f(c.options);
    std::vector<size_t> ends;
    const Bytes stream = ClippedWalk(f, 20, 6, &ends);
    int refused = 0;
    for (int round = 0; round < 150; ++round) {
      UpdateDecoder decoder({.triangles = 20000, .vertices = 20000});
      ByteReader reader(stream);
      Require(decoder.Feed(reader.GetBytes(ends[0])));
      while (reader.remaining() > 0) {
        const uint64_t length = reader.GetVarint();
        static_cast<void>(reader.Get<uint32_t>());
        const ByteSpan good = reader.GetBytes(length);
        Bytes body(good.begin(), good.end());
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

TEST_CASE("a residual of any size comes back, and none has more than 32 bits") {
  for (int expected = 0; expected <= kMaxExponent; ++expected) {
    ResidualModel writing, reading;
    RansEncoder encoder;
    std::vector<int32_t> residuals{INT32_MIN, INT32_MAX, 0};
    for (int bit = 0; bit < 31; ++bit) {
      for (const int32_t r : {1 << bit, 3 << bit >> 1}) residuals.insert(residuals.end(), {r, -r});
    }
    uint32_t symbol = 0;
    for (const int32_t r : residuals) CodeResidual(encoder, writing, expected, r, &symbol);
    // A symbol beyond the largest size.
    encoder.Symbol(writing, 14);
    encoder.Raw(30, 12345);
    encoder.Raw(1, 0);
    encoder.Raw(16, 54321);
    const Bytes bytes = encoder.Finish();
    RansDecoder<> decoder(bytes);
    auto lane = decoder.lane();
    for (const int32_t r : residuals) {
      REQUIRE(CodeResidual(lane, reading, expected, 0, &symbol) == r);
    }
    if (expected < kMaxExponent) continue;
    CHECK(CodeResidual(lane, reading, expected, 0, &symbol) ==
          static_cast<int32_t>(3u << 30 | 12345));
    CHECK(lane.Raw(16) == 54321);
    CHECK(decoder.Done());
  }
}

TEST_CASE("the bytes of a clipped client's stream are those of the golden one", "[golden]") {
  const std::string path = std::string(MTDB_SOURCE_DIR) + "/tests/golden/clipped.mtus";
  std::vector<size_t> ends;
  const Bytes stream = ClippedWalk(UpdateFixture({.side = 16, .attributes = true}), 50, 20, &ends);
  if (std::getenv("MTDB_WRITE_GOLDEN") != nullptr) std::ofstream(path) << AsString(stream);
  CHECK(AsString(stream) == ReadBytes(path));
}

}  // namespace mtdb::testing
