// SPDX-License-Identifier: Apache-2.0
// What is read from pipes and from files compressed by gzip.
#include <catch2/catch.hpp>
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

}  // namespace mtdb::testing
