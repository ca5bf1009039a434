// SPDX-License-Identifier: Apache-2.0
// What is read from pipes and from files compressed by gzip.
#include <array>
#include <catch2/catch.hpp>
#include <csignal>
#include <fcntl.h>
#include <fstream>
#include <random>
#include <thread>
#include <unistd.h>
#include <zlib.h>

#include "codecs/mesh_file/mesh_file.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::testing {
namespace {

std::string Gzip(const std::string& text) {
  z_stream stream{};
  REQUIRE(::deflateInit2(&stream, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY) == Z_OK);
  std::string out(::deflateBound(&stream, text.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  REQUIRE(::deflate(&stream, Z_FINISH) == Z_STREAM_END);
  out.resize(stream.total_out);
  ::deflateEnd(&stream);
  return out;
}

std::string ObjText(int vertices) {
  std::string text;
  for (int i = 0; i < vertices; ++i) {
    text += "v " + std::to_string(i) + " " + std::to_string((i % 101) * (i % 101)) + " 0\n";
  }
  for (int i = 3; i <= vertices; ++i) {
    text +=
        "f " + std::to_string(i - 2) + " " + std::to_string(i - 1) + " " + std::to_string(i) + "\n";
  }
  return text;
}

void Write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

Status ReadAll(const Result<MeshInput>& input, TriangleMesh* mesh) {
  MTDB_RETURN_IF_ERROR(input.status());
  *mesh = {};
  TriangleMeshSink sink(mesh);
  return input->Read(sink, nullptr);
}

}  // namespace

TEST_CASE("A file compressed by gzip is read as what is in it, any number of times") {
  const TemporaryFolder folder;
  const std::string text = ObjText(20000);
  const std::string path = folder.path() + "/mesh.obj.gz";
  // In two members, as programs that work in parallel write them, and with padding.
  Write(path, Gzip(text.substr(0, 100'000)) + Gzip(text.substr(100'000)) + std::string(700, '\0'));
  const Result<MeshInput> input = MeshInput::Open(path);
  for (int i = 0; i < 2; ++i) {
    TriangleMesh mesh;
    const Status status = ReadAll(input, &mesh);
    INFO(status.message());
    REQUIRE(status.ok());
    CHECK(mesh.positions.size() == 20000);
    CHECK(mesh.triangles.size() == 19998);
  }
  CHECK(IsMeshFile(path));
}

TEST_CASE("Gzip that is cut short or damaged anywhere is refused, and says so") {
  const TemporaryFolder folder;
  const std::string good = Gzip(ObjText(300));
  const std::string path = folder.path() + "/mesh.obj.gz";
  const auto refused = [&](const std::string& bytes) {
    Write(path, bytes);
    TriangleMesh mesh;
    const Status status = ReadAll(MeshInput::Open(path), &mesh);
    INFO(status.message());
    REQUIRE(status.code() == StatusCode::kBadInput);
    CHECK_THAT(status.message(), Catch::StartsWith(path + ": "));
    return status.message();
  };
  for (size_t size = 2; size < good.size(); ++size) {
    CHECK_THAT(refused(good.substr(0, size)), Catch::Contains("cut short"));
  }
  std::mt19937 random(4);
  for (int i = 0; i < 300; ++i) {
    std::string bytes = good;
    // Not the header, whose time and name tell nothing.
    const size_t at = 10 + random() % (bytes.size() - 10);
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << random() % 8));
    refused(bytes);
  }
  CHECK_THAT(refused(good + "more"), Catch::Contains("gzip"));
}

TEST_CASE("A mesh comes through a pipe, compressed or not, and the descriptor stays open") {
  const std::string text = ObjText(50000);
  for (const bool compressed : {false, true}) {
    int ends[2];
    REQUIRE(::pipe(ends) == 0);
    std::thread writer([&] {
      const std::string bytes = compressed ? Gzip(text) : text;
      // The first byte alone: what is at the start must not depend on how much comes at once.
      for (size_t at = 0; at < bytes.size();) {
        const ssize_t n = ::write(ends[1], bytes.data() + at, at == 0 ? 1 : bytes.size() - at);
        if (n <= 0) break;
        at += static_cast<size_t>(n);
      }
      ::close(ends[1]);
    });
    MeshReadOptions options;
    options.descriptor = ends[0];
    options.suffix = "obj";
    TriangleMesh mesh;
    const Status status = ReadAll(MeshInput::Open("standard input", options), &mesh);
    writer.join();
    INFO(status.message());
    CHECK(status.ok());
    CHECK(mesh.positions.size() == 50000);
    CHECK(::fcntl(ends[0], F_GETFD) >= 0);
    ::close(ends[0]);
  }
}

TEST_CASE("A folder for copies that is not there is named") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/mesh.obj.gz";
  Write(path, Gzip(ObjText(10)));
  MeshReadOptions options;
  options.tmp_directory = folder.path() + "/none";
  const Result<MeshInput> input = MeshInput::Open(path, options);
  CHECK(input.status().code() == StatusCode::kIoError);
  CHECK_THAT(input.status().message(), Catch::Contains("/none: temporary file"));
}

namespace {

// What comes of a pipe into which `endless` is written again and again behind `start`, until
// nobody reads or 200 MiB are written; `*taken` is how much was.
Status ReadEndless(const std::string& start, std::string endless, MeshReadOptions options,
                   uint64_t* taken) {
  while (endless.size() < 1 << 16) endless += endless;
  int ends[2];
  REQUIRE(::pipe(ends) == 0);
  ::signal(SIGPIPE, SIG_IGN);
  *taken = 0;
  std::thread writer([&] {
    const std::string* next = &start;
    while (*taken < 200'000'000) {
      const ssize_t n = ::write(ends[1], next->data(), next->size());
      if (n < 0) break;
      *taken += static_cast<uint64_t>(n);
      next = &endless;
    }
    ::close(ends[1]);
  });
  options.descriptor = ends[0];
  TriangleMesh mesh;
  const Status status = MeshInput::Open("standard input", options).status();
  ::close(ends[0]);
  writer.join();
  return status;
}

std::string Bytes32(uint32_t value) {
  return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

}  // namespace

TEST_CASE("A stream without an end that is no mesh is refused after its first MiB") {
  const std::string zeros(1, '\0');
  const std::string ply =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float "
      "y\nproperty float z\nelement face 1\nproperty list uchar int "
      "vertex_indices\nend_header\n";
  struct Case {
    std::string suffix, start, endless, words;
  };
  const std::vector<Case> cases{
      {"stl", "", zeros, "count is 0"},
      {"stl", std::string(80, 'x') + Bytes32(3), zeros, "1 MiB follows"},
      {"stl", std::string(80, 'x') + Bytes32(1 << 30), "\xff\xff\xff\xff", "finite number"},
      {"stl", "solid a\n", "nothing\n", "facet"},
      {"stl", "solid", zeros, "count is 0"},
      {"ply", "ply\nformat ascii 1.0\n", "comment never ends\n", "does not end"},
      {"ply", "ply\nformat ascii 1.0\n", zeros, "line 3"},
      {"ply", ply, zeros, "1 MiB follows"},
      {"ply", "", zeros, "ply"},
      {"obj", "", "# a comment\n", "no statement"},
      {"obj", "", zeros, "no statement"},
      {"obj", "v 1 2 3\n", zeros, "is 0"},
      {"off", "OFF\n", "# a comment\n", "no counts"},
      {"off", "OFF 3 1 0\n", zeros, "is 0"},
      {"glb", "glTF" + Bytes32(2) + Bytes32(1000), zeros, "1 MiB follows"},
      {"gltf", "{", " ", "1 MiB follows"},
      {"drc", "DRACO", zeros, "Draco"},
      {"", "", zeros, "not a mesh file"},
      {"", "", "any text\n", "not a mesh file"},
  };
  for (const Case& c : cases) {
    MeshReadOptions options;
    options.suffix = c.suffix;
    uint64_t taken = 0;
    const Status status = ReadEndless(c.start, c.endless, options, &taken);
    INFO(c.suffix << " " << c.start << ": " << status.message());
    CHECK(status.code() == StatusCode::kBadInput);
    CHECK_THAT(status.message(), Catch::StartsWith("standard input: "));
    CHECK_THAT(status.message(), Catch::Contains(c.words));
    CHECK(taken < 20'000'000);  // 16 MiB of JSON, and what pipes hold
  }
}

TEST_CASE("A compressed text may have any length") {
  constexpr size_t kBlock = size_t{256} << 10;  // of the decompressor
  const std::string triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  const TemporaryFolder folder;
  for (const size_t size : {kBlock - 1, kBlock, kBlock + 1, 2 * kBlock, 8 * kBlock}) {
    const std::string text = triangle + std::string(size - triangle.size(), '\n');
    const std::string half = text.substr(0, kBlock - 1), rest = text.substr(half.size());
    int number = 0;
    for (const std::string& bytes :
         {Gzip(text), Gzip(half) + Gzip(rest), Gzip(text) + std::string(512, '\0')}) {
      const std::string path = folder.path() + "/a" + std::to_string(number++) + ".obj.gz";
      Write(path, bytes);
      const Result<MeshInput> input = MeshInput::Open(path);
      INFO(size << ": " << input.status().message());
      REQUIRE(input.ok());
      TriangleMesh mesh;
      TriangleMeshSink sink(&mesh);
      REQUIRE(input->Read(sink, nullptr).ok());
      CHECK(mesh.triangles.size() == 1);
    }
  }
}

TEST_CASE("Compressed zeros fill no disk") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/bomb.stl.gz";
  Write(path, Gzip(std::string(50'000'000, '\0')));
  const Status status = MeshInput::Open(path).status();
  CHECK(status.code() == StatusCode::kBadInput);
  CHECK_THAT(status.message(), Catch::Contains("count is 0"));
}

TEST_CASE("Facets whose count is 0 come through a copy, too") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/streamed.stl.gz";
  constexpr uint32_t kFacets = 30'000;  // more than a MiB
  std::string bytes = std::string(80, 'x') + Bytes32(0);
  for (uint32_t i = 0; i < kFacets; ++i) {
    const float x = static_cast<float>(i);
    const std::array<float, 12> facet{0, 0, 1, x, 0, 0, x + 1, 0, 0, x, 1, 0};
    bytes.append(reinterpret_cast<const char*>(facet.data()), sizeof(facet)).append(2, '\0');
  }
  Write(path, Gzip(bytes));
  const Result<MeshInput> input = MeshInput::Open(path);
  REQUIRE(input.ok());
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  REQUIRE(input->Read(sink, nullptr).ok());
  CHECK(mesh.triangles.size() == kFacets);
}

TEST_CASE("A copy takes no more than it may, and says how far it came") {
  MeshReadOptions options;
  options.suffix = "obj";
  options.max_tmp_bytes = 5 << 20;
  uint64_t taken = 0;
  const Status status = ReadEndless("", "v 1 2 3\n", options, &taken);
  INFO(status.message());
  CHECK(status.code() == StatusCode::kBudgetExceeded);
  CHECK_THAT(status.message(), Catch::Contains("no more than 5 MiB"));
  CHECK(taken < 6 << 20);
}

TEST_CASE("Reading stops when it is told to, while much comes and while nothing comes") {
  MeshReadOptions options;
  options.suffix = "obj";
  int looks = 0;
  options.look = [&] {
    return ++looks < 20 ? Status::Ok() : Status(StatusCode::kCancelled, "enough");
  };
  uint64_t taken = 0;
  CHECK(ReadEndless("", "v 1 2 3\n", options, &taken).message() == "enough");
  looks = 0;
  int ends[2];
  REQUIRE(::pipe(ends) == 0);
  options.descriptor = ends[0];
  for (const std::string& sent : {std::string(), std::string("v 1 2 3\n")}) {
    REQUIRE(::write(ends[1], sent.data(), sent.size()) == static_cast<ssize_t>(sent.size()));
    CHECK(MeshInput::Open("standard input", options).status().message() == "enough");
  }
  // A descriptor that does not wait is waited for all the same.
  looks = 0;
  REQUIRE(::fcntl(ends[0], F_SETFL, O_NONBLOCK) == 0);
  CHECK(MeshInput::Open("standard input", options).status().message() == "enough");
  ::close(ends[0]);
  ::close(ends[1]);
  // A file is looked at while it is read.
  const TemporaryFolder folder;
  Write(folder.path() + "/a.obj", ObjText(200000));
  options.descriptor = -1;
  looks = 0;
  const Result<MeshInput> input = MeshInput::Open(folder.path() + "/a.obj", options);
  REQUIRE(input.ok());
  TriangleMesh mesh;
  CHECK(ReadAll(input, &mesh).message() == "enough");
}

TEST_CASE("Meshes of every format of more than 1 MiB come through a pipe as from a file") {
  const TemporaryFolder folder;
  constexpr int kVertices = 60000;
  const std::string source = folder.path() + "/source.obj";
  Write(source, ObjText(kVertices));
  TriangleMesh mesh;
  REQUIRE(ReadAll(MeshInput::Open(source), &mesh).ok());
  mesh.header.vertex_count = mesh.positions.size();
  mesh.header.triangle_count = mesh.triangles.size();
  for (const MeshFormat& format : WrittenMeshFormats()) {
    const std::string suffix(format.suffixes[0]);
    const std::string path = folder.path() + "/mesh." + suffix;
    {
      auto writer = CreateMeshFileWriter(path).value();
      INFO(suffix);
      REQUIRE(writer->Begin(mesh.header).ok());
      REQUIRE(writer->AddVertices(mesh.positions, mesh.rows).ok());
      REQUIRE(writer->AddTriangles(mesh.triangles).ok());
      REQUIRE(writer->End().ok());
    }
    TriangleMesh expected, piped;
    REQUIRE(ReadAll(MeshInput::Open(path), &expected).ok());
    MeshReadOptions options;
    options.suffix = suffix;
    options.descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    const Status status = ReadAll(MeshInput::Open("standard input", options), &piped);
    ::close(options.descriptor);
    INFO(suffix << ": " << status.message());
    REQUIRE(status.ok());
    CHECK(piped.positions == expected.positions);
    CHECK(piped.triangles == expected.triangles);
  }
}

}  // namespace mtdb::testing
