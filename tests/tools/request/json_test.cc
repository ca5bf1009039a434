// SPDX-License-Identifier: Apache-2.0
// Every verb's JSON is what docs/json.md says.
#include <catch2/catch.hpp>

#include "tests/tools/http_testing.h"
#include "tests/tools/json_tables.h"

namespace mtdb::test {

TEST_CASE("every verb answers in JSON as docs/json.md has it", "[cli]") {
  JsonTables tables;
  const Folder folder;
  const auto run = [&](const Arguments& arguments) {
    INFO(Join(arguments));
    const Json answer = RunJson(arguments);
    tables.Check(answer);
    // Some verbs have answers of several kinds.
    const std::set<std::string> others{"mtdb/survey/1", "mtdb/raster/1", "mtdb/heights/1",
                                       "mtdb/raster_file/1", "mtdb/height_change/1"};
    if (arguments[0] != "info" && !others.contains(answer["schema"])) {
      CHECK(answer["schema"] == "mtdb/" + arguments[0] + "/1");
    }
  };
  const std::string store = folder.File("a.mtdb"), mesh = folder.File("a.ply");
  // With a degenerate triangle, a normal and a value of each kind of attribute.
  WriteText(mesh,
            "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
            "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
            "property float quality\nproperty uchar red\nelement face 3\n"
            "property list uchar int vertex_indices\nend_header\n"
            "0 0 0 0 0 1 0.5 1\n1 0 0 0 0 1 0.25 2\n1 1 0 0 0 1 1 3\n0 1 0.5 0 0 1 2 4\n"
            "7 7 7 0 0 1 0 0\n3 0 1 2\n3 0 2 3\n3 0 0 1\n");
  run({"info", mesh});
  run({"ingest", mesh, store, "--dry-run"});
  const std::string far = folder.File("far.obj");
  WriteText(far,
            "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.3\nv 1e9 1.1 1.3\nf 1 2 3\nf 1 3 4\nf 1 2 5\n");
  run({"info", far});
  run({"ingest", mesh, store, "--name", "patch", "--normal-bits", "10", "--attribute-step",
       "quality=0.25"});
  const std::string textured = folder.File("textured.obj");
  WriteText(folder.File("textured.mtl"), "newmtl m\nmap_Kd none.png\n");
  WriteText(textured,
            "mtllib textured.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.3\nvt 0 0\nvt 1 0\n"
            "vt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3 4/4\n");
  run({"ingest", textured, store, "--name", "textured"});
  run({"generate", "terrain", folder.File("t.ply"), "--triangles", "20k"});
  run({"ingest", folder.File("t.ply"), store, "--name", "t", "--weld", "--bits", "12"});
  const std::string raster = folder.File("a.asc");
  WriteText(raster,
            "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -9\n"
            "1 2 3\n2 5 -9\n3 1 4\n");
  run({"ingest", raster, store, "--dry-run"});
  run({"ingest", raster, store, "--name", "hills"});
  run({"probe", store, "--name", "hills", "--height", "1.5,1.5", "--height", "9,9"});
  run({"profile", store, "--name", "hills", "--line", "0,0,3,3"});
  run({"extract", store, folder.File("b.asc"), "--name", "hills"});
  run({"tile", store, folder.File("tiles"), "--name", "patch"});
  run({"info", store});
  run({"info", store, "--name", "t", "--streams"});
  run({"list", store});
  const std::string out = folder.File("out.ply");
  run({"extract", store, out, "--name", "patch"});
  run({"extract", store, out, "--name", "t", "--box=0,0,-9,1,1,9", "--error", "1e-9"});
  run({"extract", store, out, "--name", "t", "--sphere=500,0,0,1", "--triangles", "1"});
  run({"render", store, folder.File("a.png"), "--name", "patch", "--size", "30x20"});
  run({"render", store, folder.File("a.png"), "--name", "patch", "--size", "30x20", "--colour",
       "quality"});
  run({"probe", store, "--name", "t", "--point", "5,5,5", "--error", "1e-9"});
  run({"probe", store, "--name", "t", "--ray", "5,5,50,0,0,-1"});
  run({"probe", store, "--name", "t", "--ray", "5,5,50,0,0,1"});
  run({"diff", store, store, "--name", "t", "--other", "patch", "--into", folder.File("map.mtdb"),
       "map", "--geojson", folder.File("places.geojson")});
  run({"generate", "terrain", folder.File("t2.ply"), "--triangles", "20k", "--seed", "2"});
  for (const std::string name : {"t", "t2"}) {
    run({"ingest", folder.File(name + ".ply"), folder.File("hills.mtdb"), "--name", name,
         "--terrain"});
  }
  run({"diff", folder.File("hills.mtdb"), folder.File("hills.mtdb"), "--name", "t", "--other", "t2",
       "--heights", "--width", "10%"});
  const Outcome differs = Run({"diff", store, store, "--name", "t", "--other", "patch",
                               "--tolerance", "1e-6", "--reach", "0.1", "--json"});
  CHECK(differs.exit_code == 3);
  tables.Check(ParseJson(differs.out));
  for (const char* const level : {"fast", "full", "global"}) {
    run({"verify", store, "--level", level});
  }
  {
    const ServerProcess server(store);
    const std::string path = folder.File("path.jsonl");
    WriteText(path, "{\"max_triangles\": 700}\n{\"error\": 1e-9, \"max_triangles\": 5000}\n");
    run({"fetch", server.url() + "/objects/t", out, "--error", "1e-9", "--triangles", "1"});
    run({"follow", server.url() + "/objects/t", "--path", path});
  }
  run({"pack", store, folder.File("a.mtdbp")});
  run({"unpack", folder.File("a.mtdbp"), folder.File("b.mtdb")});
  run({"copy", store, folder.File("c.mtdb")});
  run({"rename", folder.File("c.mtdb"), "t", "u"});
  run({"remove", folder.File("c.mtdb"), "u", "patch"});
  run({"compact", folder.File("c.mtdb")});
  // A store that is damaged still gets an answer.
  std::filesystem::resize_file(store, std::filesystem::file_size(store) / 2);
  const Outcome damaged = Run({"verify", store, "--json"});
  CHECK(damaged.exit_code == 1);
  if (!damaged.out.empty()) tables.Check(ParseJson(damaged.out));
  // Nothing is documented that no verb says. Journals: tests/tools/cli/cli_resume_test.cc.
  for (const std::string& field : tables.NeverSeen()) {
    if (field.starts_with("journal.") || field == "mtdb/list/1.journals") continue;
    FAIL_CHECK("docs/json.md has a field that no answer had: " << field);
  }
}

}  // namespace mtdb::test
