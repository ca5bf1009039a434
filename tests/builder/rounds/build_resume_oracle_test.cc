// SPDX-License-Identifier: Apache-2.0
// An interrupted build, any one thing changed, and on with --resume: what comes is what a build
// from nothing makes of the changed input, or it is refused and the journal is kept.
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <functional>
#include <random>

#include "tests/builder/fixture.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::testing {
namespace {

// id, colour, normal, a float, a double: every kind of attribute.
constexpr size_t kColour = 4;
constexpr size_t kNormal = 7;
constexpr size_t kQuality = 19;
constexpr size_t kTime = 23;
constexpr size_t kRowBytes = 31;

TriangleMesh MakeMesh() {
  TriangleMesh mesh = MakeSculpture(6000, 3);
  mesh.header.attributes.attributes = {
      {"id", ScalarType::kUint32},   {"red", ScalarType::kUint8},
      {"green", ScalarType::kUint8}, {"blue", ScalarType::kUint8},
      {"nx", ScalarType::kFloat32},  {"ny", ScalarType::kFloat32},
      {"nz", ScalarType::kFloat32},  {"quality", ScalarType::kFloat32},
      {"time", ScalarType::kFloat64}};
  std::mt19937_64 random(5);
  std::normal_distribution<double> coordinate;
  ByteWriter w;
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    w.Put(static_cast<uint32_t>(v));
    for (int i = 0; i < 3; ++i) w.Put(static_cast<uint8_t>(random() % 256));
    for (int i = 0; i < 3; ++i) w.Put(static_cast<float>(coordinate(random)));
    w.Put(static_cast<float>(100 * coordinate(random)));
    w.Put(1e6 + coordinate(random));
  }
  mesh.rows = w.Take();
  return mesh;
}

struct Work {
  TriangleMesh mesh;
  BuildOptions options;
  std::mt19937_64 random;
  size_t Vertex() { return random() % mesh.positions.size(); }
  size_t Triangle() { return random() % mesh.triangles.size(); }
  std::byte* Row(size_t vertex, size_t offset) {
    return mesh.rows.data() + vertex * kRowBytes + offset;
  }
};

// Vertex `v` gets the number that `to(v)` says, everywhere.
void Renumber(Work& w, const std::function<size_t(size_t)>& to) {
  const TriangleMesh before = w.mesh;
  for (size_t v = 0; v < before.positions.size(); ++v) {
    w.mesh.positions[to(v)] = before.positions[v];
    std::memcpy(w.Row(to(v), 0), before.rows.data() + v * kRowBytes, kRowBytes);
  }
  for (TriangleVertices& t : w.mesh.triangles) {
    for (VertexIndex& v : t) v = to(v);
  }
}

struct Change {
  const char* what;
  bool matters;  // false: the journal must serve
  void (*make)(Work& w);
};

const Change kChanges[] = {
    {"nothing", false, [](Work&) {}},
    {"threads", false, [](Work& w) { w.options.threads = 1 + w.random() % 5; }},
    {"memory", false, [](Work& w) { w.options.memory_bytes = (256 + w.random() % 512) << 20; }},
    {"a colour", true,
     [](Work& w) { *w.Row(w.Vertex(), kColour + w.random() % 3) ^= std::byte{1}; }},
    {"all colours", true,
     [](Work& w) {
       for (size_t v = 0; v < w.mesh.positions.size(); ++v) {
         *w.Row(v, kColour) = static_cast<std::byte>(w.random());
       }
     }},
    {"an integer", true, [](Work& w) { *w.Row(w.Vertex(), 0) ^= std::byte{1}; }},
    {"a normal", true,
     [](Work& w) {
       const float turned[] = {-1, 2, -3};
       std::memcpy(w.Row(w.Vertex(), kNormal), turned, sizeof(turned));
     }},
    {"a float", true,
     [](Work& w) {
       const float other = 12345;
       std::memcpy(w.Row(w.Vertex(), kQuality), &other, sizeof(other));
     }},
    {"a float's last bit", true, [](Work& w) { *w.Row(w.Vertex(), kQuality) ^= std::byte{1}; }},
    {"a double's last bit", true, [](Work& w) { *w.Row(w.Vertex(), kTime) ^= std::byte{1}; }},
    {"a coordinate", true, [](Work& w) { w.mesh.positions[w.Vertex()][w.random() % 3] *= 0.9375; }},
    {"a coordinate's last bits", true,
     [](Work& w) {
       Vec3d& p = w.mesh.positions[w.Vertex()];
       p.x = std::nextafter(static_cast<float>(p.x), 0.0f);
     }},
    {"all coordinates, by as much", true,
     [](Work& w) {
       for (Vec3d& p : w.mesh.positions) p.y += 8;
     }},
    {"the scale", true,
     [](Work& w) {
       for (Vec3d& p : w.mesh.positions) p = p * 2;
     }},
    {"float32 for double positions", true, [](Work& w) { RoundToFloat32(&w.mesh); }},
    {"two triangles' order", true,
     [](Work& w) { std::swap(w.mesh.triangles[w.Triangle()], w.mesh.triangles[w.Triangle()]); }},
    {"the triangles' order", true,
     [](Work& w) { std::shuffle(w.mesh.triangles.begin(), w.mesh.triangles.end(), w.random); }},
    {"a triangle's first corner", true,
     [](Work& w) {
       TriangleVertices& t = w.mesh.triangles[w.Triangle()];
       t = {t[1], t[2], t[0]};
     }},
    {"a triangle's side", true,
     [](Work& w) {
       TriangleVertices& t = w.mesh.triangles[w.Triangle()];
       std::swap(t[0], t[1]);
     }},
    {"two vertices' order", true,
     [](Work& w) {
       const size_t a = w.Vertex();
       const size_t b = w.Vertex();
       Renumber(w, [=](size_t v) { return v == a ? b : v == b ? a : v; });
     }},
    {"two files' order", true,
     [](Work& w) {
       const size_t count = w.mesh.positions.size();
       const size_t first = 1 + w.random() % (count - 1);
       Renumber(w, [=](size_t v) { return (v + first) % count; });
     }},
    {"a triangle less", true, [](Work& w) { w.mesh.triangles.pop_back(); }},
    {"a triangle twice", true,
     [](Work& w) { w.mesh.triangles.push_back(w.mesh.triangles[w.Triangle()]); }},
    {"a vertex more, of no triangle", true,
     [](Work& w) {
       w.mesh.positions.push_back({1e12, -1e30, 0});
       w.mesh.rows.resize(w.mesh.rows.size() + kRowBytes);
     }},
    {"an attribute's name", true,
     [](Work& w) { w.mesh.header.attributes.attributes[0].name = "number"; }},
    {"an attribute's type", true,
     [](Work& w) { w.mesh.header.attributes.attributes[0].type = ScalarType::kInt32; }},
    {"bits", true, [](Work& w) { w.options.bits = 15; }},
    {"step for bits", true, [](Work& w) { w.options.step = 1e-3; }},
    {"bits for a chosen grid", true, [](Work& w) { w.options.bits = 16; }},
    {"welding", true, [](Work& w) { w.options.weld = w.random() % 2 == 0 ? 0 : 1e-3; }},
    {"tile size", true, [](Work& w) { w.options.tile_triangles = 400; }},
    {"reduction", true, [](Work& w) { w.options.reduction = 3; }},
    {"degree limit", true, [](Work& w) { w.options.degree_limit = 8; }},
    {"normal bits", true,
     [](Work& w) { w.options.normal_bits = w.options.normal_bits.value_or(8) + 1; }},
    {"an attribute's step", true,
     [](Work& w) {
       if (w.options.attribute_steps.empty()) w.options.attribute_steps = {{"quality", 1}};
       w.options.attribute_steps[0].step *= 2;
     }},
};

class Interrupted {
 public:
  explicit Interrupted(Work work) : before_(std::move(work)) {
    before_.options.tmp_directory = folder_.path();
    before_.options.journal_path = journal();
    // Early, in the middle or late in the rounds.
    int left = 2 + static_cast<int>(before_.random() % 4);
    const auto record = Build(before_, false, [&](const BuildProgress& at) {
      if (std::string_view(at.stage) == "read") return Status::Ok();
      return --left == 0 ? Status(StatusCode::kCancelled, "enough") : Status::Ok();
    });
    REQUIRE(record.status().code() == StatusCode::kCancelled);
    REQUIRE(std::filesystem::exists(journal()));
  }
  std::string journal() const { return folder_.path() + "/journal"; }
  const Work& before() const { return before_; }

  Result<ObjectRecord> Build(const Work& work, bool resume, const ProgressCallback& progress = {}) {
    TempStore store;
    BuildOptions options = work.options;
    options.resume = resume;
    return BuildInto(store.database(), "object", work.mesh, options, progress);
  }
  static std::string Fresh(const Work& work) {
    BuildOptions options = work.options;
    options.journal_path.clear();
    TempStore store;
    return BuildInto(store.database(), "object", work.mesh, options).value().digest_hex();
  }

 private:
  TemporaryFolder folder_;
  Work before_;
};

BuildOptions RandomOptions(std::mt19937_64& random) {
  BuildOptions options;
  options.tile_triangles = 512;
  options.threads = 2;
  if (random() % 3 == 0) options.normal_bits = 10;
  if (random() % 3 == 0) options.attribute_steps.push_back({"quality", 0.25});
  if (random() % 3 == 0) options.attribute_steps.push_back({"time", 1e-3});
  return options;
}

}  // namespace

TEST_CASE("Whatever changes before a build goes on, it ends as a fresh one or is refused") {
  const TriangleMesh mesh = MakeMesh();
  uint64_t seed = 0;
  for (const Change& change : kChanges) {
    for (int round = 0; round < 2; ++round) {
      std::mt19937_64 random(++seed);
      INFO("changed: " << change.what << ", seed " << seed);
      Interrupted build({mesh, RandomOptions(random), random});
      Work changed = build.before();
      change.make(changed);
      const auto resumed = build.Build(changed, true);
      INFO(resumed.status().message());
      if (resumed.ok()) {
        REQUIRE(resumed->digest_hex() == Interrupted::Fresh(changed));
        REQUIRE_FALSE(std::filesystem::exists(build.journal()));
        continue;
      }
      REQUIRE(change.matters);
      REQUIRE(resumed.status().code() == StatusCode::kInvalidArgument);
      // The journal still serves whom it is for.
      const auto kept = build.Build(build.before(), true);
      INFO(kept.status().message());
      REQUIRE(kept.ok());
      REQUIRE(kept->digest_hex() == Interrupted::Fresh(build.before()));
    }
  }
}

TEST_CASE("A refused journal says whether the input or the options are others") {
  const TriangleMesh mesh = MakeMesh();
  std::mt19937_64 random(1);
  Interrupted build({mesh, RandomOptions(random), random});
  Work changed = build.before();
  *changed.Row(17, kColour) ^= std::byte{1};
  Status status = build.Build(changed, true).status();
  CHECK(status.message().find("another input") != std::string::npos);
  changed = build.before();
  changed.options.bits = 12;
  status = build.Build(changed, true).status();
  CHECK(status.message().find("other options") != std::string::npos);
  CHECK(status.message().find("--resume") != std::string::npos);
}

}  // namespace mtdb::testing
