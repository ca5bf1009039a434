// SPDX-License-Identifier: Apache-2.0
// Files with sheets that meet: what they have, how coarse they become, and what is promised of it.
//
//     MTDB_PRINT_SHEETS=1 MTDB_SHEET_FILES=a.ply:b.obj build-test/tests/sheets_test "[files]"
//
// says so for files of one's own, too.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <optional>

#include "bench/internal/hausdorff.h"
#include "codecs/mesh_file/mesh_file.h"
#include "tests/builder/fixture.h"
#include "tests/sheets/cut_check.h"
#include "tests/sheets/mesh_of.h"
#include "tests/sheets/sheet_graph.h"
#include "tools/generate/generate.h"

namespace mtdb::sheets {
namespace {

using mtdb::testing::Build;
using mtdb::testing::BuiltObject;
using mtdb::testing::Extract;

// What is smaller than the error vanishes whole.
constexpr CutCheckOptions kCutOptions{.patches_may_vanish = true};

// A square of n x n vertices on a lattice, all of whose faces have opposites, as programs write
// that draw both sides.
TriangleMesh TwoSidedSquare(VertexIndex n) {
  TriangleMesh mesh;
  for (VertexIndex i = 0; i < n * n; ++i) {
    const VertexIndex x = i / n, y = i % n;
    mesh.positions.push_back({static_cast<double>(x), static_cast<double>(y),
                              0.125 * static_cast<double>((x * x + y) % 7)});
  }
  for (VertexIndex i = 0; i + n < n * n; ++i) {
    if (i % n + 1 == n) continue;
    for (const TriangleVertices& t :
         {TriangleVertices{i, i + n, i + n + 1}, {i, i + n + 1, i + 1}}) {
      mesh.triangles.push_back(t);
      mesh.triangles.push_back({t[2], t[1], t[0]});
    }
  }
  return mesh;
}

std::optional<TriangleMesh> Read(const std::string& path) {
  if (!std::filesystem::exists(path)) {
    WARN("skipped: no " << path);
    return std::nullopt;
  }
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MeshReadReport report;
  const Status status = ReadMeshFile(path, sink, &report);
  INFO(status.message());
  REQUIRE(status.ok());
  return mesh;
}

std::string CreasesOf(const SheetGraph& graph) {
  std::map<std::string, uint64_t> count;
  for (const Edge& edge : graph.edges()) {
    const Signature& s = edge.signature;
    if (s.regular()) continue;
    const uint32_t sheets = s.along + s.against + s.two_sided;
    const bool flag = sheets == 2 && s.two_sided == 1, against = sheets == 2 && !flag;
    ++count[flag ? "flag border" : against ? "disagreeing" : std::to_string(sheets)];
  }
  std::string text;
  for (const auto& [order, edges] : count) text += ", " + order + ": " + std::to_string(edges);
  return text.empty() ? ", none" : text;
}

// Cuts of the object against all of it, whose vertices are where the store has rounded them.
void CheckCuts(const std::string& name, const TriangleMesh& input) {
  const BuiltObject built = Build(input);
  const TriangleMesh whole = Extract(*built.surface, Query{});
  const Complex complex = ComplexOf(whole);
  const SheetGraph before(ComplexOf(input)), graph(complex);
  CHECK(graph.opposite_pairs() == before.opposite_pairs());
  CHECK(graph.chains().size() == before.chains().size());
  CHECK(graph.components() == before.components());
  CHECK(graph.euler() == before.euler());
  std::string text = name + ": " + std::to_string(whole.triangles.size()) + " triangles, " +
                     std::to_string(graph.opposite_pairs()) + " opposite pairs; creases by sheets" +
                     CreasesOf(graph) + "; " + std::to_string(graph.chains().size()) + " chains";
  const HausdorffMeter meter(input, 200'000);
  for (const double part : {1.0, 1 / 128.0, 1 / 1024.0}) {
    Query query;
    query.threshold = ConstantThreshold(built.record.diagonal() * part);
    ExtractStats stats;
    const TriangleMesh cut = Extract(*built.surface, query, &stats);
    INFO(name << ", " << cut.triangles.size() << " triangles");
    const CutReport report = CheckCut(complex, ComplexOf(cut), kCutOptions);
    INFO(report.Text());
    CHECK(report.ok());
    const double distance = meter.Distance(cut);
    CHECK(distance <= stats.error_bound * (1 + 1e-9) + 1e-12 * built.record.diagonal());
    text +=
        (part == 1 ? "; fewest " : "; ") + std::to_string(cut.triangles.size()) +
        " (measured / promised " +
        (distance > 1e-12 * built.record.diagonal() ? std::to_string(distance / stats.error_bound)
                                                    : "0 / 0") +
        ")";
  }
  if (std::getenv("MTDB_PRINT_SHEETS") != nullptr) WARN(text);
}

}  // namespace

TEST_CASE("Cuts of files with two-sided faces and sheets that meet are right", "[files]") {
  CheckCuts("two-sided square", TwoSidedSquare(40));
  TriangleMesh generated;
  TriangleMeshSink sink(&generated);
  REQUIRE(GenerateSheets({.triangles = 20'000, .seed = 1}, sink).ok());
  CheckCuts("generated sheets", generated);
  const std::string data = std::string(MTDB_SOURCE_DIR) + "/../shared/data/";
  std::vector<std::string> paths{data + "dragon_res2_ascii_nonmanifold.ply"};
  if (const char* more = std::getenv("MTDB_SHEET_FILES")) {
    std::istringstream list(more);
    for (std::string path; std::getline(list, path, ':');) paths.push_back(path);
  }
  for (const std::string& path : paths) {
    const std::optional<TriangleMesh> mesh = Read(path);
    if (mesh) CheckCuts(std::filesystem::path(path).filename().string(), *mesh);
  }
}

}  // namespace mtdb::sheets
