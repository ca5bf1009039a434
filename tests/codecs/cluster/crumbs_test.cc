// SPDX-License-Identifier: Apache-2.0
// Clusters with crumbs: what is decoded is what was encoded, triangle by triangle; other bytes are
// refused, or are some cluster.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <random>
#include <set>
#include <tuple>

#include "codecs/cluster/both_sides.h"
#include "codecs/cluster/cluster_codec.h"
#include "tests/codecs/cluster_fixture.h"

namespace mtdb {
namespace {

using testing::ClusterFixture;
using testing::MakeCluster;
using testing::MakeIn;

using Places = std::array<Vec3i, 3>;

Places FromSmallest(const Places& t) {
  return std::min({t, Places{t[1], t[2], t[0]}, Places{t[2], t[0], t[1]}});
}

// Adds crumbs of all kinds to a cluster. Their triggers are triangles that nobody removes, one that
// comes in, and one that has two of them.
class CrumbMaker {
 public:
  CrumbMaker(ClusterFixture& fixture, uint32_t seed) : fixture_(fixture), random_(seed) {}

  void Run() {
    ClusterUpdates& u = fixture_.updates;
    std::vector<bool> removed(u.triangles.size());
    std::vector<uint32_t> out;
    for (const uint32_t t : u.holes) removed[t] = true;
    for (const uint32_t t : u.stars) {
      if (!removed[t]) out.push_back(t);
    }
    std::shuffle(out.begin(), out.end(), random_);
    const uint32_t far = AddTriangle({AddVertex(1000), AddVertex(1000), AddVertex(1000)}, false);
    Hang({out[0]}, 1, 1);
    Hang({out[1], out[2]}, 0, 1);
    Hang({out[3]}, 4, 4);
    Hang({far}, 2, 3);
    Hang({out[0]}, 3, 2);
    Hang({out[4], far, out[5], out[6]}, 2, 5);
  }

 private:
  uint32_t AddVertex(int32_t spread) {
    ClusterUpdates& u = fixture_.updates;
    const auto near = u.positions[random_() % u.positions.size()];
    const auto step = [&] { return static_cast<int32_t>(random_() % 50) + spread; };
    u.positions.push_back({near.x + step(), near.y - step(), near.z + step()});
    for (size_t i = 0; i < fixture_.attributes.row_bytes(); ++i) {
      u.rows.push_back(static_cast<std::byte>(random_()));
    }
    return static_cast<uint32_t>(u.positions.size() - 1);
  }
  uint32_t AddTriangle(const std::array<uint32_t, 3>& corners, bool two_sided) {
    ClusterUpdates& u = fixture_.updates;
    const auto t = static_cast<uint32_t>(u.triangles.size());
    u.triangles.push_back(corners);
    ClusterUpdates::Consumer& consumer = u.consumers.emplace_back();
    if (random_() % 2 == 0) {
      consumer = {static_cast<UnitId>(random_() % 30), static_cast<uint32_t>(random_() % 100),
                  random_() % 2 == 0};
    }
    if (two_sided || !u.two_sided.empty()) {
      u.two_sided.resize(u.triangles.size());
      u.two_sided.back() = two_sided;
    }
    return t;
  }
  void Hang(const std::vector<uint32_t>& triggers, uint32_t own, uint32_t triangles) {
    ClusterUpdates::Crumb crumb;
    crumb.error_code = static_cast<uint8_t>(random_());
    crumb.triggers = triggers;
    std::vector<uint32_t> around;
    for (const uint32_t t : triggers) {
      for (const uint32_t v : fixture_.updates.triangles[t]) around.push_back(v);
    }
    for (uint32_t i = 0; i < own; ++i) crumb.vertices.push_back(AddVertex(1));
    for (uint32_t i = 0; i < triangles; ++i) {
      std::set<uint32_t> corners;
      if (i < own) corners.insert(crumb.vertices[i]);
      if (i == 0) {
        for (size_t v = triangles; v < own; ++v) corners.insert(crumb.vertices[v]);
      }
      while (corners.size() < 3) {
        const bool mine = own > 0 && random_() % 2 == 0;
        corners.insert(mine ? crumb.vertices[random_() % own] : around[random_() % around.size()]);
      }
      std::array<uint32_t, 3> sorted{};
      std::copy(corners.begin(), corners.end(), sorted.begin());
      if (random_() % 2 == 0) std::swap(sorted[0], sorted[1]);
      crumb.triangles.push_back(AddTriangle(sorted, random_() % 2 == 0));
    }
    fixture_.updates.crumbs.push_back(crumb);
  }

  ClusterFixture& fixture_;
  std::mt19937 random_;
};

ClusterFixture MakeCrumbs(uint32_t seed) {
  testing::ClusterOptions options;
  options.surface = seed % 2 == 0 ? testing::Surface::kTorus : testing::Surface::kBook;
  options.side = 12;
  options.attributes = seed % 3 == 0;
  options.seed = seed;
  ClusterFixture fixture = MakeCluster(options);
  CrumbMaker(fixture, seed).Run();
  return fixture;
}

InPatch InOf(const ClusterFixture& fixture, const EncodedCluster& encoded) {
  InPatch in = MakeIn(fixture, encoded);
  if (fixture.updates.two_sided.empty()) return in;
  for (const uint32_t t : encoded.in_triangles) {
    in.two_sided.push_back(fixture.updates.two_sided[t]);
  }
  if (std::ranges::count(in.two_sided, 0) == std::ssize(in.two_sided)) in.two_sided.clear();
  return in;
}

Result<Cluster> Decode(const ClusterFixture& fixture, const EncodedCluster& encoded,
                       ByteSpan payload) {
  return DecodeCluster(payload, InOf(fixture, encoded), fixture.attributes, encoded.nodes, "test");
}

// A triangle that leaves the cluster: where it is, who removes it, whether it is two-sided, its
// row.
using Leaving = std::tuple<Places, UnitId, bool, Bytes>;

Leaving LeavingOf(const ClusterUpdates& u, uint32_t t, size_t row) {
  const auto& c = u.triangles[t];
  Bytes rows;
  const auto smallest = static_cast<size_t>(
      std::min_element(c.begin(), c.end(),
                       [&](uint32_t a, uint32_t b) { return u.positions[a] < u.positions[b]; }) -
      c.begin());
  const auto begin = u.rows.begin() + static_cast<std::ptrdiff_t>(c[smallest] * row);
  rows.assign(begin, begin + static_cast<std::ptrdiff_t>(row));
  return {FromSmallest({u.positions[c[0]], u.positions[c[1]], u.positions[c[2]]}),
          u.consumers[t].child, !u.two_sided.empty() && u.two_sided[t] != 0, rows};
}

std::multiset<Leaving> LeavingOf(const ClusterUpdates& u, size_t row) {
  std::vector<bool> removed(u.triangles.size()), there(u.triangles.size());
  for (const uint32_t t : u.holes) removed[t] = true;
  for (const uint32_t t : u.stars) there[t] = true;
  for (const ClusterUpdates::Crumb& crumb : u.crumbs) {
    for (const uint32_t t : crumb.triggers) there[t] = true;
    for (const uint32_t t : crumb.triangles) there[t] = true;
  }
  std::multiset<Leaving> all;
  for (uint32_t t = 0; t < u.triangles.size(); ++t) {
    if (there[t] && !removed[t]) all.insert(LeavingOf(u, t, row));
  }
  return all;
}

std::vector<std::pair<std::vector<Places>, uint8_t>> CrumbsOf(const ClusterUpdates& u) {
  std::vector<std::pair<std::vector<Places>, uint8_t>> crumbs;
  for (const ClusterUpdates::Crumb& crumb : u.crumbs) {
    std::vector<Places> places;
    for (const auto* list : {&crumb.triggers, &crumb.triangles}) {
      for (const uint32_t t : *list) {
        const auto& c = u.triangles[t];
        places.push_back(FromSmallest({u.positions[c[0]], u.positions[c[1]], u.positions[c[2]]}));
      }
    }
    crumbs.emplace_back(places, crumb.error_code);
  }
  return crumbs;
}

}  // namespace

TEST_CASE("A cluster with crumbs decodes to what was encoded") {
  for (uint32_t seed = 0; seed < 12; ++seed) {
    CAPTURE(seed);
    const ClusterFixture fixture = MakeCrumbs(seed);
    const ClusterUpdates& u = fixture.updates;
    const size_t row = fixture.attributes.row_bytes();
    const EncodedCluster encoded = EncodeCluster(u, fixture.attributes);
    Result<Cluster> decoded = Decode(fixture, encoded, encoded.payload);
    INFO(decoded.status().message());
    REQUIRE(decoded.ok());
    REQUIRE(decoded->nodes() == encoded.nodes);
    REQUIRE(encoded.nodes == u.nodes.size() + 1 + 1 + 4 + 2 + 3 + 2);
    const ClusterUpdates again = UpdatesOf(*decoded, false);
    CHECK(LeavingOf(again, row) == LeavingOf(u, row));
    CHECK(CrumbsOf(again) == CrumbsOf(u));
    std::multiset<std::tuple<UnitId, uint32_t>> arcs, arcs_again;
    for (uint32_t t = 0; t < u.triangles.size(); ++t) {
      if (u.consumers[t].explicit_arc)
        arcs.emplace(u.consumers[t].child, u.consumers[t].child_slot);
    }
    for (const ExplicitArc& arc : decoded->explicit_arcs) {
      REQUIRE(RemovedByChild(decoded->removers[arc.slot]));
      arcs_again.emplace(decoded->children[ChildOrdinal(decoded->removers[arc.slot])],
                         arc.child_slot);
    }
    CHECK(arcs_again == arcs);
    // Of each side a slot: out-triangles are as many as the index will say.
    uint64_t sides = 0;
    for (const Leaving& leaving : LeavingOf(u, row)) sides += std::get<2>(leaving) ? 2 : 1;
    if (!decoded->in.two_sided.empty()) ShowBothSides(*decoded);
    uint64_t left = 0;
    for (uint32_t s = decoded->in_triangles(); s < decoded->slots(); ++s) {
      left += !RemovedByNode(decoded->removers[s]);
    }
    CHECK(left == sides);
  }
}

TEST_CASE("A crumb may be all that a cluster has") {
  ClusterFixture fixture;
  ClusterUpdates& u = fixture.updates;
  u.positions = {{0, 0, 0}, {9, 0, 0}, {0, 9, 0}, {1, 1, 1}};
  u.triangles = {{0, 1, 2}, {0, 1, 3}};
  u.consumers.resize(2);
  u.crumbs.push_back({7, {0}, {1}, {3}});
  const EncodedCluster encoded = EncodeCluster(u, {});
  CHECK(encoded.nodes == 1);
  CHECK(encoded.out_triangles == 2);
  const Result<Cluster> decoded = Decode(fixture, encoded, encoded.payload);
  REQUIRE(decoded.ok());
  CHECK(decoded->in_triangles() == 1);
  CHECK(decoded->slots() == 3);
  CHECK(decoded->position(3) == Vec3i{1, 1, 1});
}

TEST_CASE("Crumbs of other bytes are refused, or are some cluster") {
  std::mt19937 random(1);
  uint32_t refused = 0;
  for (uint32_t seed = 0; seed < 6; ++seed) {
    const ClusterFixture fixture = MakeCrumbs(seed);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    for (int i = 0; i < 3000; ++i) {
      Bytes payload = encoded.payload;
      payload[random() % payload.size()] ^= static_cast<std::byte>(1 << random() % 8);
      const Result<Cluster> decoded = Decode(fixture, encoded, payload);
      if (!decoded.ok()) {
        ++refused;
        continue;
      }
      bool right = true;
      for (uint32_t s = 0; s < decoded->in_triangles(); ++s) {
        right = right && RemovedByNode(decoded->removers[s]);
      }
      for (NodeIndex node = 0; node < decoded->nodes(); ++node) {
        for (const uint32_t slot : decoded->shape(node).created) {
          for (const uint32_t v : decoded->created_triangle(node, slot)) {
            right = right && v < decoded->external_vertices() + decoded->nodes();
          }
        }
      }
      REQUIRE(right);
    }
  }
  CHECK(refused > 9000);
}

}  // namespace mtdb
