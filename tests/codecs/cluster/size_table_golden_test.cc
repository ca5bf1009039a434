// SPDX-License-Identifier: Apache-2.0
// The bytes of every stream of a few payloads, as a table in tests/golden/cluster_sizes.txt: a
// change of the codec is reviewed as a diff of it. MTDB_WRITE_GOLDEN=1 writes it anew.
#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "codecs/cluster/cluster_codec.h"
#include "tests/codecs/cluster_fixture.h"
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb::testing {
namespace {

struct Row {
  const char* name;
  ClusterOptions options;
};

const Row kRows[] = {
    {"torus", {}},
    {"large torus", {.side = 60, .seed = 12}},
    {"large sheet", {.surface = Surface::kSheet, .side = 60, .seed = 11}},
    {"pierced sheet", {.surface = Surface::kSheet, .side = 40, .pierced = true, .seed = 3}},
    {"twenty children", {.side = 40, .children = 20, .seed = 5}},
    {"lossless",
     {.surface = Surface::kSheet, .side = 40, .numbers = Numbers::kLossless, .seed = 6}},
    {"coinciding", {.numbers = Numbers::kCoincident, .seed = 8}},
    {"terrain", {.surface = Surface::kTerrain, .side = 40, .keep = 0.1, .seed = 13}},
    {"attributes", {.side = 40, .attributes = true, .seed = 9}},
};

std::string Line(const char* mesh, size_t nodes, const char* stream, size_t raw, size_t coded) {
  char line[128];
  std::snprintf(line, sizeof(line), "%-16s %6zu  %-16s %7zu %7zu %9.3f\n", mesh, nodes, stream, raw,
                coded, 8.0 * static_cast<double>(coded) / static_cast<double>(nodes));
  return line;
}

std::string Table() {
  std::string table = "mesh              nodes  stream               raw   coded bits/node\n";
  for (const Row& row : kRows) {
    const ClusterFixture fixture = MakeCluster(row.options);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    const size_t nodes = fixture.updates.nodes.size();
    size_t raw = 0;
    size_t coded = 0;
    for (const StreamSize& s : ClusterStreamSizes(encoded.payload)) {
      table += Line(row.name, nodes, s.name, s.raw_bytes, s.coded_bytes);
      raw += s.raw_bytes;
      coded += s.coded_bytes;
    }
    REQUIRE(coded < encoded.payload.size());
    table += Line(row.name, nodes, "directory", 0, encoded.payload.size() - coded);
    table += Line(row.name, nodes, "all", raw, encoded.payload.size());
  }
  return table;
}

TEST_CASE("streams have the sizes of the table", "[golden]") {
  const std::string path = std::string(MTDB_SOURCE_DIR) + "/tests/golden/cluster_sizes.txt";
  const std::string table = Table();
  if (std::getenv("MTDB_WRITE_GOLDEN") != nullptr) std::ofstream(path) << table;
  CHECK(table == ReadBytes(path));
}

}  // namespace
}  // namespace mtdb::testing
