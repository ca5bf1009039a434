// SPDX-License-Identifier: Apache-2.0
// --memory is a promise on the process, whatever a vertex carries; too little memory from the
// system is one line.
#include <catch2/catch.hpp>
#include <cstring>
#include <random>
#include <sys/resource.h>

#include "store/base/bytes.h"
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// A height field of side^2 vertices with random attributes, as PLY.
void WriteMesh(const std::string& path, size_t side, const AttributeLayout& layout,
               std::mt19937_64& random) {
  const auto sink = CreateMeshFileWriter(path).value();
  MeshHeader header;
  header.attributes = layout;
  header.vertex_count = side * side;
  header.triangle_count = 2 * (side - 1) * (side - 1);
  REQUIRE(sink->Begin(header).ok());
  std::vector<Vec3d> positions(side);
  for (size_t y = 0; y < side; ++y) {
    ByteWriter rows;
    for (size_t x = 0; x < side; ++x) {
      const auto height = static_cast<float>(static_cast<double>(random() % 100) * 0.01);
      positions[x] = {static_cast<double>(x), static_cast<double>(y), height};
      for (const VertexAttribute& a : layout.attributes) {
        switch (ScalarSize(a.type)) {
          case 1: rows.Put(static_cast<uint8_t>(random())); break;
          case 2: rows.Put(static_cast<uint16_t>(random())); break;
          case 4:
            if (a.type == ScalarType::kFloat32) {
              rows.Put(static_cast<float>(random()));
            } else {
              rows.Put(static_cast<uint32_t>(random()));
            }
            break;
          default: rows.Put(static_cast<double>(random()) * 1e-3);
        }
      }
    }
    REQUIRE(sink->AddVertices(positions, rows.bytes()).ok());
  }
  std::vector<TriangleVertices> triangles;
  for (VertexIndex y = 0; y + 1 < side; ++y) {
    triangles.clear();
    for (VertexIndex x = 0; x + 1 < side; ++x) {
      const VertexIndex v = y * side + x;
      triangles.push_back({v, v + 1, v + side});
      triangles.push_back({v + 1, v + side + 1, v + side});
    }
    REQUIRE(sink->AddTriangles(triangles).ok());
  }
  REQUIRE(sink->End().ok());
}

AttributeLayout RandomLayout(size_t count, std::mt19937_64& random) {
  AttributeLayout layout;
  const auto one = static_cast<ScalarType>(random() % 8);
  const bool mixed = random() % 2 == 0;
  for (size_t i = 0; i < count; ++i) {
    layout.attributes.push_back(
        {"a" + std::to_string(i), mixed ? static_cast<ScalarType>(random() % 8) : one});
  }
  return layout;
}

struct Measured {
  Outcome outcome;
  uint64_t peak_bytes = 0;
};

Measured RunMeasured(const Arguments& arguments) {
  const Folder folder;
  const pid_t process = Start(arguments, folder.File("out"), folder.File("err"));
  int status = 0;
  rusage usage{};
  REQUIRE(::wait4(process, &status, 0, &usage) == process);
  Measured measured;
  if (WIFEXITED(status)) measured.outcome.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) measured.outcome.signal = WTERMSIG(status);
  measured.outcome.err = ReadText(folder.File("err"));
  measured.peak_bytes = static_cast<uint64_t>(usage.ru_maxrss) << 10;
  return measured;
}

// A sanitizer takes memory, and address space, of its own.
bool SkippedUnderSanitizer() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  WARN("skipped: a sanitizer takes memory of its own");
  return true;
#else
  return false;
#endif
}

// Triangles that share no vertex, after each other.
void WriteStl(const std::string& path, uint32_t triangles) {
  std::string bytes(80, ' ');
  bytes.append(reinterpret_cast<const char*>(&triangles), sizeof(triangles));
  for (uint32_t i = 0; i < triangles; ++i) {
    float numbers[12] = {};
    for (size_t c = 0; c < 3; ++c) {
      numbers[3 + 3 * c] = static_cast<float>(i % 4096) + (c == 1 ? 0.5F : 0);
      numbers[4 + 3 * c] = static_cast<float>(i / 4096) + (c == 2 ? 0.5F : 0);
    }
    bytes.append(reinterpret_cast<const char*>(numbers), sizeof(numbers));
    bytes.append(2, '\0');
  }
  WriteText(path, bytes);
}

TEST_CASE("ingest keeps below --memory with STL beside other formats, or says what it needs",
          "[cli]") {
  if (SkippedUnderSanitizer()) return;
  const Folder folder;
  const std::string stl = folder.File("soup.stl");
  RunOk({"generate", "terrain", folder.File("small.ply"), "--triangles", "100"});
  WriteStl(stl, 2'200'000);
  constexpr uint64_t kCap = uint64_t{256} << 20;
  const Measured run = RunMeasured({"ingest", folder.File("small.ply"), stl,
                                    folder.File("store.mtdb"), "--quiet", "--memory", "256M"});
  INFO(run.outcome.err << "peak " << (run.peak_bytes >> 20) << " MiB");
  CHECK(run.peak_bytes <= kCap);
  CHECK(run.outcome.exit_code == 1);
  CHECK(run.outcome.err.find(stl + ": to join the corners of more than 6291456 vertices takes") !=
        std::string::npos);
  CHECK(!std::filesystem::exists(folder.File("store.mtdb")));
}

TEST_CASE("ingest keeps below --memory with what cannot be simplified, or says what it needs",
          "[cli]") {
  if (SkippedUnderSanitizer()) return;
  const Folder folder;
  const std::string stl = folder.File("soup.stl");
  WriteStl(stl, 1'500'000);
  constexpr uint64_t kMiB = uint64_t{1} << 20;
  for (const uint64_t cap : {256 * kMiB, 640 * kMiB}) {
    const Measured run = RunMeasured({"ingest", stl, folder.File("store.mtdb"), "--quiet",
                                      "--memory", std::to_string(cap), "--threads", "2"});
    INFO(run.outcome.err << "peak " << (run.peak_bytes >> 20) << " of " << (cap >> 20) << " MiB");
    CHECK(run.peak_bytes <= cap);
    CHECK(run.outcome.exit_code == (cap == 256 * kMiB ? 1 : 0));
    if (cap == 256 * kMiB) {
      CHECK(run.outcome.err.find("cannot be simplified below 1500000") != std::string::npos);
    }
  }
}

TEST_CASE("ingest keeps below --memory whatever the attributes, or says what it needs", "[cli]") {
  if (SkippedUnderSanitizer()) return;
  const char* const cases = std::getenv("MTDB_MEMORY_CASES");
  const uint64_t last = cases == nullptr ? 3 : std::strtoull(cases, nullptr, 10);
  for (uint64_t seed = 1; seed <= last; ++seed) {
    std::mt19937_64 random(seed);
    const size_t counts[] = {0, 3, 10, 64, 300, 2500};
    const AttributeLayout layout = RandomLayout(counts[seed % 6], random);
    const size_t row = layout.row_bytes();
    // Some 20 MB of rows, and at least a full tile and a half.
    const auto side = static_cast<size_t>(
        std::clamp(std::sqrt(2e7 / static_cast<double>(row + 24)), 80.0, 400.0));
    uint64_t cap = (uint64_t{256} + random() % 200) << 20;
    const std::string threads = std::to_string(1 + random() % 8);
    const Folder folder;
    WriteMesh(folder.File("mesh.ply"), side, layout, random);
    for (int attempt = 0; attempt < 2; ++attempt) {
      INFO("seed " << seed << ": " << layout.attributes.size() << " attributes, " << row
                   << " bytes a vertex, " << side << "^2 vertices, " << threads << " threads, cap "
                   << (cap >> 20) << " MiB");
      const Measured run =
          RunMeasured({"ingest", folder.File("mesh.ply"), folder.File("store.mtdb"), "--quiet",
                       "--memory", std::to_string(cap), "--threads", threads});
      INFO(run.outcome.err << "peak " << (run.peak_bytes >> 20) << " MiB");
      if (cases != nullptr) {
        WARN("peak " << (run.peak_bytes >> 20) << " MiB, exit " << run.outcome.exit_code);
      }
      CHECK(run.peak_bytes <= cap);
      if (run.outcome.exit_code == 0) {
        CHECK(RunJson({"verify", folder.File("store.mtdb"), "--level", "full"}).at("ok") == true);
        break;
      }
      REQUIRE(attempt == 0);
      REQUIRE(run.outcome.exit_code == 1);
      REQUIRE(IsOneLine(run.outcome.err));
      const std::string words = "need at least ";
      const size_t at = run.outcome.err.find(words);
      REQUIRE(at != std::string::npos);
      REQUIRE_FALSE(Exists(folder.File("store.mtdb")));
      cap = std::strtoull(run.outcome.err.c_str() + at + words.size(), nullptr, 10) << 20;
    }
  }
}

TEST_CASE("an ingest that gets too little memory ends with one line, and can be gone on with",
          "[cli]") {
  if (SkippedUnderSanitizer()) return;
  const Folder folder;
  const std::string mesh = folder.File("mesh.ply");
  const std::string store = folder.File("store.mtdb");
  RunOk({"generate", "sculpture", mesh, "--triangles", "20000"});
  const Json fresh = RunJson({"ingest", mesh, folder.File("fresh.mtdb"), "--name", "o"});
  int failed = 0;
  int done = 0;
  for (int mebibytes = 8; mebibytes < 400; mebibytes += mebibytes < 160 ? 8 : 60) {
    INFO("address space of " << mebibytes << " MiB");
    const auto run = [&](const std::string& what) {
      const std::string command = "ulimit -v " + std::to_string(mebibytes << 10) + "; exec '" +
                                  MTDB_BINARY + "' " + what + " > '" + folder.File("out") +
                                  "' 2> '" + folder.File("err") + "'";
      return std::system(command.c_str());
    };
    if (run("--version") != 0) continue;  // not even the program can be loaded
    const int status = run("ingest '" + mesh + "' '" + store +
                           "' --name o --quiet --replace --threads 4 --resume");
    const std::string err = ReadText(folder.File("err"));
    INFO(err);
    REQUIRE(WIFEXITED(status));
    REQUIRE(WEXITSTATUS(status) <= 1);
    (WEXITSTATUS(status) == 0 ? done : failed) += 1;
    if (WEXITSTATUS(status) == 1) CHECK(IsOneLine(err));
    for (const auto& entry : std::filesystem::directory_iterator(folder.File(""))) {
      const std::string name = entry.path().filename().string();
      INFO(name);
      CHECK((name == "mesh.ply" || name == "out" || name == "err" || name.ends_with(".mtdb") ||
             name.ends_with(".mtdb-lock") || name.ends_with(".journal")));
    }
  }
  CHECK(failed >= 2);
  CHECK(done >= 3);
  CHECK(RunJson({"ingest", mesh, store, "--name", "o", "--replace", "--resume"}).at("digest") ==
        fresh.at("digest"));
  CHECK(RunJson({"verify", store, "--level", "full"}).at("ok") == true);
  CHECK_FALSE(RunJson({"list", store}).contains("journals"));
}

}  // namespace
}  // namespace mtdb::test
