// SPDX-License-Identifier: Apache-2.0
// The model: it says what a mesh is, and notices what is wrong with an answer.
#include "tests/everything/model.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/geometry.h"
#include "tests/everything/input_files.h"
#include "tests/everything/output_files.h"
#include "tests/everything/process.h"
#include "tests/everything/question.h"
#include "tests/support/temporary_folder.h"
#include "tools/cli/verbs/merge.h"

namespace mtdb::everything {
namespace {

TEST_CASE("what a file says is what the product's reader reads") {
  for (const FileFormat& format : FileFormats()) {
    for (const std::string& shape : ShapeNames()) {
      for (const char* line_end : {"", "cr", "crlf"}) {
        const mtdb::testing::TemporaryFolder folder;
        Step step{"ingest",
                  {{"shape", shape}, {"attr", "rgb,normal,double,short"}, {"format", format.name}}};
        if (line_end[0] != '\0') {
          step.Set("lineend", std::string(line_end));
          step.Set("polygons", 1);
          step.Set("bom", 1);
        }
        const Input input = MakeInput(step, folder.path());
        INFO(format.name << " " << shape << " " << line_end);
        TriangleMesh read;
        TriangleMeshSink sink(&read);
        std::vector<std::string> notes;
        REQUIRE(ReadMeshes(OpenMeshes(input.paths, "", "").value(), sink, &notes).ok());
        const Truth truth = MakeTruth({read}, {false});
        CHECK(truth.mesh.header.attributes == input.truth.mesh.header.attributes);
        const size_t row = truth.mesh.header.attributes.row_bytes();
        const bool same =
            TriangleKeys(truth.mesh, true, row) == TriangleKeys(input.truth.mesh, true, row);
        CHECK(same);
        CHECK(truth.report == input.truth.report);
      }
    }
  }
}

TEST_CASE("walks join triangles to faces of four corners, some of them concave") {
  for (const std::string& shape : ShapeNames()) {
    CAPTURE(shape);
    TriangleMesh mesh = MakeShape(shape, 1000, 1);
    AddDarts(1, &mesh);
    const Faces faces = JoinedFaces(mesh);
    CHECK(faces.size() < mesh.triangles.size());
    size_t corners = 0;
    for (const auto& face : faces) corners += face.size() - 2;
    CHECK(corners == mesh.triangles.size());
  }
}

TEST_CASE("walks know every format that is read or written") {
  const auto named = [](const MeshFormat& format, const std::string& extension) {
    return std::ranges::find(format.suffixes, extension) != format.suffixes.end();
  };
  for (const MeshFormat& format : ReadMeshFormats()) {
    INFO(format.name);
    CHECK(std::ranges::any_of(FileFormats(), [&](const FileFormat& f) {
      return named(format, std::string(f.extension).substr(1));
    }));
  }
  for (const MeshFormat& format : WrittenMeshFormats()) {
    INFO(format.name);
    const auto* const at = std::ranges::find_if(
        kOutputFormats, [&](const OutputFormat& f) { return named(format, f.extension); });
    REQUIRE(at != std::end(kOutputFormats));
    CHECK(at->lossy != format.exact);
  }
}

TEST_CASE("triangles that say nothing are none") {
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {9, 9, 9}};
  mesh.triangles = {{0, 1, 2}, {1, 2, 0}, {0, 2, 1}, {1, 1, 2}};
  const Truth truth = MakeTruth({mesh}, {false});
  CHECK(truth.mesh.triangles.size() == 2);
  CHECK(truth.report.duplicate_triangles == 1);
  CHECK(truth.report.degenerate_triangles == 1);
  CHECK(truth.report.unreferenced_vertices == 1);
  CHECK(truth.bounds.max == Vec3d{1, 1, 0});
  CHECK(MakeTruth({mesh, mesh}, {true, true}).mesh.positions.size() == 3);
  CHECK(MakeTruth({mesh, mesh}, {true, false}).mesh.positions.size() == 7);
}

TEST_CASE("distances are those of brute force") {
  const TriangleMesh mesh = MakeShape("tangle", 300, 3);
  const DistanceTree tree(mesh);
  for (const Vec3d p : SamplePoints(MakeShape("tetrahedra", 100, 5), 200, 1)) {
    double best = 1e300;
    for (const TriangleVertices& t : mesh.triangles) {
      best =
          std::min(best, SquaredDistancePointTriangle(p, mesh.positions[t[0]], mesh.positions[t[1]],
                                                      mesh.positions[t[2]]));
    }
    CHECK(tree.Distance(p) == Approx(std::sqrt(best)).margin(1e-12));
  }
}

TEST_CASE("points of a needle have no distance from it") {
  for (const double thin : {1e-2, 1e-3, 1e-4, 1e-6, 1e-9}) {
    TriangleMesh mesh;
    mesh.positions = {{0.1, 0.2, 0.3}, {1.3, 0.9, -0.4}, {0.9, 0.7, -0.17 + thin}};
    mesh.triangles = {{0, 1, 2}};
    const DistanceTree tree(mesh);
    for (const Vec3d p : SamplePoints(mesh, 1000, 1)) CHECK(tree.Distance(p) < 1e-15);
  }
}

TEST_CASE("a region's depth agrees with the region") {
  const Truth truth = MakeTruth({MakeShape("sheet", 200, 1)}, {false});
  const std::vector<Vec3d> points = SamplePoints(truth.mesh, 300, 2);
  for (const std::string& region : RegionNames()) {
    for (const char* outside : {"0", "1"}) {
      Step step{"ask", {{"region", region}, {"at", "0.4,0.5,0.5"}, {"outside", outside}}};
      const Question question = MakeQuestion(step, truth, truth.diagonal());
      for (const Vec3d p : points) {
        const double depth = question.depth(p);
        INFO(region << " " << outside << " " << depth);
        if (depth > 1e-9) {
          CHECK(question.query.region->Within({p, p, p}, 0));
          CHECK(question.query.region->Covers({p, p, p}, depth * 0.99));
        }
        if (depth < -1e-9) CHECK_FALSE(question.query.region->Within({p, p, p}, 0));
      }
    }
  }
}

TEST_CASE("a child's end, output and signals are told") {
  const mtdb::testing::TemporaryFolder folder;
  const Ran said = Run({"/bin/sh", "-c", "echo a; echo b >&2; exit 3"}, folder.path());
  CHECK(said.exit_code == 3);
  CHECK(said.out == "a\n");
  CHECK(said.err == "b\n");
  CHECK(Run({"/bin/sh", "-c", "kill -9 $$"}, folder.path()).signal == 9);
  CHECK(Run({"/bin/sleep", "100"}, folder.path(), {.timeout_seconds = 0.1}).timed_out);
  CHECK(Run({"/bin/sleep", "100"}, folder.path(), {.kill_when = [] { return true; }}).killed);
}

}  // namespace
}  // namespace mtdb::everything
