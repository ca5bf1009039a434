// SPDX-License-Identifier: Apache-2.0
// What is common to all formats: opening, dispatch, writing whole or not at all, round trips, and
// the real meshes.
#include <csignal>
#include <fcntl.h>
#include <random>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::ColouredTetrahedron;
using testing::ReadBytes;
using testing::ReadOutcome;
using testing::ReadPath;
using testing::ReadText;
using testing::RequireBadInput;
using testing::ScratchFolder;
using testing::Tetrahedron;
using testing::WriteMesh;

Status BeginWriter(const std::string& path, const MeshHeader& header) {
  Result<std::unique_ptr<MeshFileWriter>> writer = CreateMeshFileWriter(path);
  return writer.ok() ? (*writer)->Begin(header) : writer.status();
}

MeshHeader Counts(uint64_t vertices, uint64_t triangles) {
  MeshHeader header;
  header.vertex_count = vertices;
  header.triangle_count = triangles;
  return header;
}

TEST_CASE("A missing file, a directory, a pipe and an unreadable file are told apart") {
  const ScratchFolder folder;
  const ReadOutcome missing = ReadPath(folder.Path("none.ply"));
  REQUIRE(missing.status.code() == StatusCode::kNotFound);
  REQUIRE(missing.status.message() == folder.Path("none.ply") + ": no such file");
  const ReadOutcome directory = ReadPath(folder.Path(""));
  REQUIRE(directory.status.code() == StatusCode::kIoError);
  REQUIRE(directory.status.message().find("is a directory") != std::string::npos);
  REQUIRE(::mkfifo(folder.Path("pipe.ply").c_str(), 0600) == 0);
  const ReadOutcome pipe = ReadPath(folder.Path("pipe.ply"));
  REQUIRE(pipe.status.message().find("not a regular file") != std::string::npos);
  const std::string secret = folder.Write("secret.ply", "ply\n");
  REQUIRE(::chmod(secret.c_str(), 0) == 0);
  if (::geteuid() == 0) {
    WARN("runs as root, who may read everything: the permission check is skipped");
  } else {
    const ReadOutcome outcome = ReadPath(secret);
    REQUIRE(outcome.status.code() == StatusCode::kIoError);
    REQUIRE(outcome.status.message().find("ermission denied") != std::string::npos);
  }
}

TEST_CASE("An empty file and a file that is no mesh are refused by any name") {
  for (const char* name : {"a.ply", "a.obj", "a.stl", "a.off", "a.xyz", "a"}) {
    CAPTURE(name);
    RequireBadInput(name, "", {"the file is empty, expected a mesh"});
    RequireBadInput(name, "To whom it may concern:\nnothing here is a mesh.\n", {"expected"});
    RequireBadInput(name, std::string(5000, '\xee'), {});
  }
  RequireBadInput("a.xyz", "%PDF-1.5\n", {"it seems to be a PDF document"});
  RequireBadInput("a.xyz", "1 2 3\n", {"not a mesh file that mtdb reads, expected PLY, OBJ, STL"});
}

TEST_CASE("A text line without an end is refused in bounded memory") {
  RequireBadInput("long.obj", "v 0 0 0\n# " + std::string((size_t{1} << 24) + 10, 'x'),
                  {"line 2: longer than 16 MiB"});
}

TEST_CASE("Every format reads back what it wrote, also when written from another format") {
  const ScratchFolder folder;
  const TriangleMesh mesh = Tetrahedron();
  for (const char* first : {".ply", ".obj", ".stl", ".off"}) {
    for (const char* second : {".ply", ".obj", ".stl", ".off"}) {
      CAPTURE(first, second);
      const std::string a = folder.Path(std::string("a") + first);
      const std::string b = folder.Path(std::string("b") + second);
      REQUIRE(WriteMesh(mesh, a).ok());
      const ReadOutcome from_a = ReadPath(a);
      INFO(from_a.status.message());
      REQUIRE(from_a.status.ok());
      REQUIRE(WriteMesh(from_a.mesh, b).ok());
      const ReadOutcome from_b = ReadPath(b);
      REQUIRE(from_b.status.ok());
      REQUIRE_FALSE(from_b.mesh.header.double_positions);
      // STL gives the vertices in the order of the corners.
      REQUIRE(from_b.mesh.positions.size() == mesh.positions.size());
      REQUIRE(from_b.mesh.triangles.size() == mesh.triangles.size());
      for (size_t t = 0; t < mesh.triangles.size(); ++t) {
        for (size_t k = 0; k < 3; ++k) {
          // What text gives back is the float32 value's shortest decimals.
          const Vec3d p = from_b.mesh.positions[from_b.mesh.triangles[t][k]];
          const Vec3d q = mesh.positions[mesh.triangles[t][k]];
          for (int i = 0; i < 3; ++i) {
            REQUIRE(static_cast<float>(p[i]) == static_cast<float>(q[i]));
          }
        }
      }
    }
  }
}

TEST_CASE("Double positions survive PLY, OBJ and OFF to the last bit") {
  const ScratchFolder folder;
  TriangleMesh mesh = Tetrahedron();
  mesh.header.double_positions = true;
  mesh.positions = {{0.1, 1.0 / 3, 1e-300}, {-2.0 / 7, 4e15 + 1, 0}, {5, 6, 7}, {0.5, 0, -0.0}};
  for (const char* name : {"d.ply", "d.obj", "d.off"}) {
    CAPTURE(name);
    REQUIRE(WriteMesh(mesh, folder.Path(name)).ok());
    const ReadOutcome outcome = ReadPath(folder.Path(name));
    REQUIRE(outcome.status.ok());
    REQUIRE(outcome.mesh.header.double_positions);
    REQUIRE(outcome.mesh.positions == mesh.positions);
    REQUIRE(outcome.mesh.triangles == mesh.triangles);
  }
}

TEST_CASE("PLY keeps every attribute under its name and type") {
  const ScratchFolder folder;
  TriangleMesh mesh = ColouredTetrahedron();
  ByteWriter rows;
  mesh.header.attributes.attributes.clear();
  constexpr const char* kNames[8] = {"a", "b", "c", "d", "e", "f", "g", "h"};
  for (int t = 0; t < 8; ++t) {
    mesh.header.attributes.attributes.push_back({kNames[t], static_cast<ScalarType>(t)});
  }
  for (size_t i = 0; i < 4 * mesh.header.attributes.row_bytes(); ++i) {
    rows.Put(static_cast<uint8_t>(i * 37));
  }
  mesh.rows = rows.Take();
  for (const bool double_positions : {false, true}) {
    mesh.header.double_positions = double_positions;
    REQUIRE(WriteMesh(mesh, folder.Path("a.ply")).ok());
    const ReadOutcome outcome = ReadPath(folder.Path("a.ply"));
    REQUIRE(outcome.status.ok());
    REQUIRE(outcome.mesh.header.attributes == mesh.header.attributes);
    REQUIRE(outcome.mesh.rows == mesh.rows);
    REQUIRE(outcome.mesh.positions == mesh.positions);
    REQUIRE(outcome.mesh.header.double_positions == double_positions);
  }
}

TEST_CASE("OBJ keeps the colours, OFF colours and normals") {
  const ScratchFolder folder;
  const TriangleMesh mesh = ColouredTetrahedron();  // nx ny nz, red green blue alpha, quality
  MeshWriteOptions options;
  options.off_normals = true;
  REQUIRE(WriteMesh(mesh, folder.Path("c.off"), options).ok());
  const ReadOutcome off = ReadPath(folder.Path("c.off"));
  REQUIRE(off.status.ok());
  REQUIRE(off.report.format == "CNOFF ASCII");
  REQUIRE(off.mesh.header.attributes.row_bytes() == 16);
  REQUIRE(WriteMesh(mesh, folder.Path("c.obj")).ok());
  const ReadOutcome obj = ReadPath(folder.Path("c.obj"));
  REQUIRE(obj.mesh.header.attributes.row_bytes() == 3);
  for (size_t v = 0; v < 4; ++v) {
    const std::byte* const row = mesh.rows.data() + v * mesh.header.attributes.row_bytes();
    REQUIRE(std::memcmp(off.mesh.rows.data() + v * 16, row, 16) == 0);
    REQUIRE(std::memcmp(obj.mesh.rows.data() + v * 3, row + 12, 3) == 0);
  }
}

TEST_CASE("All 256 colours survive OBJ") {
  const ScratchFolder folder;
  TriangleMesh mesh;
  for (const char* name : {"red", "green", "blue"}) {
    mesh.header.attributes.attributes.push_back({name, ScalarType::kUint8});
  }
  for (int i = 0; i < 256; ++i) {
    mesh.positions.push_back({static_cast<double>(i), 0, 0});
    mesh.rows.insert(mesh.rows.end(), 3, static_cast<std::byte>(i));
  }
  REQUIRE(WriteMesh(mesh, folder.Path("c.obj")).ok());
  REQUIRE(ReadPath(folder.Path("c.obj")).mesh.rows == mesh.rows);
}

TEST_CASE("The written bytes are these") {
  const ScratchFolder folder;
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 0.25, 0}};
  mesh.triangles = {{0, 1, 2}};
  REQUIRE(WriteMesh(mesh, folder.Path("t.obj")).ok());
  REQUIRE(ReadBytes(folder.Path("t.obj")) == "v 0 0 0\nv 1 0 0\nv 0 0.25 0\nf 1 2 3\n");
  REQUIRE(WriteMesh(mesh, folder.Path("t.off")).ok());
  REQUIRE(ReadBytes(folder.Path("t.off")) == "OFF\n3 1 0\n0 0 0\n1 0 0\n0 0.25 0\n3 0 1 2\n");
  REQUIRE(WriteMesh(mesh, folder.Path("t.ply")).ok());
  std::string ply =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
      "property float y\nproperty float z\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n";
  for (const float v : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 0.25f, 0.f}) {
    testing::AppendValue(&ply, v);
  }
  ply += '\3';
  for (const int v : {0, 1, 2}) testing::AppendValue(&ply, v);
  REQUIRE(ReadBytes(folder.Path("t.ply")) == ply);
  REQUIRE(WriteMesh(mesh, folder.Path("t.stl")).ok());
  const std::string stl = ReadBytes(folder.Path("t.stl"));
  REQUIRE(stl.size() == 84 + 50);
  const float normal[3] = {0, 0, 1};
  REQUIRE(std::memcmp(stl.data() + 84, normal, sizeof(normal)) == 0);
}

TEST_CASE("bytes_written is the size of the file") {
  const ScratchFolder folder;
  for (const char* name : {"s.ply", "s.obj", "s.stl", "s.off", "s.glb", "s.drc"}) {
    auto writer = CreateMeshFileWriter(folder.Path(name));
    REQUIRE(writer.ok());
    REQUIRE(SendMesh(ColouredTetrahedron(), **writer).ok());
    REQUIRE((*writer)->bytes_written() == std::filesystem::file_size(folder.Path(name)));
  }
}

TEST_CASE("Extensions count in any case, unknown ones are refused by name") {
  const ScratchFolder folder;
  REQUIRE(WriteMesh(Tetrahedron(), folder.Path("a.PLY")).ok());
  REQUIRE(ReadPath(folder.Path("a.PLY")).status.ok());
  for (const char* name : {"a.gltf", "a", ".ply.txt"}) {
    const Status status = WriteMesh(Tetrahedron(), folder.Path(name));
    REQUIRE(status.code() == StatusCode::kUnsupported);
    REQUIRE(status.message().find(".ply, .obj, .stl, .off, .glb or .drc") != std::string::npos);
  }
}

TEST_CASE("A file appears under its name only at End, and nothing stays behind without it") {
  const ScratchFolder folder;
  for (const char* name : {"a.ply", "a.obj", "a.stl", "a.off", "a.glb", "a.drc"}) {
    CAPTURE(name);
    folder.Write(name, "old");
    const size_t before = folder.file_count();
    {
      auto writer = CreateMeshFileWriter(folder.Path(name));
      REQUIRE(writer.ok());
      REQUIRE((*writer)->Begin(Counts(4, 4)).ok());
      REQUIRE((*writer)->AddVertices(Tetrahedron().positions, {}).ok());
      REQUIRE(ReadBytes(folder.Path(name)) == "old");
    }
    REQUIRE(folder.file_count() == before);
    REQUIRE(ReadBytes(folder.Path(name)) == "old");
    REQUIRE(WriteMesh(Tetrahedron(), folder.Path(name)).ok());
    REQUIRE(folder.file_count() == before);
    REQUIRE(ReadBytes(folder.Path(name)) != "old");
  }
}

TEST_CASE("Writers want the counts up front and hold the producer to them") {
  const ScratchFolder folder;
  for (const char* name : {"a.ply", "a.obj", "a.stl", "a.off", "a.glb", "a.drc"}) {
    CAPTURE(name);
    const std::string path = folder.Path(name);
    MeshHeader missing = Counts(4, 4);
    missing.triangle_count.reset();
    const Status no_counts = BeginWriter(path, missing);
    REQUIRE(no_counts.code() == StatusCode::kInvalidArgument);
    REQUIRE(no_counts.message().find("needs the counts") != std::string::npos);

    const TriangleMesh mesh = Tetrahedron();
    const auto send = [&](const MeshHeader& header, size_t vertices,
                          const std::vector<TriangleVertices>& triangles) -> Status {
      auto writer = CreateMeshFileWriter(path);
      MTDB_RETURN_IF_ERROR((*writer)->Begin(header));
      MTDB_RETURN_IF_ERROR((*writer)->AddVertices(std::span(mesh.positions).first(vertices), {}));
      MTDB_RETURN_IF_ERROR((*writer)->AddTriangles(triangles));
      return (*writer)->End();
    };
    REQUIRE(send(Counts(4, 4), 4, mesh.triangles).ok());
    const auto refused = [&](const Status& status, const char* part) {
      INFO(status.message());
      REQUIRE(status.code() == StatusCode::kInvalidArgument);
      REQUIRE(status.message().find(part) != std::string::npos);
      REQUIRE(status.message().find(path) == 0);
    };
    refused(send(Counts(3, 4), 4, mesh.triangles), "more vertices than the 3");
    refused(send(Counts(4, 3), 4, mesh.triangles), "more triangles than the 3");
    refused(send(Counts(4, 5), 4, mesh.triangles), "but got 4 and 4");
    refused(send(Counts(5, 4), 4, mesh.triangles), "a triangle after 4 of 5 vertices");
    refused(send(Counts(4, 2), 4, {{0, 1, 2}, {0, 4, 1}}),
            "triangle 1: vertex index 4, but the mesh has 4 vertices");
  }
}

TEST_CASE("Formats refuse what they cannot count") {
  const ScratchFolder folder;
  const Status stl = BeginWriter(folder.Path("a.stl"), Counts(10, uint64_t{1} << 32));
  REQUIRE(stl.code() == StatusCode::kInvalidArgument);
  REQUIRE(stl.message().find("STL holds at most 4294967295 triangles") != std::string::npos);
  const Status ply = BeginWriter(folder.Path("a.ply"), Counts((uint64_t{1} << 32) + 1, 1));
  REQUIRE(ply.message().find("PLY holds at most 4294967296 vertices") != std::string::npos);
  for (const auto& [vertices, triangles] : {std::pair{(uint64_t{1} << 32) + 1, uint64_t{1}},
                                            {uint64_t{10}, uint64_t{1} << 29},
                                            {~uint64_t{0}, ~uint64_t{0}},
                                            {uint64_t{180'000'000}, uint64_t{180'000'000}}}) {
    const Status glb = BeginWriter(folder.Path("a.glb"), Counts(vertices, triangles));
    REQUIRE(glb.code() == StatusCode::kInvalidArgument);
    REQUIRE(glb.message().find("at most 4 GiB, but the mesh of") != std::string::npos);
  }
  REQUIRE(BeginWriter(folder.Path("a.glb"), Counts(178'000'000, 178'000'000)).ok());
  const Status drc = BeginWriter(folder.Path("a.drc"), Counts(10, uint64_t{1} << 31));
  REQUIRE(drc.message().find("Draco holds 1 to 715827882 triangles") != std::string::npos);
}

TEST_CASE("PLY with more than 2^31 vertices has unsigned indices") {
  const ScratchFolder folder;
  for (const uint64_t vertices : {uint64_t{1} << 31, (uint64_t{1} << 31) + 1}) {
    const std::string path = folder.Path("a.ply");
    MeshWriteOptions options;
    options.descriptor = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC, 0600);
    REQUIRE(options.descriptor >= 0);
    auto writer = CreateMeshFileWriter(path, options);
    REQUIRE((*writer)->Begin(Counts(vertices, 0)).ok());
    // The header alone fits the buffer; let it out through a block that fills the buffer.
    const std::vector<Vec3d> many(100000);
    REQUIRE((*writer)->AddVertices(many, {}).ok());
    const std::string head = ReadBytes(path).substr(0, 300);
    ::close(options.descriptor);
    const char* const type =
        vertices > (uint64_t{1} << 31) ? "list uchar uint " : "list uchar int ";
    REQUIRE(head.find(type) != std::string::npos);
  }
}

TEST_CASE("A folder that is missing or is the target is an error that names the path") {
  const ScratchFolder folder;
  const Status missing = BeginWriter(folder.Path("none/a.ply"), Counts(1, 0));
  REQUIRE(missing.code() == StatusCode::kIoError);
  REQUIRE(missing.message().find(folder.Path("none/a.ply") + ": cannot be written") == 0);
  std::filesystem::create_directory(folder.Path("d.ply"));
  REQUIRE(BeginWriter(folder.Path("d.ply"), Counts(1, 0)).message().find("is a directory") !=
          std::string::npos);
}

TEST_CASE("A full disk is kNoSpace with the path, and the temporary file goes") {
  const ScratchFolder folder;
  // A limit on file size stands for a full disk: write() then fails with EFBIG.
  rlimit old_limit{};
  REQUIRE(::getrlimit(RLIMIT_FSIZE, &old_limit) == 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit small = old_limit;
  small.rlim_cur = 1 << 20;
  REQUIRE(::setrlimit(RLIMIT_FSIZE, &small) == 0);
  TriangleMesh mesh;
  mesh.positions.resize(200000);
  const Status status = WriteMesh(mesh, folder.Path("a.ply"));
  REQUIRE(::setrlimit(RLIMIT_FSIZE, &old_limit) == 0);
  std::signal(SIGXFSZ, old_handler);
  INFO(status.message());
  REQUIRE(status.code() == StatusCode::kNoSpace);
  REQUIRE(status.message().find(folder.Path("a.ply") + ": cannot be written") == 0);
  REQUIRE(folder.file_count() == 0);
}

TEST_CASE("A damaged file of any format is a mesh with legal indices, or one line of error") {
  const ScratchFolder folder;
  std::mt19937 random(1);
  for (const char* name : {"a.ply", "a.obj", "a.stl", "a.off", "text.ply", "text.stl"}) {
    const std::string path = folder.Path(name);
    if (std::string(name) == "text.ply") {
      folder.Write(name,
                   "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                   "property double z\nproperty uchar red\nelement face 2\nproperty list uchar int "
                   "vertex_index\nend_header\n0 0 0 9\n1 0 0 8\n0 1 0.5 7\n3 0 1 2\n4 2 1 0 1\n");
    } else if (std::string(name) == "text.stl") {
      folder.Write(name,
                   "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
                   "vertex 0 1 0\nendloop\nendfacet\nendsolid s\n");
    } else {
      REQUIRE(WriteMesh(ColouredTetrahedron(), path).ok());
    }
    const std::string good = ReadBytes(path);
    REQUIRE(ReadPath(path).status.ok());
    int refused = 0;
    for (int i = 0; i < 1500; ++i) {
      std::string bad = good;
      for (uint32_t changes = 1 + random() % 3; changes > 0; --changes) {
        const size_t at = random() % bad.size();
        switch (random() % 4) {
          case 0: bad[at] = static_cast<char>(random()); break;
          case 1: bad.erase(at, 1 + random() % 5); break;
          case 2: bad.insert(at, 1, "-9. \n\xff"[random() % 6]); break;
          default: bad[at] = static_cast<char>(bad[at] ^ (1 << random() % 8)); break;
        }
        if (bad.empty()) bad.push_back(' ');
      }
      folder.Write(name, bad);
      const ReadOutcome outcome = ReadPath(path);
      CAPTURE(name, i, outcome.status.message());
      if (outcome.status.ok()) {
        for (const TriangleVertices& t : outcome.mesh.triangles) {
          for (const VertexIndex v : t) REQUIRE(v < outcome.mesh.positions.size());
        }
        REQUIRE(outcome.mesh.rows.size() ==
                outcome.mesh.positions.size() * outcome.mesh.header.attributes.row_bytes());
      } else {
        ++refused;
        const StatusCode code = outcome.status.code();
        REQUIRE((code == StatusCode::kBadInput || code == StatusCode::kUnsupported));
        REQUIRE(outcome.status.message().find(path) == 0);
        REQUIRE(outcome.status.message().find('\n') == std::string::npos);
      }
    }
    REQUIRE(refused > 100);
  }
}

TEST_CASE("The real meshes have the counts of their table") {
  struct Expected {
    const char* file;
    const char* format;
    size_t vertices;
    size_t triangles;
    std::vector<std::string> attributes;
  };
  const std::vector<Expected> all = {
      {"bunny.ply", "PLY binary little endian", 34834, 69451, {}},
      {"nefertiti.ply", "PLY binary little endian", 49971, 99938, {}},
      {"horse_bigendian_colours.ply",
       "PLY binary big endian",
       48485,
       96966,
       {"confidence", "red", "green", "blue"}},
      {"laurana_colours_normals.ply",
       "PLY binary little endian",
       25160,
       50000,
       {"nx", "ny", "nz", "red", "green", "blue", "alpha"}},
      {"dragon_res2_ascii_nonmanifold.ply", "PLY ASCII", 100250, 202520, {}},
      {"rangescan_ascii_boundary.ply", "PLY ASCII", 114373, 221803, {"nx", "ny", "nz"}},
      {"skull.obj", "OBJ", 49999, 100002, {}},
  };
  const std::string folder = MTDB_SOURCE_DIR "/../shared/data/";
  if (!std::filesystem::exists(folder)) {
    WARN("no real meshes at " << folder << ": skipped");
    return;
  }
  const ScratchFolder scratch;
  for (const Expected& e : all) {
    CAPTURE(e.file);
    const ReadOutcome outcome = ReadPath(folder + e.file);
    INFO(outcome.status.message());
    REQUIRE(outcome.status.ok());
    REQUIRE(outcome.report.format == e.format);
    REQUIRE(outcome.mesh.positions.size() == e.vertices);
    REQUIRE(outcome.mesh.triangles.size() == e.triangles);
    REQUIRE(outcome.report.short_faces == 0);
    std::vector<std::string> names;
    for (const VertexAttribute& a : outcome.mesh.header.attributes.attributes) {
      names.push_back(a.name);
    }
    REQUIRE(names == e.attributes);
    REQUIRE_FALSE(outcome.mesh.header.double_positions);
    // Horse: the colours are colours, not the neighbour's bytes.
    if (names.size() == 4) {
      REQUIRE(testing::ValueInRow<float>(outcome.mesh, 0, 0) >= 0.0f);
      REQUIRE(testing::ValueInRow<float>(outcome.mesh, 0, 0) <= 1.0f);
    }
    for (const char* name : {"copy.ply", "copy.off", "copy.obj"}) {
      REQUIRE(WriteMesh(outcome.mesh, scratch.Path(name)).ok());
      const ReadOutcome copy = ReadPath(scratch.Path(name));
      REQUIRE(copy.status.ok());
      REQUIRE(copy.mesh.positions.size() == outcome.mesh.positions.size());
      // The mesh says that float32 does for it: decimals of a text file become the nearest ones.
      bool same = true;
      for (size_t v = 0; v < outcome.mesh.positions.size(); ++v) {
        for (int i = 0; i < 3; ++i) {
          same = same && static_cast<float>(copy.mesh.positions[v][i]) ==
                             static_cast<float>(outcome.mesh.positions[v][i]);
        }
      }
      REQUIRE(same);
      REQUIRE(copy.mesh.triangles == outcome.mesh.triangles);
      if (std::string(name) == "copy.ply") REQUIRE(copy.mesh.rows == outcome.mesh.rows);
    }
  }
}

}  // namespace
}  // namespace mtdb
