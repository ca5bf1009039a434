// SPDX-License-Identifier: Apache-2.0
// Damaged inputs and damaged stores: one clear line, nothing written, no crash, no wrong mesh.
#include <catch2/catch.hpp>
#include <random>

#include "store/database.h"
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

std::string AsciiPly(const std::string& vertices, const std::string& count = "3") {
  return "ply\nformat ascii 1.0\nelement vertex " + count +
         "\nproperty float x\nproperty float y\nproperty float z\n"
         "element face 1\nproperty list uchar int vertex_indices\nend_header\n" +
         vertices + "3 0 1 2\n";
}

std::string BinaryPlyHeader(const std::string& vertices, const std::string& faces) {
  return "ply\nformat binary_little_endian 1.0\nelement vertex " + vertices +
         "\nproperty float x\nproperty float y\nproperty float z\nelement face " + faces +
         "\nproperty list uchar int vertex_indices\nend_header\n";
}

struct BadInput {
  std::string name, bytes;
  Arguments words;  // in the message, beside the file's name
};

std::vector<BadInput> BadInputs() {
  const std::string good = ReadText(SmallExample().mesh);
  return {
      {"empty.ply", "", {"empty"}},
      {"empty.obj", "", {"empty"}},
      {"empty.stl", "", {"empty"}},
      {"empty.off", "", {"empty"}},
      {"header.ply", good.substr(0, 60), {}},
      {"quarter.ply", good.substr(0, good.size() / 4), {"vertex"}},
      {"nearly.ply", good.substr(0, good.size() - 1), {"face"}},
      {"text.ply", "Dear diary,\ntoday I measured a statue.\n", {"ply"}},
      {"text.txt",
       "Dear diary,\ntoday I measured a statue.\n",
       {"PLY, OBJ, STL, OFF, glTF, Draco or glTF JSON"}},
      {"text.stl", "Dear diary,\ntoday I measured a statue.\n", {}},
      {"text.off", "Dear diary,\ntoday I measured a statue.\n", {}},
      {"huge.ply", BinaryPlyHeader("4000000000", "4000000000"), {"4000000000"}},
      {"vast.ply", BinaryPlyHeader("18446744073709551615", "1"), {}},
      {"endless.ply", BinaryPlyHeader("99999999999999999999999", "1"), {}},
      {"negative.ply", BinaryPlyHeader("-1", "1"), {}},
      {"nan.ply", AsciiPly("0 0 0\n1 0 0\n0 nan 0\n"), {"vertex 2", "y"}},
      {"far.ply", AsciiPly("0 0 0\n1 0 0\n0 0 -2e30\n"), {"vertex 2", "z is -2e+30", "1e30"}},
      {"far.obj", "v 0 0 0\nv 1 1e200 0\nv 0 1 0\nf 1 2 3\n", {"line 2", "y is 1e+200"}},
      {"far.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n1e99 1 0\n3 0 1 2\n", {"line 5", "1e+99"}},
      {"far.asc",
       "ncols 2\nnrows 2\nxllcorner 1e200\nyllcorner 0\ncellsize 1\n1 2\n3 4\n",
       {"geotransform", "1e30"}},
      {"infinite.ply", AsciiPly("0 0 0\n1 0 0\n0 0 1e999\n"), {"vertex 2"}},
      {"word.ply", AsciiPly("0 0 0\n1 0 0\n0 zero 0\n"), {"zero"}},
      {"range.ply", AsciiPly("0 0 0\n1 0 0\n", "2"), {"2"}},
      {"one.ply", AsciiPly("0 0 0\n", "1"), {}},
      {"points.ply",
       "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float "
       "y\nproperty float z\nend_header\n0 0 0\n",
       {}},
      {"nan.obj", "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", {"line 2"}},
      {"range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", {"line 4", "4"}},
      {"none.obj", "# a comment\n", {}},
      {"cut.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", {}},
      {"huge.off", "OFF\n4000000000 4000000000 0\n0 0 0\n", {"4000000000"}},
      {"cut.stl", std::string(80, ' ') + std::string("\x09\0\0\0", 4) + std::string(70, 'x'), {}},
      {"cut_text.stl", "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1", {}},
  };
}

// Bytes that fail nowhere but in the mesh itself: no triangle is left.
const char kSameCorners[] =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
    "z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n3 0 1 1\n";

TEST_CASE("ingest of a bad file says file and place, and touches no store", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("store.mtdb");
  const std::string fresh = folder.File("fresh.mtdb");
  RunOk({"ingest", SmallExample().mesh, store, "--quiet"});
  const std::string before = ReadText(store);
  std::vector<BadInput> inputs = BadInputs();
  inputs.push_back({"degenerate.ply", kSameCorners, {"triangle"}});
  for (const BadInput& input : inputs) {
    const std::string path = folder.File(input.name);
    WriteText(path, input.bytes);
    Arguments words = input.words;
    words.push_back(path);
    RunFails(1, {"ingest", path, store, "--quiet"}, words);
    RunFails(1, {"ingest", path, fresh, "--quiet"}, words);
    CHECK_FALSE(Exists(fresh));
  }
  const std::string directory = folder.File("directory.ply");
  std::filesystem::create_directory(directory);
  const std::string missing = folder.File("missing.ply");
  for (const std::string& path : {directory, missing}) {
    RunFails(1, {"ingest", path, store, "--quiet"}, {path});
    RunFails(1, {"ingest", path, fresh, "--quiet"}, {path});
  }
  CHECK_FALSE(Exists(fresh));
  CHECK_FALSE(Exists(fresh + "-lock"));
  CHECK(ReadText(store) == before);
}

TEST_CASE("a mesh cut off anywhere is an error", "[cli]") {
  const Folder folder;
  const std::string good = ReadText(SmallExample().mesh);
  const std::string path = folder.File("cut.ply");
  std::mt19937_64 random(5);
  for (int i = 0; i < 25; ++i) {
    WriteText(path, good.substr(0, random() % good.size()));
    RunFails(1, {"ingest", path, folder.File("s.mtdb"), "--quiet"}, {path});
  }
  CHECK_FALSE(Exists(folder.File("s.mtdb")));
}

TEST_CASE("an output that cannot be written is one line", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  std::filesystem::create_directory(folder.File("taken.ply"));
  RunFails(1, {"extract", example.store, folder.File("no/out.ply")}, {"no/out.ply"});
  RunFails(1, {"extract", example.store, folder.File("taken.ply")}, {"taken.ply"});
  for (const std::string name : {"out.xyz", "out", "out.mtdb"}) {
    RunFails(2, {"extract", example.store, folder.File(name)}, {name, ".ply, .obj, .stl, .off"});
  }
  RunFails(1, {"ingest", example.mesh, folder.File("no/s.mtdb"), "--quiet"}, {"no/s.mtdb"});
  const std::string err = folder.File("err");
  for (const Arguments& arguments :
       std::vector<Arguments>{{"list", example.store}, {"info", example.store, "--json"}}) {
    CHECK(Finish(Start(arguments, "/dev/full", err)).exit_code == 1);
    CHECK(IsOneLine(ReadText(err)));
  }
}

// Every verb that opens the file, which is not a whole store, says so.
void CheckRefused(const std::string& store, const Folder& folder) {
  const std::string before = ReadText(store);
  const std::string output = folder.File("refused.ply");
  if (!IsMeshFile(store)) RunFails(1, {"info", store}, {store});
  RunFails(1, {"list", store, "--json"}, {store});
  RunFails(1, {"extract", store, output}, {store});
  RunFails(1, {"render", store, folder.File("refused.png")}, {store});
  RunFails(1, {"remove", store, "sculpture"}, {store});
  const Outcome verify = Run({"verify", store});
  INFO(store << "\n" << verify.out << verify.err);
  CHECK(verify.exit_code == 1);
  CHECK_THAT(verify.out + verify.err, Catch::Contains(store));
  CHECK((verify.out.empty() ? IsOneLine(verify.err) : verify.err.empty()));
  // Of one that was cut off before its second page nothing tells that it was one.
  if (!before.empty() && !Database::NothingStored(store)) {
    RunFails(1, {"ingest", SmallExample().mesh, store, "--quiet"}, {store});
  }
  CHECK(ReadText(store) == before);
  CHECK_FALSE(Exists(output));
}

TEST_CASE("a truncated store, a text, an empty file and a folder are refused", "[cli]") {
  const Folder folder;
  const std::string good = ReadText(SmallExample().store);
  const std::string store = folder.File("store.mtdb");
  for (const size_t length :
       {size_t{0}, size_t{1}, size_t{100}, size_t{4095}, size_t{4096}, size_t{8191}, size_t{8192},
        size_t{12288}, good.size() / 2, good.size() - 4096, good.size() - 1}) {
    INFO("the first " << length << " of " << good.size() << " bytes");
    WriteText(store, good.substr(0, length));
    CheckRefused(store, folder);
  }
  WriteText(store, "ply\nthis is no store\n" + std::string(20000, 'x'));
  CheckRefused(store, folder);
  CheckRefused(SmallExample().mesh, folder);
  std::filesystem::create_directory(folder.File("folder.mtdb"));
  CheckRefused(folder.File("folder.mtdb"), folder);
  CheckRefused(folder.File("missing.mtdb"), folder);
  CHECK_FALSE(Exists(folder.File("missing.mtdb")));
  // What a process leaves that was killed while it made the store.
  WriteText(store, "");
  RunOk({"ingest", SmallExample().mesh, store, "--quiet"});
  CHECK(RunJson({"verify", store, "--level", "full"}).at("ok") == true);
}

TEST_CASE("a flipped byte is reported or harmless, and never gives a wrong mesh", "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string good = ReadText(example.store);
  const std::string mesh = ReadText(example.full);
  const std::string store = folder.File("store.mtdb");
  const std::string output = folder.File("out.ply");
  std::mt19937_64 random(2024);
  int reported = 0;
  for (int i = 0; i < 150; ++i) {
    std::string bytes = good;
    size_t at = random() % bytes.size();
    // Every other one not in slack, which is zero.
    while (i % 2 == 0 && bytes[at] == 0) at = random() % bytes.size();
    const auto flip = static_cast<char>(1 + random() % 255);
    bytes[at] = static_cast<char>(bytes[at] ^ flip);
    INFO("byte " << at << " changed by " << static_cast<int>(flip));
    WriteText(store, bytes);

    const Outcome verify = Run({"verify", store, "--json"});
    INFO(verify.out << verify.err);
    REQUIRE(verify.signal == 0);
    REQUIRE((verify.exit_code == 0 || verify.exit_code == 1));
    const bool ok = verify.exit_code == 0;
    if (!ok) ++reported;
    if (verify.out.empty()) {
      CHECK(IsOneLine(verify.err));
    } else {
      const Json json = ParseJson(verify.out);
      CHECK(json.at("ok") == ok);
      CHECK(json.at("failures").empty() == ok);
    }

    std::filesystem::remove(output);
    const Outcome extract = Run({"extract", store, output});
    INFO(extract.out << extract.err);
    REQUIRE(extract.signal == 0);
    if (extract.exit_code == 0) {
      CHECK(ReadText(output) == mesh);
    } else {
      CHECK(extract.exit_code == 1);
      CHECK(IsOneLine(extract.err));
      CHECK_FALSE(Exists(output));
      CHECK_FALSE(ok);  // what stops a reader is found by verify
    }
  }
  CHECK(reported > 75);
}

}  // namespace
}  // namespace mtdb::test
