// SPDX-License-Identifier: Apache-2.0
// Answers larger than the cache: each cluster is decoded once, whatever the file for those that had
// to go does.
#include <array>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <dirent.h>
#include <random>
#include <set>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

#include "query/answer/kept_triangles.h"
#include "query/cache/cluster_cache.h"
#include "query/cache/unit_image.h"
#include "query/surface.h"
#include "tests/query/mt_fixture.h"
#include "tests/query/oracle.h"

namespace mtdb::testing {

using namespace internal;

namespace {

MtFixture Fixture(uint32_t seed) {
  MtOptions o;
  o.shape = static_cast<Shape>(seed % 4);
  o.resolution = 40;
  o.rounds = 4;
  o.tiles = 36;
  o.attributes = seed % 2 == 0;
  o.coincident = seed % 8 >= 4;
  o.seed = seed;
  return MakeMt(o);
}

std::vector<Query> SomeQueries(const MtFixture& f, std::mt19937& random) {
  const Box3d& box = f.source->record_.bounds;
  std::vector<Query> queries(5);  // the first is the whole surface
  queries[1].threshold = ConstantThreshold(Diagonal(box) / 200);
  queries[2].region = BoxRegion({box.min, (box.min + box.max) * 0.5});
  queries[2].clip = true;
  queries[3].threshold = LinearThreshold(box.min, 0, 0.02);
  queries[4] = queries[1];
  queries[4].normals = true;
  for (int i = 0; i < 4; ++i) queries.push_back(RandomQuery(f, random));
  return queries;
}

struct Answer {
  Status status;
  TriangleMesh mesh;
  ExtractStats stats;
};

Answer Ask(const Surface& surface, const Query& query) {
  Answer answer;
  TriangleMeshSink sink(&answer.mesh);
  Result<ExtractStats> result = surface.Extract(query, sink);
  answer.status = result.status();
  UNSCOPED_INFO(answer.status.message());
  if (result.ok()) answer.stats = *std::move(result);
  return answer;
}

bool SameMesh(const Answer& a, const Answer& b) {
  return a.status.ok() && b.status.ok() && a.mesh.positions == b.mesh.positions &&
         a.mesh.triangles == b.mesh.triangles && a.mesh.rows == b.mesh.rows;
}

std::shared_ptr<Surface> Open(const MtFixture& f, const SurfaceOptions& options) {
  return Surface::Open(f.source, options).value();
}

// A small cache that suffices for the query.
size_t SmallCache(const MtFixture& f, const Query& query) {
  SurfaceOptions options;
  options.threads = 1;
  for (options.cache_bytes = 20'000;; options.cache_bytes += options.cache_bytes / 4) {
    if (Ask(*Open(f, options), query).status.ok()) return options.cache_bytes;
  }
}

// Descriptors; none without /proc.
std::set<int> OpenFiles() {
  std::set<int> files;
  DIR* const folder = opendir("/proc/self/fd");
  if (folder == nullptr) return files;
  while (const dirent* const entry = readdir(folder)) {
    const int file = std::atoi(entry->d_name);
    if (entry->d_name[0] != '.' && file != dirfd(folder)) files.insert(file);
  }
  closedir(folder);
  return files;
}

// Calls f(descriptor, bytes) for each regular file that has been opened since.
template <typename F>
void ForEachNewFile(const std::set<int>& before, F&& f) {
  for (const int file : OpenFiles()) {
    struct stat info {};
    if (before.contains(file) || fstat(file, &info) != 0 || !S_ISREG(info.st_mode)) continue;
    f(file, info.st_size);
  }
}

// Takes a mesh, and calls f() before its first triangles.
template <typename F>
class InterruptedSink final : public MeshSink {
 public:
  InterruptedSink(TriangleMesh* mesh, F f) : sink_(mesh), f_(std::move(f)) {}
  Status Begin(const MeshHeader& header) override { return sink_.Begin(header); }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    return sink_.AddVertices(positions, rows);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    if (!called_) f_();
    called_ = true;
    return sink_.AddTriangles(triangles);
  }
  Status End() override { return sink_.End(); }

 private:
  TriangleMeshSink sink_;
  F f_;
  bool called_ = false;
};

// Loses the second half, or changes the first one here and there.
void Damage(int file, off_t size, bool cut_off) {
  const off_t half = size / 2;
  REQUIRE(half > 0);
  if (cut_off) REQUIRE(ftruncate(file, half) == 0);
  for (off_t at = 100; at < half; at += 1000) {
    const char byte = '?';
    REQUIRE(pwrite(file, &byte, 1, at) == 1);
  }
}

size_t DecodedBytes(const MtFixture& f) {
  const auto surface = Open(f, {.cache_bytes = size_t{1} << 30, .threads = 1});
  Ask(*surface, {});
  return surface->cache().bytes();
}

}  // namespace

TEST_CASE("Of an answer larger than the cache each cluster is decoded once") {
  std::mt19937 random(3);
  uint64_t decoded = 0, used = 0, without = 0;
  for (uint32_t seed = 1; seed <= 8; ++seed) {
    const MtFixture f = Fixture(seed);
    for (const Query& query : SomeQueries(f, random)) {
      const auto large = Open(f, {.threads = 1});
      const Answer expected = Ask(*large, query);
      const size_t bytes = SmallCache(f, query);
      for (const unsigned threads : {1u, 3u}) {
        const auto small = Open(f, {.cache_bytes = bytes, .threads = threads});
        const Answer answer = Ask(*small, query);
        INFO("seed " << seed << ", " << bytes << " bytes");
        REQUIRE(SameMesh(answer, expected));
        REQUIRE(small->cache().peak_bytes() <= bytes);
        if (threads > 1) continue;
        REQUIRE(answer.stats.clusters_read == expected.stats.clusters_read);
        REQUIRE(small->cache().decoded() == large->cache().decoded());
        // A second one on a cache that the first has left full.
        REQUIRE(SameMesh(Ask(*small, query), expected));
        REQUIRE(small->cache().decoded() <= 2 * large->cache().decoded());
        if (query.threshold == nullptr || query.region != nullptr) continue;
        decoded += answer.stats.clusters_read;
        used += answer.stats.clusters_used;
        const auto again = Open(f, {.cache_bytes = bytes, .threads = threads, .spill_bytes = 0});
        without += Ask(*again, query).stats.clusters_read;
      }
    }
  }
  CHECK(static_cast<double>(decoded) <= 1.05 * static_cast<double>(used));
  CHECK(without > 2 * used);  // or the caches were not small
}

// What an error says after "--cache "; 0: it says nothing of the kind.
size_t AdvisedBytes(const Status& status) {
  const std::string& text = status.message();
  const size_t at = text.find("--cache ");
  return at == std::string::npos ? 0 : 1024 * std::strtoull(text.c_str() + at + 8, nullptr, 10);
}

TEST_CASE("A cache that is too small says which one would do") {
  std::mt19937 random(9);
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    const MtFixture f = Fixture(seed);
    for (const Query& query : SomeQueries(f, random)) {
      for (const RuntimeForm form : {RuntimeForm::kExplicit, RuntimeForm::kImplicit}) {
        for (const size_t bytes : {size_t{1}, size_t{3000}, size_t{20'000}}) {
          SurfaceOptions options{.cache_bytes = bytes, .form = form, .threads = 1 + seed % 3};
          Answer answer = Ask(*Open(f, options), query);
          if (answer.status.ok()) continue;
          REQUIRE(answer.status.code() == StatusCode::kBudgetExceeded);
          options.cache_bytes = AdvisedBytes(answer.status);
          answer = Ask(*Open(f, options), query);
          INFO("seed " << seed << ", " << bytes << ", then " << options.cache_bytes << ": "
                       << answer.status.message());
          REQUIRE(answer.status.ok());
          REQUIRE(options.cache_bytes <= 2'000'000);
        }
      }
    }
  }
}

TEST_CASE("Without the file clusters are decoded again, and answers are the same") {
  std::mt19937 random(4);
  const MtFixture f = Fixture(2);
  for (const Query& query : SomeQueries(f, random)) {
    const Answer expected = Ask(*Open(f, {.threads = 1}), query);
    const size_t bytes = SmallCache(f, query);
    for (const uint64_t spill_bytes : {0, 1, 10'000, 60'000}) {
      REQUIRE(SameMesh(Ask(*Open(f, {.cache_bytes = bytes, .spill_bytes = spill_bytes}), query),
                       expected));
    }
    const auto nowhere = Open(f, {.cache_bytes = bytes, .tmp_directory = "/none/such"});
    REQUIRE(SameMesh(Ask(*nowhere, query), expected));
  }
}

TEST_CASE("The file is there as long as its query, and one at a time") {
  const MtFixture f = Fixture(3);
  const Query query;
  const size_t before = OpenFiles().size();
  if (before == 0) return;  // no /proc
  const auto surface = Open(f, {.cache_bytes = SmallCache(f, query), .threads = 1});
  const Answer expected = Ask(*Open(f, {.threads = 1}), query);
  {
    Result<Cut> first = surface->Select(query);
    Result<Cut> second = surface->Select(query);
    for (Cut* cut : {&*first, &*second, &*first}) {
      Answer answer;
      TriangleMeshSink sink(&answer.mesh);
      answer.status = cut->Emit(sink);
      REQUIRE(SameMesh(answer, expected));
      REQUIRE(OpenFiles().size() == before + 1);
    }
  }
  REQUIRE(OpenFiles().size() == before);
}

TEST_CASE("Emitting a cut again takes no more of the file") {
  const MtFixture f = Fixture(3);
  const std::set<int> before = OpenFiles();
  if (before.empty()) return;  // no /proc
  const auto surface = Open(f, {.cache_bytes = DecodedBytes(f) - 1, .threads = 1});
  const Query query;
  Result<Cut> cut = surface->Select(query);
  std::vector<off_t> sizes;
  for (int i = 0; i < 4; ++i) {
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    REQUIRE(cut->Emit(sink).ok());
    ForEachNewFile(before, [&](int, off_t size) { sizes.push_back(size); });
  }
  REQUIRE(sizes.size() == 4);
  REQUIRE(sizes[0] > 0);
  REQUIRE(sizes[3] == sizes[0]);
}

TEST_CASE("Triangles that wait for the vertices are in the file, and what has been sent is not") {
  for (uint32_t seed = 1; seed <= 3; ++seed) {
    const MtFixture f = Fixture(seed);
    const Answer expected = Ask(*Open(f, {.threads = 1}), {});
    const std::set<int> before = OpenFiles();
    if (before.empty()) return;  // no /proc
    const size_t decoded = DecodedBytes(f);
    for (const size_t cache_bytes : {decoded - 1, decoded / 2, 2 * decoded}) {
      const auto surface = Open(f, {.cache_bytes = cache_bytes, .threads = 1});
      size_t file_bytes = 0;
      Answer answer;
      InterruptedSink sink(&answer.mesh, [&] {
        ForEachNewFile(before, [&](int, off_t size) { file_bytes += static_cast<size_t>(size); });
      });
      answer.status = surface->Extract({}, sink).status();
      REQUIRE(SameMesh(answer, expected));
      const size_t lists = 12 * expected.mesh.triangles.size() + 8 * f.source->index().unit_count();
      if (cache_bytes > decoded) {
        CHECK(file_bytes == 0);
      } else {
        CHECK(file_bytes >= lists);
        CHECK(file_bytes <= lists + decoded / 4);
      }
    }
  }
}

TEST_CASE("Triangles that the file has lost or changed are made again") {
  std::mt19937 random(5);
  for (const bool cut_off : {true, false}) {
    const MtFixture f = Fixture(2);
    for (const Query& query : SomeQueries(f, random)) {
      const Answer expected = Ask(*Open(f, {.threads = 1}), query);
      const std::set<int> before = OpenFiles();
      const auto surface = Open(f, {.cache_bytes = SmallCache(f, query), .threads = 2});
      Answer answer;
      InterruptedSink sink(&answer.mesh, [&] {
        ForEachNewFile(before, [&](int file, off_t size) { Damage(file, size, cut_off); });
      });
      answer.status = surface->Extract(query, sink).status();
      REQUIRE(SameMesh(answer, expected));
    }
  }
}

TEST_CASE("Lists of triangles come back from the file, with numbers of any size") {
  for (const uint64_t vertices : {uint64_t{1000}, uint64_t{0xffffffff}, uint64_t{1} << 40}) {
    std::mt19937_64 random(1);
    std::vector<std::vector<TriangleVertices>> lists(8);
    for (size_t i = 0; i < lists.size(); ++i) {
      lists[i].resize(i * i * 7);
      for (TriangleVertices& t : lists[i]) {
        for (VertexIndex& v : t) v = random() % vertices;
      }
    }
    const auto file = std::make_shared<SpillFile>("", 20'000);
    KeptTriangles kept;
    // Another answer's lists are where the first one's were, where they fit.
    for (const size_t shorter : {0, 1, 0}) {
      kept.Begin(file, lists.size(), vertices);
      REQUIRE(kept.open());
      for (const size_t i : {0, 3, 5}) REQUIRE(!kept.Has(i));
      for (const size_t i : {5, 0, 3}) REQUIRE(kept.Keep(i, lists[i - (i > 0 ? shorter : 0)]));
      for (const size_t i : {0, 3, 5}) {
        REQUIRE(kept.Has(i));
        std::vector<TriangleVertices> found(kept.size(i));
        REQUIRE(kept.Read(i, found.data()));
        REQUIRE(found == lists[i - (i > 0 ? shorter : 0)]);
      }
    }
    REQUIRE(!kept.Has(1));
    REQUIRE(!kept.Has(lists.size()));
    // No room for more than the file may have.
    lists[7].resize(2000);
    REQUIRE(!kept.Keep(7, lists[7]));
    REQUIRE(!kept.Has(7));
    REQUIRE(!kept.open());
  }
  REQUIRE(!KeptTriangles().open());
  REQUIRE(!KeptTriangles().Has(0));
}

TEST_CASE("What the file has lost or changed is decoded again") {
  for (const bool cut_off : {true, false}) {
    for (uint32_t seed = 1; seed <= 4; ++seed) {
      const MtFixture f = Fixture(seed);
      Query query;
      query.threshold = ConstantThreshold(Diagonal(f.source->record_.bounds) / 200);
      const Answer expected = Ask(*Open(f, {.threads = 1}), query);
      const std::set<int> before = OpenFiles();
      if (before.empty()) return;  // no /proc
      const auto surface = Open(f, {.cache_bytes = SmallCache(f, query), .threads = 1 + seed % 2});
      Cut cut = surface->Select(query).value();
      const uint64_t decoded = surface->cache().decoded();
      ForEachNewFile(before, [&](int file, off_t size) { Damage(file, size, cut_off); });
      Answer answer;
      TriangleMeshSink sink(&answer.mesh);
      answer.status = cut.Emit(sink);
      REQUIRE(SameMesh(answer, expected));
      REQUIRE(surface->cache().decoded() > decoded);
    }
  }
}

TEST_CASE("The image of a unit is the unit, and damaged bytes are none") {
  for (uint32_t seed = 1; seed <= 8; ++seed) {
    const MtFixture f = Fixture(seed);
    ClusterCache cache(f.source, {size_t{1} << 30});
    LoadStats stats;
    for (UnitId u = 0; u < f.source->index().unit_count(); u += 7) {
      const LoadedUnitPtr unit = cache.Get(u, &stats).value();
      Bytes image = MakeUnitImage(*unit);
      const LoadedUnitPtr back = UnitFromImage(image);
      REQUIRE(back != nullptr);
      REQUIRE(MakeUnitImage(*back) == image);
      REQUIRE(back->memory_bytes() <= unit->memory_bytes());
      REQUIRE(back->removers() == unit->removers());
      REQUIRE(UnitFromImage(ByteSpan(image).first(image.size() - 1)) == nullptr);
      REQUIRE(UnitFromImage(ByteSpan(image).first(7)) == nullptr);
      image[(u * 977) % image.size()] ^= std::byte{4};
      REQUIRE(UnitFromImage(image) == nullptr);
    }
  }
}

}  // namespace mtdb::testing
