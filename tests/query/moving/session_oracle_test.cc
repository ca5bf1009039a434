// SPDX-License-Identifier: Apache-2.0
// A session's cuts against those of Surface::Select, and its updates against the meshes of both.
#include <catch2/catch.hpp>
#include <random>
#include <vector>

#include "query/query_control.h"
#include "query/session.h"
#include "query/surface.h"
#include "tests/query/explicit_mesh.h"
#include "tests/query/late_source.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {
namespace {

Query RandomStep(const MtFixture& f, std::mt19937& random) {
  Query query = RandomQuery(f, random);
  if (random() % 3 == 0) query.max_triangles = random() % 400;
  return query;
}

}  // namespace

TEST_CASE("a session's cuts are those of Select and its updates lead from one to the next") {
  uint32_t seed = 1;
  for (const Shape shape : {Shape::kSphere, Shape::kTorus, Shape::kSheet, Shape::kTube}) {
    for (const bool coincident : {false, true}) {
      MtOptions options;
      options.shape = shape;
      options.coincident = coincident;
      options.attributes = coincident;
      options.seed = ++seed;
      const MtFixture f = MakeMt(options);
      const auto surface = *Surface::Open(AsTested(f.source));
      const auto session = *Session::Open(surface);
      ExplicitMesh mesh(*session->Base());
      std::mt19937 random(seed);
      for (int step = 0; step < 60; ++step) {
        const Query query = RandomStep(f, random);
        const Cut cut = *surface->Select(query);
        std::vector<UpdateBatch> batches;
        const Result<SessionUpdate> update = session->Update(query, &batches);
        REQUIRE(update.ok());
        std::vector<bool> applied;
        for (const InMemoryMt::Node& node : f.mt.nodes) {
          applied.push_back(session->applied(node.cluster, node.index));
          REQUIRE(applied.back() == cut.applied(node.cluster, node.index));
        }
        uint64_t nodes[2] = {0, 0};
        bool inserts = false;
        for (const UpdateBatch& batch : batches) {
          REQUIRE(!batch.nodes.empty());
          REQUIRE(batch.insert >= inserts);  // removals first
          inserts = batch.insert;
          nodes[batch.insert ? 1 : 0] += batch.nodes.size();
          mesh.Apply(batch);
        }
        REQUIRE(nodes[0] == update->removals);
        REQUIRE(nodes[1] == update->insertions);
        REQUIRE(mesh.Positions() == CutPositions(f, applied));
        REQUIRE(update->stats.triangles == mesh.Positions().size());
      }
      // Back to the root: nothing is left.
      Query coarsest;
      coarsest.threshold = CoarsestThreshold();
      std::vector<UpdateBatch> batches;
      REQUIRE(session->Update(coarsest, &batches).ok());
      REQUIRE(session->applied_count() == 0);
    }
  }
}

TEST_CASE("a session goes from any budget to any other, and after errors, with its client") {
  std::mt19937 random(77);
  for (uint32_t seed = 0; seed < 6; ++seed) {
    MtOptions options;
    options.shape = static_cast<Shape>(seed % 4);
    options.seed = 300 + seed;
    const MtFixture f = MakeMt(options);
    const auto surface = *Surface::Open(f.source);
    const auto session = *Session::Open(surface);
    ExplicitMesh mesh(*session->Base());
    for (int step = 0; step < 120; ++step) {
      Query query = RandomQuery(f, random);
      switch (random() % 5) {
        case 0: query.max_triangles = random() % 400; break;
        case 1: query.max_bytes = random() % 20000; break;
        case 2: query.max_milliseconds = 1000 * (random() % 2); break;
        default: break;
      }
      const bool refuses = random() % 4 == 0;
      const BatchSink take = [&](std::span<const UpdateBatch> batches) {
        if (refuses) return Status(StatusCode::kBudgetExceeded, "the client has no room");
        for (const UpdateBatch& batch : batches) mesh.Apply(batch);
        return Status::Ok();
      };
      const Result<SessionUpdate> update = session->Update(query, take);
      REQUIRE((update.ok() || update.status().code() == StatusCode::kBudgetExceeded));
      std::vector<bool> applied;
      for (const InMemoryMt::Node& node : f.mt.nodes) {
        applied.push_back(session->applied(node.cluster, node.index));
      }
      REQUIRE(mesh.Positions() == CutPositions(f, applied));
    }
  }
}

TEST_CASE("an update that fails or is cancelled leaves the session's cut as it was") {
  const MtFixture f = MakeMt({});
  const auto surface = *Surface::Open(AsTested(f.source), {.cache_bytes = 1});
  const auto session = *Session::Open(surface);
  std::vector<UpdateBatch> batches;
  QueryControl control;
  control.Cancel();
  Query query;
  query.control = &control;
  const Result<SessionUpdate> cancelled = session->Update(query, &batches);
  REQUIRE(!cancelled.ok());
  CHECK(batches.empty());
  CHECK(session->applied_count() == 0);

  const auto roomy = *Surface::Open(AsTested(f.source));
  const auto other = *Session::Open(roomy);
  f.source->on_read_ = [](uint32_t unit) {
    return unit == 0 ? IoError("the disk is gone") : Status::Ok();
  };
  const Result<SessionUpdate> failed = other->Update({}, &batches);
  REQUIRE(!failed.ok());
  CHECK(failed.status().code() == StatusCode::kIoError);
  CHECK(other->applied_count() == 0);
  f.source->on_read_ = nullptr;
  REQUIRE(other->Update({}, &batches).ok());
  CHECK(other->applied_count() == f.mt.nodes.size());
}

}  // namespace mtdb::testing
