// SPDX-License-Identifier: Apache-2.0
// The parts of a comparison against their own definitions.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "query/compare/outward.h"
#include "query/compare/side.h"
#include "query/compare/touching.h"
#include "query/compare/triangle_gap.h"
#include "query/compare/triangle_tree.h"
#include "query/fields/rounding.h"
#include "tests/builder/fixture.h"
#include "tests/query/compare/compare_meshes.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr double kNone = std::numeric_limits<double>::infinity();

std::vector<Triangle3d> TrianglesOf(const TriangleMesh& mesh) {
  std::vector<Triangle3d> triangles;
  for (const TriangleVertices& t : mesh.triangles) {
    triangles.push_back({mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]});
  }
  return triangles;
}

double Distance(const std::vector<Triangle3d>& triangles, Vec3d p) {
  double best2 = kNone;
  for (const Triangle3d& t : triangles) {
    best2 = std::min(best2, SquaredDistancePointTriangle(p, t[0], t[1], t[2]));
  }
  return std::sqrt(best2);
}

bool Contains(const Box3d& outer, const Box3d& inner) {
  return outer.Contains(inner.min) && outer.Contains(inner.max);
}

// About z by an angle, and away.
Transform Turned(double angle, Vec3d by) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c, -s, 0, by.x, s, c, 0, by.y, 0, 0, 1, by.z, 0, 0, 0, 1};
}

}  // namespace

TEST_CASE("A tree bounds the distance from all of its triangles", "[oracle]") {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(-2, 2);
  for (int round = 0; round < 40; ++round) {
    const std::vector<Triangle3d> triangles = TrianglesOf(Soup(1 + 5 * round, random));
    const TriangleTree tree(triangles, kOutward * 16);
    uint32_t hint = 0;
    for (int i = 0; i < 50; ++i) {
      const Vec3d p{unit(random), unit(random), unit(random)};
      const TriangleTree::Near near = tree.Nearest(p, hint);
      const double expected = Distance(triangles, p);
      CHECK(near.low <= expected);
      CHECK(near.high >= expected);
      CHECK(near.high - near.low <= 1e-9);
      CHECK(tree.High(p, near.triangle) == near.high);
      hint = near.triangle;
    }
  }
  CHECK(TriangleTree({}, 0).Nearest({0, 0, 0}, 0).low == kNone);
}

TEST_CASE("What is taken of a cut has all that points near the boxes stand for", "[oracle]") {
  std::mt19937 random(3);
  BuildOptions options;
  options.tile_triangles = 1000;
  const BuiltObject object = Build(MakeSculpture(8000), options);
  const TriangleMesh full = Extract(*object.surface, {});
  const double size = object.record.diagonal();
  std::uniform_real_distribution<double> unit(0, 1);
  for (int round = 0; round < 40; ++round) {
    const Transform turn = round % 2 == 0 ? kIdentity : Turned(round, {3, 0, -1});
    const Placement placement = Placement::Of(turn).value();
    const bool as_stored = round % 4 < 2;
    const Side side(*object.surface, placement, as_stored, nullptr);
    std::vector<Box3d> boxes;
    for (int i = 0; i < 6; ++i) {
      const Vec3d p = placement.At(full.positions[random() % full.positions.size()]);
      boxes.push_back(Grown({p, p}, round % 3 == 0 ? 0 : 0.03 * size * unit(random)));
    }
    const double by = round % 3 == 0 ? 0 : 0.05 * size * unit(random);
    const double threshold = round % 5 == 0 ? -1 : 0.02 * size * unit(random);
    Side::Reading reading;
    const auto set = std::make_shared<BoxSet>(boxes);
    const auto patch = side.Take(set, by, threshold, 1'000'000, &reading);
    REQUIRE(patch.ok());
    REQUIRE(patch->has_value());
    if (threshold >= side.least_bound()) CHECK((*patch)->bound <= threshold * (1 + 1e-9) + 1e-12);
    size_t near = 0;
    for (const Vec3d& q : full.positions) {
      const Vec3d p = placement.At(q);
      if (!set->Meets({p, p}, by)) continue;
      ++near;
      CHECK(Distance((*patch)->triangles, p) <= (*patch)->bound + 1e-12);
    }
    CHECK(near > 0);
    CHECK(Contains(side.bounds(),
                   Around({placement.At(full.positions[0]), placement.At(full.positions[1]),
                           placement.At(full.positions[2])})));
  }
}

TEST_CASE("Doubts have all that a part stands for, and parts cover their triangle", "[oracle]") {
  std::mt19937 random(4);
  for (int round = 0; round < 30; ++round) {
    const TriangleTree tree(TrianglesOf(Soup(8, random)), kOutward * 16);
    const Triangle3d t = TrianglesOf(Soup(1, random))[0];
    Goals goals(std::nullopt, 0.0, std::nullopt);
    GapQuestion question;
    question.tree = &tree;
    question.asking.bound = 0.125;
    question.answer_bound = 0.25;
    question.known = question.high = 100;
    question.accuracy = 0.05;
    question.most_parts = 1000;
    const GapAnswer answer = TriangleGap(question, &goals).Find(t);
    double low = 0, high = answer.met_high;
    for (const GapPart& part : answer.doubts) {
      low = std::max(low, part.distance.low);
      high = std::max(high, part.distance.high);
    }
    for (int i = 0; i <= 20; ++i) {
      for (int j = 0; i + j <= 20; ++j) {
        const Vec3d p = t[0] + (t[1] - t[0]) * (i / 20.0) + (t[2] - t[0]) * (j / 20.0);
        const double least = tree.Nearest(p, 0).low + 0.375;
        // What p stands for: done with, or in a doubt.
        const bool covered = std::ranges::any_of(answer.doubts, [&](const GapPart& part) {
          return Contains(Grown(part.box, 1e-12), Grown({p, p}, 0.125)) &&
                 least <= part.distance.high;
        });
        CHECK((covered || least <= answer.met_high));
      }
    }
    CHECK(low <= goals.lowest());
    CHECK(goals.lowest() <= high);
  }
}

TEST_CASE("Boxes that touch hang together", "[oracle]") {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int round = 0; round < 20; ++round) {
    std::vector<Box3d> boxes;
    for (int i = 0; i < 60; ++i) {
      const Vec3d p{unit(random), unit(random), unit(random)};
      boxes.push_back(Grown({p, p}, 0.1 * unit(random)));
    }
    // By relaxation.
    std::vector<uint32_t> expected(boxes.size());
    for (uint32_t i = 0; i < boxes.size(); ++i) expected[i] = i;
    for (bool changed = true; changed;) {
      changed = false;
      for (size_t i = 0; i < boxes.size(); ++i) {
        for (size_t j = 0; j < boxes.size(); ++j) {
          if (SquaredDistanceBoxBox(boxes[i], boxes[j]) > 0 || expected[j] >= expected[i]) continue;
          expected[i] = expected[j];
          changed = true;
        }
      }
    }
    CHECK(TouchingGroups(boxes) == expected);
  }
}

TEST_CASE("A placement maps there and back, and no distance grows by more than it says") {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> unit(-1, 1);
  CHECK(Placement::Of(Turned(1, {5, 6, 7}))->stretch() <= 1 + 1e-12);
  for (int round = 0; round < 50; ++round) {
    Transform matrix = kIdentity;
    for (size_t i = 0; i < 12; ++i) matrix[i] += unit(random);
    const Result<Placement> placement = Placement::Of(matrix);
    if (!placement.ok()) continue;
    const Vec3d p{unit(random), unit(random), unit(random)}, q{unit(random), 0, unit(random)};
    CHECK(Length(placement->At(p) - placement->At(q)) <= placement->stretch() * Length(p - q));
    const Box3d box = Grown({p, p}, 0.1);
    CHECK(Contains(placement->AroundBack(placement->Around(box)), box));
    CHECK(placement->Around(box).Contains(placement->At(p)));
  }
}

}  // namespace mtdb::testing
