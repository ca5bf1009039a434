// SPDX-License-Identifier: Apache-2.0
// One row more in the table of mesh formats, and the whole program knows the format: it is read,
// written, served, fetched, and named wherever formats are.
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

constexpr const char* kTetrahedron =
    "toy 4 4\n0 0 0\n1 0 0\n0 1 0\n0 0 0.25\n0 2 1\n0 1 3\n1 2 3\n2 0 3\n";

// Of a tetrahedron, with the positions in any order.
void CheckTetrahedron(const std::string& text) {
  INFO(text);
  CHECK(text.starts_with("toy 4 4\n"));
  for (const char* p : {"\n0 0 0\n", "\n1 0 0\n", "\n0 1 0\n", "\n0 0 0.25\n"}) {
    CHECK_THAT(text, Catch::Contains(p));
  }
}

TEST_CASE("a format of one row is read and written by every verb") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  // By what it begins with, whatever its name.
  WriteText(folder.File("a.xyz"), kTetrahedron);
  const Json made = RunJson({"ingest", folder.File("a.xyz"), store, "--lossless", "--quiet"});
  CHECK(made.at("triangles") == 4);
  for (const char* name : {"b.toy", "c.TOYTOWN"}) {
    RunOk({"extract", store, folder.File(name)});
    CheckTetrahedron(ReadText(folder.File(name)));
  }
  CHECK(ReadMesh(folder.File("b.toy")).triangles.size() == 4);
  RunOk({"generate", "terrain", folder.File("t.toy"), "--triangles", "500"});
  RunOk({"ingest", folder.File("t.toy"), store, "--quiet"});

  const ServerProcess server(store);
  const HttpAnswer answer = server.Get("/objects/a/mesh?format=toy");
  CHECK(answer.status == 200);
  CHECK(answer.header("Content-Type") == "model/toy");
  CheckTetrahedron(answer.body);
  RunOk({"fetch", server.url() + "/objects/a", folder.File("d.toy")});
  CHECK(ReadText(folder.File("d.toy")) == answer.body);
  WriteText(folder.File("path"), R"({"threshold": "full"})");
  RunOk({"follow", server.url() + "/objects/a", "--path", folder.File("path"), "--output",
         folder.File("step-%d.toy")});
  CHECK_FALSE(ReadText(folder.File("step-1.toy")).empty());
}

TEST_CASE("a format of one row is named in help and in messages") {
  const Folder folder;
  CHECK_THAT(RunOk({"help", "extract"}), Catch::Contains(".glb .drc .toy .toytown"));
  CHECK_THAT(RunOk({"help", "ingest"}), Catch::Contains(".gltf .toy .toytown"));
  WriteText(folder.File("a.toy"), kTetrahedron);
  const std::string store = folder.File("s.mtdb");
  RunOk({"ingest", folder.File("a.toy"), store, "--quiet"});
  RunFails(2, {"extract", store, folder.File("a.png")}, {".glb, .drc or .toy"});
  WriteText(folder.File("bad"), "nothing");
  RunFails(1, {"ingest", folder.File("bad"), store, "--quiet"}, {"glTF JSON or Toy"});
  WriteText(folder.File("bad.toy"), "toy 3 1 0 0 0 x");
  RunFails(1, {"ingest", folder.File("bad.toy"), store, "--quiet"}, {"bad.toy: line 1"});
  const ServerProcess server(store);
  CHECK_THAT(server.Get("/objects/a/mesh?format=x").error(),
             Catch::Contains("format: expected ply, obj, stl, off, glb, drc or toy, found 'x'"));
  CHECK(server.Get("/objects/a/mesh?format=toytown").status == 400);
}

}  // namespace
}  // namespace mtdb::test
