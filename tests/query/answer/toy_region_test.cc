// SPDX-License-Identifier: Apache-2.0
// A region of a kind that mtdb does not know: what docs/design.md, section 10, says of regions is
// enough. The least cut is that of the definition, which asks the region alone.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <memory>
#include <random>

#include "query/surface.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {
namespace {

// What is at most `thick` above or below the plane z = `height`; Depth and Shift are left out.
class SlabRegion final : public Region {
 public:
  SlabRegion(double height, double thick) : height_(height), thick_(thick) {}

  bool Within(const Triangle3d& t, double distance) const override {
    return Low(t) <= height_ + thick_ + distance && High(t) >= height_ - thick_ - distance;
  }
  bool Covers(const Triangle3d& t, double distance) const override {
    return High(t) + distance < height_ + thick_ && Low(t) - distance > height_ - thick_;
  }
  bool BoxWithin(const Box3d& box, double distance) const override {
    return box.min.z <= height_ + thick_ + distance && box.max.z >= height_ - thick_ - distance;
  }
  bool BoxCovers(const Box3d& box, double distance) const override {
    return box.max.z + distance < height_ + thick_ && box.min.z - distance > height_ - thick_;
  }

 private:
  static double Low(const Triangle3d& t) { return std::min({t[0].z, t[1].z, t[2].z}); }
  static double High(const Triangle3d& t) { return std::max({t[0].z, t[1].z, t[2].z}); }

  const double height_, thick_;
};

}  // namespace

TEST_CASE("a region of one's own kind is answered by the least cut") {
  std::mt19937 random(5);
  uint64_t partial = 0;
  for (uint32_t seed = 0; seed < 8; ++seed) {
    MtOptions options;
    options.shape = static_cast<Shape>(seed % 4);
    options.seed = seed + 40;
    const MtFixture fixture = MakeMt(options);
    const auto surface = Surface::Open(fixture.source).value();
    const Box3d box = fixture.source->record_.bounds;
    for (const double share : {0.2, 0.5, 0.9}) {
      const double height = box.min.z + share * (box.max.z - box.min.z);
      Query query;
      query.region = std::make_shared<SlabRegion>(height, 0.02 * (box.max.z - box.min.z));
      query.threshold = ConstantThreshold(fixture.source->record_.grid.Error(40));
      const std::vector<bool> expected = Oracle(fixture, query).LeastCut(random);
      const Result<Cut> cut = surface->Select(query);
      REQUIRE(cut.ok());
      for (size_t i = 0; i < expected.size(); ++i) {
        const InMemoryMt::Node& node = fixture.mt.nodes[i];
        REQUIRE(cut->applied(node.cluster, node.index) == expected[i]);
      }
      const auto count = std::count(expected.begin(), expected.end(), true);
      partial += count > 0 && static_cast<size_t>(count) < expected.size();
    }
  }
  CHECK(partial > 5);
}

}  // namespace mtdb::testing
