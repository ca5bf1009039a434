// The update stream of a client that is clipped to a region: after every call it holds just the
// triangles of the cut that meet the region, whatever it remembers and wherever the region jumps.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <random>

#include "codecs/update_stream.h"
#include "tests/codecs/update_fixture.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {
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
      {{.surface = Surface::kSheet, .side = 14, .numbers = Numbers::kLossless, .attributes = true}},
      {{.side = 12, .numbers = Numbers::kWild}},
      {{.side = 12, .numbers = Numbers::kCoincident, .attributes = true}}};
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
        REQUIRE(ClientMeshFault(encoder.mesh()).empty());
      }
      if (remembered == 1000) CHECK(encoder.recalled_vertices() > 0);
    }
  }
}

}  // namespace mtdb::testing
