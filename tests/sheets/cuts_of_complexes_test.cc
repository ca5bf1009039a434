// SPDX-License-Identifier: Apache-2.0
// What meets in the input meets in every cut: random complexes, built and cut, held against the
// checker.
#include <catch2/catch.hpp>
#include <cstdlib>

#include "tests/builder/fixture.h"
#include "tests/sheets/cut_check.h"
#include "tests/sheets/mesh_of.h"
#include "tests/sheets/random_complex.h"
#include "tests/sheets/sheet_graph.h"

namespace mtdb::sheets {
namespace {

using mtdb::testing::Build;
using mtdb::testing::BuiltObject;
using mtdb::testing::Extract;
using mtdb::testing::RandomCutQuery;

// What is smaller than the error vanishes whole; at full resolution all is there.
CutCheckOptions OptionsOf(int cut) { return {.patches_may_vanish = cut != 0}; }

// Set to try other complexes than the first, or more: MTDB_SHEET_SEEDS=100..200.
std::pair<uint32_t, uint32_t> Seeds() {
  const char* set = std::getenv("MTDB_SHEET_SEEDS");
  const std::string text = set == nullptr ? "0..2" : set;
  const size_t dots = text.find("..");
  REQUIRE(dots != std::string::npos);
  return {static_cast<uint32_t>(std::stoul(text)),
          static_cast<uint32_t>(std::stoul(text.substr(dots + 2)))};
}

BuildOptions Options(uint32_t seed) {
  BuildOptions options;
  options.step = kLatticeStep;
  options.tile_triangles = seed % 2 == 0 ? 64 : 512;
  return options;
}

// The whole surface, as coarse as it goes, at errors between, and as it came; then anything.
Query QueryOf(int cut, const ObjectRecord& record, std::mt19937& random) {
  Query query;
  if (cut == 0) return query;
  if (cut == 1) {
    query.threshold = CoarsestThreshold();
  } else if (cut < 6) {
    query.threshold = ConstantThreshold(record.diagonal() * std::exp2(-2 * cut));
  } else {
    query = RandomCutQuery(record, random);
  }
  return query;
}

struct Tally {
  uint64_t cuts = 0, coarser = 0, measured = 0, chains = 0;
  uint64_t triangles = 0, coarsest = 0;
  uint64_t vanished = 0;  // patches, in all cuts
  double nearest = 0;     // measured over promised, at most
};

void CheckOne(Shape shape, uint32_t seed, Tally* tally) {
  INFO(NameOf(shape) << ", seed " << seed);
  const RandomComplex made = MakeRandomComplex(shape, seed);
  const BuiltObject built = Build(MeshOf(made.complex), Options(seed));
  CHECK(built.record.input.duplicate_triangles == made.duplicates);
  CHECK(built.record.rounding_error == 0);
  const SheetGraph graph(made.complex);
  tally->chains += graph.chains().size();
  tally->triangles += made.complex.triangles.size() - made.duplicates;
  std::mt19937 random(seed);
  const double size = built.record.diagonal();
  for (int cut = 0; cut < 9; ++cut) {
    const Query query = QueryOf(cut, built.record, random);
    ExtractStats stats;
    const Complex mesh = ComplexOf(Extract(*built.surface, query, &stats));
    CAPTURE(cut, stats.triangles, stats.error_bound);
    const CutReport report = CheckCut(made.complex, mesh, OptionsOf(cut));
    INFO(report.Text());
    CHECK(report.ok());
    tally->vanished += report.vanished_patches;
    ++tally->cuts;
    if (cut == 0) CHECK(mesh.triangles.size() == made.complex.triangles.size() - made.duplicates);
    if (cut == 1) tally->coarsest += mesh.triangles.size();
    tally->coarser += mesh.triangles.size() < made.complex.triangles.size() - made.duplicates;
    if (query.region != nullptr) continue;
    const double distance = std::max(LargestDistance(made.complex, mesh, size / 100),
                                     LargestDistance(mesh, made.complex, size / 100));
    CHECK(distance <= stats.error_bound + 1e-9 * size);
    if (stats.error_bound > 0) {
      tally->nearest = std::max(tally->nearest, distance / stats.error_bound);
      ++tally->measured;
    }
  }
}

}  // namespace

TEST_CASE("What meets in the input meets in every cut, edge for edge") {
  const auto [first, last] = Seeds();
  for (uint32_t shape = 0; shape < kShapes; ++shape) {
    Tally tally;
    for (uint32_t seed = first; seed <= last; ++seed) {
      CheckOne(static_cast<Shape>(shape), seed, &tally);
    }
    if (std::getenv("MTDB_PRINT_SHEETS") != nullptr) {
      WARN(NameOf(static_cast<Shape>(shape))
           << ": " << tally.cuts << " cuts, " << tally.chains << " chains, fewest "
           << tally.coarsest << " of " << tally.triangles << " triangles, vanished "
           << tally.vanished << ", measured / promised " << tally.nearest);
    }
    CHECK(tally.coarser > 0);
    CHECK(tally.measured > 0);
    CHECK(tally.nearest > 0.5);
  }
}

}  // namespace mtdb::sheets
