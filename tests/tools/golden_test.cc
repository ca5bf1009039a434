// SPDX-License-Identifier: Apache-2.0
// Stores of the current format version, as files of the tree: what once could be read must go on to
// be read, byte for byte the same mesh. After a change of the format that is meant:
//
//     MTDB_WRITE_GOLDEN=1 build-test/tests/tools_test "[golden]"
//
// writes the stores and what is expected of them anew; their diff shows what the change does.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>

#include "store/base/hash.h"
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

const std::string kGolden = std::string(MTDB_SOURCE_DIR) + "/tests/golden/";
constexpr size_t kMaxStoreBytes = 64 << 10;

// A wavy sheet with a hole, vertices coloured and with a scalar.
TriangleMesh Sheet() {
  constexpr uint32_t kSide = 16;
  TriangleMesh mesh;
  mesh.header.attributes.attributes = {{"red", ScalarType::kUint8},
                                       {"green", ScalarType::kUint8},
                                       {"blue", ScalarType::kUint8},
                                       {"quality", ScalarType::kFloat32}};
  ByteWriter rows;
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      // Halves and quarters: the same floats everywhere.
      const double height = 0.25 * ((x * x + 3 * y) % 7) + 0.5 * (y / 4);
      mesh.positions.push_back({double(x), double(y), height});
      for (const uint32_t colour : {16 * x, 16 * y, 10 * ((x + y) % 3)}) {
        rows.Put(static_cast<uint8_t>(colour));
      }
      rows.Put(0.5f * static_cast<float>(x * y));
      if (x == 0 || y == 0 || (x == 7 && y == 9)) continue;
      const uint32_t v = y * kSide + x;
      mesh.triangles.push_back({v - kSide - 1, v - kSide, v});
      mesh.triangles.push_back({v - kSide - 1, v, v - 1});
    }
  }
  mesh.rows = rows.Take();
  return mesh;
}

struct Golden {
  std::string name;
  Arguments ingest;
};

std::vector<Golden> Goldens() { return {{"grid", {}}, {"lossless", {"--lossless"}}}; }

// What is expected of a store: the catalog's facts, and meshes.
Json Facts(const std::string& store, const Folder& folder) {
  Json facts;
  Json object = RunJson({"info", store}).at("objects").at(0);
  facts["object"] = object;
  for (const Arguments& query : std::vector<Arguments>{{"--full"},
                                                       {"--error", "2%"},
                                                       {"--triangles", "60"},
                                                       {"--error", "0.5%", "--box=2,2,-1,9,9,9"}}) {
    const std::string output = folder.File("mesh.ply");
    Arguments arguments{"extract", store, output};
    if (object.at("positions") == "grid") arguments.emplace_back("--double-positions");
    arguments.insert(arguments.end(), query.begin(), query.end());
    const Json answer = RunJson(arguments);
    const std::string mesh = ReadText(output);
    const std::string body = mesh.substr(mesh.find("end_header"));
    char hash[17];
    std::snprintf(hash, sizeof(hash), "%016llx",
                  static_cast<unsigned long long>(Hash64(AsBytes(body))));
    facts["meshes"].push_back({{"query", query},
                               {"triangles", answer.at("triangles")},
                               {"vertices", answer.at("vertices")},
                               {"error_bound", answer.at("error_bound")},
                               {"hash", hash}});
  }
  return facts;
}

void WriteGolden(const Golden& golden) {
  const Folder folder;
  const std::string mesh = folder.File("sheet.ply");
  const std::string store = folder.File("store.mtdb");
  auto writer = CreateMeshFileWriter(mesh);
  REQUIRE(writer.ok());
  REQUIRE(SendMesh(Sheet(), **writer).ok());
  Arguments ingest{"ingest", mesh, store, "--name", "sheet", "--threads", "1", "--quiet"};
  ingest.insert(ingest.end(), golden.ingest.begin(), golden.ingest.end());
  RunOk(ingest);
  std::filesystem::create_directories(kGolden);
  WriteText(kGolden + golden.name + ".json", TextOf(Facts(store, folder), 1) + "\n");
  WriteText(kGolden + golden.name + ".mtdb", ReadText(store));
}

TEST_CASE("stores of this format version are read as when they were written", "[cli][golden]") {
  for (const Golden& golden : Goldens()) {
    INFO(golden.name);
    if (std::getenv("MTDB_WRITE_GOLDEN") != nullptr) WriteGolden(golden);
    const std::string bytes = ReadText(kGolden + golden.name + ".mtdb");
    REQUIRE(bytes.size() > 0);
    REQUIRE(bytes.size() < kMaxStoreBytes);
    const Folder folder;
    const std::string store = folder.File("store.mtdb");
    WriteText(store, bytes);
    CHECK(RunJson({"verify", store, "--level", "full"}).at("ok") == true);
    const Json expected = ParseJson(ReadText(kGolden + golden.name + ".json"));
    const Json found = Facts(store, folder);
    INFO(TextOf(Json::diff(expected, found), 1));
    CHECK(found == expected);
  }
}

}  // namespace
}  // namespace mtdb::test
