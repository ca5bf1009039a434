// SPDX-License-Identifier: Apache-2.0
// What a file says of the surface, against the input as it came: the bound counts what the file's
// format rounds.
#include <catch2/catch.hpp>
#include <cstring>
#include <draco/compression/decode.h>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>

#include "codecs/mesh_file/mesh_file.h"
#include "tests/builder/fixture.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/support/mesh_distance.h"
#include "tests/support/read_mesh.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::testing {
namespace {

struct Place {
  const char* name;
  Vec3d at;
  double size;
};
constexpr Place kPlaces[] = {{"at the origin", {0, 0, 0}, 1},
                             {"tiny", {0, 0, 0}, 1e-12},
                             {"huge", {-3e11, 2e11, 0}, 4e11},
                             {"as large as can be", {0, 0, 0}, 1e30},
                             {"UTM", {418322.37, 4181100.61, 213.2}, 830},
                             {"negative", {-17, -5000, -0.25}, 3},
                             {"far away", {1e9, -1e9, 1e9}, 1}};

TriangleMesh InputAt(const Place& place, bool sheet) {
  TriangleMesh mesh = sheet ? MakeSheet(30, 0.1) : MakeSculpture(2000);
  Box3d box;
  for (const Vec3d& p : mesh.positions) box.Add(p);
  const double scale = place.size / Diagonal(box);
  for (Vec3d& p : mesh.positions) p = place.at + (p - box.min) * scale;
  mesh.header.double_positions = true;
  return mesh;
}

std::string ReadBytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// The standard's reading: node.translation + POSITION.
TriangleMesh ReadGltf(const std::string& path) {
  const std::string bytes = ReadBytes(path);
  uint32_t json_bytes = 0;
  std::memcpy(&json_bytes, bytes.data() + 12, 4);
  const auto json = nlohmann::json::parse(bytes.substr(20, json_bytes));
  const char* const binary = bytes.data() + 28 + json_bytes;
  Vec3d origin;
  if (const auto& node = json.at("nodes").at(0); node.contains("translation")) {
    for (int i = 0; i < 3; ++i) origin[i] = node.at("translation").at(static_cast<size_t>(i));
  }
  const auto& accessors = json.at("accessors");
  const auto& views = json.at("bufferViews");
  TriangleMesh mesh;
  const size_t stride = views.at(1).at("byteStride");
  for (size_t v = 0; v < accessors.at(1).at("count"); ++v) {
    float p[3];
    std::memcpy(p, binary + v * stride, sizeof(p));
    mesh.positions.push_back(origin + Vec3d{p[0], p[1], p[2]});
  }
  const size_t indices = views.at(0).at("byteOffset");
  for (size_t i = 0; i < accessors.at(0).at("count"); i += 3) {
    uint32_t t[3];
    std::memcpy(t, binary + indices + i * 4, sizeof(t));
    mesh.triangles.push_back({t[0], t[1], t[2]});
  }
  return mesh;
}

TriangleMesh ReadDraco(const std::string& path) {
  const std::string bytes = ReadBytes(path);
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::Decoder decoder;
  const auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  REQUIRE(decoded.ok());
  const draco::Mesh& from = *decoded.value();
  std::vector<double> origin{0, 0, 0};
  if (from.GetMetadata() != nullptr) from.GetMetadata()->GetEntryDoubleArray("origin", &origin);
  TriangleMesh mesh;
  const auto* const positions = from.GetNamedAttribute(draco::GeometryAttribute::POSITION);
  for (uint32_t v = 0; v < from.num_points(); ++v) {
    float p[3];
    positions->GetMappedValue(draco::PointIndex(v), p);
    mesh.positions.push_back({origin[0] + p[0], origin[1] + p[1], origin[2] + p[2]});
  }
  for (uint32_t t = 0; t < from.num_faces(); ++t) {
    const auto& face = from.face(draco::FaceIndex(t));
    mesh.triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
  return mesh;
}

TriangleMesh ReadBack(const std::string& path) {
  if (path.ends_with(".glb")) return ReadGltf(path);
  if (path.ends_with(".drc")) return ReadDraco(path);
  return ReadMesh(path);
}

}  // namespace

TEST_CASE("Files of every format are as close to the input as is said, wherever it lies") {
  const TemporaryFolder folder;
  std::mt19937 random(6);
  for (const Place& place : kPlaces) {
    for (const int bits : {8, 16, 24}) {
      const TriangleMesh input = InputAt(place, bits == 16);
      BuildOptions options;
      options.tile_triangles = 512;
      options.bits = bits;
      const BuiltObject built = Build(input, options);
      const ObjectRecord& record = built.record;
      const double slack = 1e-15 * (Length(record.bounds.min) + Length(record.bounds.max));
      for (const char* const extension : {".ply", ".obj", ".off", ".stl", ".glb", ".drc"}) {
        for (const double factor : {0.5, 3.0, 40.0, 1000.0}) {
          const double asked = factor * record.rounding_error;
          INFO(place.name << ", " << bits << " bits, " << extension << ", " << factor);
          Query query;
          query.threshold = ConstantThreshold(asked);
          const std::string path = folder.path() + "/out" + extension;
          const auto writer = CreateMeshFileWriter(path).value();
          const Result<ExtractStats> stats = built.surface->Extract(query, *writer);
          INFO(stats.status().message());
          REQUIRE(stats.ok());
          CHECK((stats->error_bound <= asked) == !stats->shortfall.any());
          const TriangleMesh back = ReadBack(path);
          REQUIRE(back.triangles.size() == stats->triangles);
          for (int k = 0; k < 60; ++k) {
            const double there =
                DistanceTo(back, input.positions[random() % input.positions.size()]);
            const double again =
                DistanceTo(input, back.positions[random() % back.positions.size()]);
            REQUIRE(there <= stats->error_bound + slack);
            REQUIRE(again <= stats->error_bound + slack);
          }
          // Only where there are few bits is it the grid that decides.
          const bool is_ply = extension == std::string(".ply");
          CHECK(writer->rounding() <= (is_ply ? record.grid.step / 8 : 2e-5 * record.diagonal()));
        }
      }
    }
  }
}

TEST_CASE("Text is read as double, whatever the format") {
  const TemporaryFolder folder;
  const TriangleMesh input = InputAt(kPlaces[4], false);
  const auto text = [&](const char* form, const Vec3d& p) {
    char line[200];
    std::snprintf(line, sizeof(line), form, p.x, p.y, p.z);
    return std::string(line);
  };
  // Of 9 significant digits, as many as float32 values have; and of 12.
  for (const char* const form : {"%.9g %.9g %.9g\n", "%.12g %.12g %.12g\n"}) {
    std::string ply = "ply\nformat ascii 1.0\nelement vertex " +
                      std::to_string(input.positions.size()) +
                      "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                      std::to_string(input.triangles.size()) +
                      "\nproperty list uchar int vertex_indices\nend_header\n";
    std::string off = "OFF\n" + std::to_string(input.positions.size()) + " " +
                      std::to_string(input.triangles.size()) + " 0\n";
    std::string obj, stl = "solid a\n";
    TriangleMesh meant = input;  // what the text says
    for (Vec3d& p : meant.positions) {
      const std::string line = text(form, p);
      REQUIRE(std::sscanf(line.c_str(), "%lf %lf %lf", &p.x, &p.y, &p.z) == 3);
      ply += line;
      off += line;
      obj += "v " + line;
    }
    for (const TriangleVertices& t : input.triangles) {
      const auto corners = [&](size_t add) {
        return std::to_string(t[0] + add) + " " + std::to_string(t[1] + add) + " " +
               std::to_string(t[2] + add) + "\n";
      };
      ply += "3 " + corners(0);
      off += "3 " + corners(0);
      obj += "f " + corners(1);
      stl += "facet normal 0 0 0\nouter loop\n";
      for (const VertexIndex v : t) stl += "vertex " + text(form, input.positions[v]);
      stl += "endloop\nendfacet\n";
    }
    stl += "endsolid a\n";
    for (const auto& [name, content] : {std::pair("/a.ply", &ply), std::pair("/a.off", &off),
                                        std::pair("/a.obj", &obj), std::pair("/a.stl", &stl)}) {
      INFO(name << form);
      const std::string path = folder.path() + name;
      std::ofstream(path, std::ios::binary) << *content;
      TempStore store;
      auto writer = store.database().Create("a", false);
      REQUIRE(writer.ok());
      BuildOptions options;
      options.bits = 24;
      const Result<ObjectRecord> record = BuildObject(
          [&](MeshSink& sink) { return ReadMeshFile(path, sink, nullptr); }, options, **writer);
      INFO(record.status().message());
      REQUIRE(record.ok());
      CHECK(record->input.degenerate_triangles == 0);
      CHECK(record->vertices == input.positions.size());
      CHECK(record->rounding_error > 0);
      CHECK(record->rounding_error <= record->grid.cell_error());
      const TriangleMesh back = ReadBack(path);
      for (int k = 0; k < 50; ++k) {
        const Vec3d p = meant.positions[static_cast<size_t>(k) * 7];
        REQUIRE(DistanceTo(back, p) <= 1e-9);
      }
    }
  }
}

}  // namespace mtdb::testing
