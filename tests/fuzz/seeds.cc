// SPDX-License-Identifier: Apache-2.0
// Writes good inputs of every fuzz target: FOLDER/<target>/<seed>. What fuzzing starts from when a
// format has changed; see README.md.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/root_codec.h"
#include "store/object_record.h"
#include "store/pages/catalog_entry.h"
#include "store/records/index_codec.h"
#include "tests/fuzz/cluster_fuzz_targets.h"
#include "tests/fuzz/update_fuzz_targets.h"

namespace mtdb {

using namespace internal;

namespace {

class SeedFolder {
 public:
  explicit SeedFolder(std::string path) : path_(std::move(path)) {}
  // `choice`: the first byte, which targets take to choose what to read.
  void Add(const std::string& target, const std::string& seed, int choice, ByteSpan bytes) const {
    const std::filesystem::path folder = std::filesystem::path(path_) / target;
    std::filesystem::create_directories(folder);
    std::ofstream file(folder / seed, std::ios::binary);
    file << static_cast<char>(choice) << AsString(bytes);
  }
  void Add(const std::string& target, const std::string& seed, int choice,
           const std::string& text) const {
    Add(target, seed, choice, AsBytes(text));
  }

 private:
  const std::string path_;
};

void AddPayloads(const SeedFolder& folder) {
  int choice = 0;
  for (const testing::ClusterOptions& options : testing::kClusterFuzzTargets) {
    const testing::ClusterFixture fixture = testing::MakeCluster(options);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    folder.Add("cluster", "seed" + std::to_string(choice), choice, encoded.payload);
    ++choice;
  }
  Cluster piece;
  for (uint32_t t = 0; t < 20; ++t) {
    piece.in.triangles.push_back({t, t + 1, t + 2});
    piece.removers.push_back(t % 3 == 0 ? kDrain : kChildFlag | t % 2);
  }
  for (uint32_t v = 0; v < 22; ++v) {
    piece.in.positions.push_back({static_cast<int32_t>(v * v), static_cast<int32_t>(10 * v), -5});
    piece.in.vertices.push_back(v * 3);
  }
  piece.children = {4, 9};
  folder.Add("root", "seed0", 0, EncodeRootPiece(piece, {}));
  piece.explicit_arcs = {{1, 7, 2}, {2, 0, 0}};
  piece.in.rows.assign(22 * 5, std::byte{3});
  const AttributeLayout layout{{{"quality", ScalarType::kFloat32}, {"red", ScalarType::kUint8}}};
  folder.Add("root", "seed1", 1, EncodeRootPiece(piece, layout));
}

// Records that follow what comes before; and a whole stream.
void AddUpdates(const SeedFolder& folder) {
  for (size_t choice = 0; choice < testing::kUpdateFuzzTargets; ++choice) {
    const auto add = [&](const std::string& name, bool refine, bool clip) {
      const testing::UpdateFuzzTarget target(choice);
      std::vector<bool> none(target.fixture.cluster().nodes());
      const std::vector<bool> all(none.size(), refine);
      const Bytes record = target.encoder->Encode(target.fixture.Batches(none, all),
                                                  clip ? target.Half() : MeetsRegion());
      if (record.empty()) return;
      ByteReader reader(record);
      const uint64_t length = reader.GetVarint();
      static_cast<void>(reader.Get<uint32_t>());
      folder.Add("update", name + std::to_string(choice), static_cast<int>(choice),
                 reader.GetBytes(length));
      Bytes stream = target.prefix;
      stream.insert(stream.end(), record.begin(), record.end());
      folder.Add("update", name + "_stream" + std::to_string(choice),
                 static_cast<int>(testing::kUpdateFuzzTargets), stream);
    };
    add("refined", true, false);
    add("clipped", false, true);
    add("refined_clipped", true, true);
    add("whole", false, false);
  }
}

void AddStoreValues(const SeedFolder& folder) {
  ClusterIndex index;
  for (uint32_t c = 0; c < 8; ++c) {
    UnitEntry entry;
    entry.round = static_cast<uint8_t>(1 + c / 4);
    entry.hilbert = 1000 * c;
    entry.bounds.Add(Vec3i{-1, 2, 300});
    entry.bounds.Add(Vec3i{9, 2, 400});
    entry.nodes = 3;
    entry.in_triangles = 10;
    entry.out_triangles = 16;
    entry.external_vertices = 8;
    entry.error_code_max = 30;
    entry.explicit_arcs = c == 5;
    const UnitId children[] = {0, 3};
    index.Add(entry, {c / 2, c % 2 * 192, 192}, std::span(children, c >= 4 ? 2 : 0));
  }
  UnitEntry piece;
  piece.round = kRootRound;
  piece.bounds.Add(Vec3i{-1, 2, 300});
  piece.out_triangles = 12;
  const UnitId children[] = {4, 7};
  index.Add(piece, {4, 0, 4}, children);
  index.Add(piece, {4, 4, 4}, {});
  // The second byte: the number of rows.
  const auto rows = [&](uint32_t first, uint32_t count) {
    return std::string(1, static_cast<char>(count)) +
           std::string(AsString(EncodeIndexRows(index, first, count)));
  };
  folder.Add("index", "whole", 0, rows(0, 10));
  folder.Add("index", "root_pieces", 1, rows(8, 2));

  folder.Add("catalog", "superblock", 0, EncodeSuperblock({2, uint64_t{1} << 40, 3}));
  folder.Add("catalog", "pending", 1, EncodePendingEntry({"bunny", 4711}));
  ObjectRecord record;
  record.id = ObjectId{1};
  record.name = std::string("bunny");
  record.attributes.attributes = {{"red", ScalarType::kUint8}, {"quality", ScalarType::kFloat32}};
  record.bounds = {{0, 0, 0}, {1, 1, 1}};
  record.units = std::string("m");
  record.rounds.resize(2);
  folder.Add("catalog", "record", 2, EncodeObjectRecord(record));
}

void AddMeshes(const SeedFolder& folder) {
  enum Reader { kPly, kObj, kOff, kBinaryStl, kAsciiStl, kGltf = 120 };
  const std::string properties =
      "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nelement face 2\nproperty list uchar int vertex_indices\n";
  const std::string ascii = "0 0 0 1\n1 0 0 2\n0 1 0 3\n1 1 .5 4\n3 0 1 2\n4 0 1 3 2\n";
  folder.Add("mesh", "ascii.ply", kPly,
             "ply\nformat ascii 1.0\n" + properties + "end_header\n" + ascii);
  for (const bool big : {false, true}) {
    std::string body;
    for (int v = 0; v < 4; ++v) {
      const std::string one = big ? std::string("\x3f\x80\0\0", 4) : std::string("\0\0\x80\x3f", 4);
      for (int axis = 0; axis < 3; ++axis)
        body += (v >> axis & 1) != 0 ? one : std::string(4, '\0');
      body += static_cast<char>(v);
    }
    for (const std::string corners : {"012", "0132"}) {
      body += static_cast<char>(corners.size());
      for (const char c : corners) {
        const auto digit = static_cast<char>(c - '0');
        body += big ? std::string(3, '\0') + digit : digit + std::string(3, '\0');
      }
    }
    folder.Add("mesh", big ? "big.ply" : "little.ply", kPly,
               std::string("ply\nformat binary_") + (big ? "big" : "little") + "_endian 1.0\n" +
                   properties + "end_header\n" + body);
  }
  folder.Add(
      "mesh", "strips.ply", kPly,
      "ply\nformat ascii 1.0\ncomment c\nelement vertex 4\nproperty double x\nproperty double y\n"
      "property double z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
      "0 0 0\n1 0 0\n0 1 0\n1 1 0\n7 0 1 2 3 -1 0 1\n");
  folder.Add(
      "mesh", "all.obj", kObj,
      "# c\nmtllib a.mtl\nv 0 0 0\nv 1 0 0 .5 .5 .5\nv 0 1e-3 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2//1 "
      "-1\nv 1 1 0\nf 1 2 4 \\\n3\ng x\nusemtl m\n");
  folder.Add("mesh", "plain.off", kOff, "OFF\n# c\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n");
  folder.Add(
      "mesh", "colour.off", kOff,
      "CNOFF 3 1 3\n0 0 0 0 0 1 1 2 3 4\n1 0 0 0 0 1 1 2 3 4\n0 1 0 0 0 1 .1 .2 .3 .4\n3 0 1 2\n");
  folder.Add("mesh", "binary.stl", kBinaryStl,
             std::string(80, ' ') + std::string("\1\0\0\0", 4) + std::string(12 + 12, '\0') +
                 std::string("\0\0\x80\x3f", 4) + std::string(20 + 2, '\0'));
  folder.Add("mesh", "ascii.stl", kAsciiStl,
             "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\n"
             "endloop\nendfacet\nendsolid s\n");
  folder.Add("mesh", "square.gltf", kGltf,
             R"({"asset":{"version":"2.0"},"buffers":[{"uri":"data:;base64,)"
             "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAACAPwAAgD8AAAAAAAABAAIAAwA="
             R"("}],"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,)"
             R"("byteLength":8}],"accessors":[{"bufferView":0,"componentType":5126,"count":4,)"
             R"("type":"VEC3"},{"bufferView":1,"componentType":5123,"count":4,"type":"SCALAR"}],)"
             R"("meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":0,"NORMAL":0,)"
             R"("_A":1},"indices":1,"mode":5}]}],"nodes":[{"mesh":0,"scale":[1,2,-1],)"
             R"("children":[1]},{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,5,5,5,1]}]})");
}

void AddSessionMessages(const SeedFolder& folder) {
  enum Reader { kServer, kClient };
  folder.Add("session", "query", kServer,
             R"({"id": 7, "query": {"region": {"sphere": {"centre": [0, 1, 2.5], "radius": 3}}}})");
  folder.Add("session", "hello", kClient,
             R"({"hello": {"protocol": 1, "object": "a", "triangles": 9, "vertices": 8, )"
             R"("diagonal": 1.5, "rounding_error": 0.1, "double_positions": false, "remember": 4, )"
             R"("max_triangles": 99, "max_message_bytes": 1048576}})");
  folder.Add(
      "session", "done", kClient,
      R"({"id": 7, "done": {"triangles": 9, "vertices": 8, "active_triangles": 3, )"
      R"("error_bound": 1e-3, "shortfall": null, "limit": "accuracy", "insertions": 1, "removals": 2, )"
      R"("messages": 1, "bytes": 99, "milliseconds": 0.5}})");
  folder.Add("session", "superseded", kClient, R"({"id": 7, "superseded": true})");
  folder.Add("session", "error", kClient, R"({"id": 7, "error": "no", "code": "bad_query"})");
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: fuzz_seeds FOLDER\n", stderr);
    return 2;
  }
  const mtdb::SeedFolder folder(argv[1]);
  mtdb::AddPayloads(folder);
  mtdb::AddUpdates(folder);
  mtdb::AddStoreValues(folder);
  mtdb::AddMeshes(folder);
  mtdb::AddSessionMessages(folder);
  // The unchanged store; one without its last page; one that a writer opens, with a changed byte.
  folder.Add("store", "whole", 0, std::string());
  folder.Add("store", "truncated", 1, std::string());
  folder.Add("store", "changed", 128, std::string("\x0c\x20\1\x12", 4));
  return 0;
}
