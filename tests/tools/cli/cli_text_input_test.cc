// SPDX-License-Identifier: Apache-2.0
// What the command line tells of files that are read otherwise than they say.
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

void WriteFile(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

// Of a full extraction.
double AreaIn(const Folder& folder, const std::string& store) {
  const std::string obj = folder.File("area.obj");
  RunOk({"extract", store, obj, "--full"});
  const TriangleMesh mesh = testing::ReadMesh(obj);
  double area = 0;
  for (const TriangleVertices& t : mesh.triangles) {
    const Vec3d p = mesh.positions[t[0]];
    area += Length(Cross(mesh.positions[t[1]] - p, mesh.positions[t[2]] - p)) / 2;
  }
  return area;
}

}  // namespace

TEST_CASE("ingest covers concave faces, and tells of those that cross themselves", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const std::string arrow = folder.File("arrow.obj");
  WriteFile(arrow, "v 0 2 0\nv 1 -2 0\nv 2 2 0\nv 1 1 0\nf 1 2 3 4\n");
  const std::string good = RunOk({"ingest", arrow, store});
  CHECK_THAT(good, !Catch::Contains("note:"));
  CHECK(AreaIn(folder, store) == 3);
  const std::string bow = folder.File("bow.obj");
  WriteFile(bow, "v 0 0 0\nv 4 4 0\nv 4 0 0\nv 0 4 0\nv 9 nan 9\nf 1 2 3 4\nf 1 3 2 4\n");
  const std::string crossing = RunOk({"ingest", bow, store, "--name", "b", "--json"});
  const Json notes = ParseJson(crossing).at("notes");
  REQUIRE(notes.size() == 2);
  CHECK_THAT(notes[0].get<std::string>(),
             Catch::Contains("1 of 2 polygons have outlines that cross"));
  CHECK_THAT(notes[1].get<std::string>(), Catch::Contains("1 vertices left out"));
}

TEST_CASE("ingest tells of holes that an ASCII grid does not name, and refuses what is left over",
          "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const std::string grid = folder.File("g.asc");
  const std::string header = "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
  WriteFile(grid, "\xef\xbb\xbf" + header + "1 2 3\n4 -9999 6\n7 8 9\n");
  CHECK_THAT(RunOk({"ingest", grid, store}),
             Catch::Contains("no NODATA_value line: 1 samples of -9999 count as holes"));
  WriteFile(grid, header + "1 2 3 7\n4 5 6 7\n7 8 9 7\n");
  RunFails(1, {"ingest", grid, store, "--name", "more", "--quiet"},
           {"line 8", "3 more are left", "line 6 has 4"});
  const std::string packed = folder.File("N00E010.hgt.gz");
  WriteFile(packed, std::string("\x1f\x8b\x08\0\0\0", 6));
  RunFails(1, {"ingest", packed, store, "--name", "packed", "--quiet"},
           {packed, "decompress it first"});
}

}  // namespace mtdb::test
