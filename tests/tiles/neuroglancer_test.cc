// SPDX-License-Identifier: Apache-2.0
// What `mtdb tile --as neuroglancer` writes, read as neuroglancer does.
#include <cmath>
#include <cstring>
#include <draco/compression/decode.h>
#include <draco/mesh/mesh.h>
#include <limits>
#include <map>
#include <set>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "tests/tools/cli_testing.h"
#include "tools/tiles/neuroglancer/fragment_manifest.h"

namespace mtdb::test {
namespace {

using Cell = std::array<uint32_t, 3>;
using Corner = std::array<int64_t, 3>;  // on the lattice of a level
constexpr int kMost = 65535;
constexpr int kMiddle = 32768;  // where neuroglancer takes a fragment apart

struct Fragment {
  Cell cell{};
  std::string bytes;  // empty: nothing is there
  std::vector<std::array<int32_t, 3>> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
};
struct Segment {
  std::array<float, 3> chunk{}, origin{};
  std::vector<float> scales;
  std::vector<std::vector<Fragment>> levels;  // fine to coarse
  std::string manifest;

  Vec3d PlaceOf(size_t level, const Corner& corner) const {
    Vec3d p;
    for (int i = 0; i < 3; ++i) {
      const auto axis = static_cast<size_t>(i);
      p[i] = origin[axis] + double{chunk[axis]} * std::pow(2.0, level) *
                                (static_cast<double>(corner[axis]) / kMost);
    }
    return p;
  }
};

void Decode(Fragment* fragment) {
  draco::DecoderBuffer buffer;
  buffer.Init(fragment->bytes.data(), fragment->bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  REQUIRE(decoded.ok());
  const auto mesh = std::move(decoded).value();
  const draco::PointAttribute* const at =
      mesh->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  REQUIRE(at != nullptr);
  CHECK(mesh->num_attributes() == 1);
  CHECK(at->data_type() == draco::DT_INT32);
  // What the client's decoder demands.
  CHECK(mesh->GetAttributeElementType(static_cast<int>(at->unique_id())) ==
        draco::MESH_CORNER_ATTRIBUTE);
  CHECK(at->size() == mesh->num_points());
  for (uint32_t v = 0; v < mesh->num_points(); ++v) {
    at->GetMappedValue(draco::PointIndex(v), fragment->positions.emplace_back().data());
  }
  for (uint32_t t = 0; t < mesh->num_faces(); ++t) {
    const auto& face = mesh->face(draco::FaceIndex(t));
    fragment->triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
}

// `fragments`: the file that has them from `begin` on.
Segment ReadSegment(const std::string& manifest, const std::string& fragments, size_t begin) {
  Segment segment;
  segment.manifest = manifest;
  ByteReader in(AsBytes(segment.manifest));
  for (float& v : segment.chunk) v = in.Get<float>();
  for (float& v : segment.origin) v = in.Get<float>();
  segment.levels.resize(in.Get<uint32_t>());
  for (size_t i = 0; i < segment.levels.size(); ++i) segment.scales.push_back(in.Get<float>());
  for (size_t i = 0; i < 3 * segment.levels.size(); ++i) CHECK(in.Get<float>() == 0);
  for (auto& level : segment.levels) level.resize(in.Get<uint32_t>());
  size_t at = begin;
  for (auto& level : segment.levels) {
    for (size_t axis = 0; axis < 3; ++axis) {
      for (Fragment& f : level) f.cell[axis] = in.Get<uint32_t>();
    }
    for (Fragment& f : level) {
      const auto size = in.Get<uint32_t>();
      f.bytes = fragments.substr(at, size);
      REQUIRE(f.bytes.size() == size);
      at += size;
      if (size > 0) Decode(&f);
    }
  }
  CHECK(in.remaining() == 0);
  REQUIRE_FALSE(in.failed());
  return segment;
}

Segment ReadUnsharded(const std::string& folder, const std::string& id) {
  return ReadSegment(ReadText(folder + "/" + id + ".index"), ReadText(folder + "/" + id), 0);
}

uint64_t MortonOf(const Cell& cell) {
  uint64_t code = 0;
  for (uint64_t bit = 0; bit < 20; ++bit) {
    for (size_t axis = 0; axis < 3; ++axis) {
      code |= (uint64_t{cell[axis]} >> bit & 1) << (3 * bit + axis);
    }
  }
  return code;
}

using CornerTriangles = std::vector<std::array<Corner, 3>>;
CornerTriangles TrianglesOf(const std::vector<Fragment>& level) {
  CornerTriangles all;
  for (const Fragment& f : level) {
    for (const auto& t : f.triangles) {
      auto& corners = all.emplace_back();
      for (size_t i = 0; i < 3; ++i) {
        for (size_t axis = 0; axis < 3; ++axis) {
          corners[i][axis] = int64_t{f.cell[axis]} * kMost + f.positions[t[i]][axis];
        }
      }
    }
  }
  return all;
}

// A store of a sculpture with some 30,000 triangles, and its fragments of some 500.
struct Written {
  Example example{30000};
  std::string folder = example.folder.File("ng");
  Json answer = RunJson({"tile", example.store, folder, "--as", "neuroglancer", "--tile-triangles",
                         "500", "--resolution=1000,1000,1000", "--threads", "2"});
  Segment segment = ReadUnsharded(folder, "1");
};
const Written& TheWritten() {
  static const Written kWritten;
  return kWritten;
}
constexpr double kUnit = 1000;  // nanometres

TEST_CASE("info, names and levels are as neuroglancer reads them", "[tile]") {
  const Written& w = TheWritten();
  const Json info = ParseJson(ReadText(w.folder + "/info"));
  CHECK(info.at("@type") == "neuroglancer_multilod_draco");
  CHECK(info.at("vertex_quantization_bits") == 16);
  CHECK(info.at("transform") == Json::array({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}));
  CHECK(info.at("lod_scale_multiplier") == 5);  // ten pixels are two
  CHECK_FALSE(info.contains("sharding"));
  const Json names = ParseJson(ReadText(w.folder + "/segment_properties/info"));
  CHECK(names.at("@type") == "neuroglancer_segment_properties");
  CHECK(names.at("inline").at("ids") == Json::array({"1"}));
  CHECK(names.at("inline").at("properties").at(0).at("values") == Json::array({"sculpture"}));
  REQUIRE(w.segment.levels.size() >= 3);
  const Json& levels = w.answer.at("levels");
  REQUIRE(levels.size() == w.segment.levels.size());
  for (size_t level = 0; level < levels.size(); ++level) {
    const Json& told = levels.at(levels.size() - 1 - level);
    CHECK(w.segment.scales[level] >= told.at("error_bound").get<double>());
    CHECK(w.segment.scales[level] <= told.at("error_bound").get<double>() * (1 + 1e-6));
    if (level > 0) CHECK(w.segment.scales[level] > w.segment.scales[level - 1]);
    size_t some = 0;
    for (const Fragment& f : w.segment.levels[level]) some += f.bytes.empty() ? 0 : 1;
    CHECK(told.at("tiles") == some);
  }
  CHECK_FALSE(Exists(w.folder + "/parts"));
}

std::set<Cell> CellsOf(const Segment& segment, size_t level) {
  std::set<Cell> cells;
  if (level >= segment.levels.size()) return cells;
  for (const Fragment& f : segment.levels[level]) cells.insert(f.cell);
  return cells;
}

// Every fragment lies in one of the next level, and what clients draw apart of it has one there.
void CheckParts(const Fragment& f, const std::set<Cell>& finer) {
  size_t outside = 0, crossing = 0, lost = 0;
  for (const auto& p : f.positions) {
    for (const int32_t q : p) outside += q >= 0 && q <= kMost ? 0 : 1;
  }
  for (const auto& t : f.triangles) {
    Cell part{};
    for (size_t axis = 0; axis < 3; ++axis) {
      const auto [low, high] =
          std::minmax({f.positions[t[0]][axis], f.positions[t[1]][axis], f.positions[t[2]][axis]});
      crossing += !finer.empty() && low < kMiddle && high > kMiddle ? 1 : 0;
      part[axis] = 2 * f.cell[axis] + (high > kMiddle ? 1 : 0);
    }
    lost += finer.empty() || finer.contains(part) ? 0 : 1;
  }
  CHECK(outside == 0);
  CHECK(crossing == 0);
  CHECK(lost == 0);
}

// Returns how many fragments have nothing in them.
size_t CheckFragments(const Segment& segment) {
  size_t empty = 0;
  for (size_t level = 0; level < segment.levels.size(); ++level) {
    INFO("level " << level);
    const auto& fragments = segment.levels[level];
    const std::set<Cell> coarser = CellsOf(segment, level + 1);
    const std::set<Cell> finer = level > 0 ? CellsOf(segment, level - 1) : std::set<Cell>();
    for (size_t i = 0; i < fragments.size(); ++i) {
      const Cell& cell = fragments[i].cell;
      empty += fragments[i].bytes.empty() ? 1 : 0;
      if (i > 0) CHECK(MortonOf(fragments[i - 1].cell) < MortonOf(cell));
      if (!coarser.empty()) CHECK(coarser.contains({cell[0] / 2, cell[1] / 2, cell[2] / 2}));
      CheckParts(fragments[i], finer);
    }
  }
  return empty;
}

TEST_CASE("fragments are on the Z-curve, in parents, and can be taken apart", "[tile]") {
  CHECK(CheckFragments(TheWritten().segment) == 0);
}

TEST_CASE("where a coarse level reaches beyond a finer one, fragments are empty", "[tile]") {
  FragmentManifest manifest;
  manifest.levels.resize(3);
  manifest.levels[0].fragments = {{{4, 0, 0}, 10}, {{1, 0, 0}, 20}};
  manifest.levels[1].fragments = {{{0, 0, 0}, 30}};
  manifest.levels[2].fragments = {{{0, 0, 0}, 40}};
  // What level 1 has in its first cell, and level 2 in two parts of its own.
  CompleteManifest(&manifest, {{{1, 1, 0}, {1, 0, 0}}, {{0, 0, 0}, {1, 1, 1}}, {}});
  const auto text = [&](size_t level) {
    std::string list;
    for (const ManifestFragment& f : manifest.levels[level].fragments) {
      for (const uint32_t v : f.cell) list += std::to_string(v) + " ";
      list += std::to_string(f.bytes) + ", ";
    }
    return list;
  };
  CHECK(text(0) == "1 0 0 20, 1 1 0 0, 4 0 0 10, ");
  CHECK(text(1) == "0 0 0 30, 1 1 1 0, 2 0 0 0, ");
  CHECK(text(2) == "0 0 0 40, 1 0 0 0, ");
  const auto read = DecodeManifest(EncodeManifest(manifest));
  REQUIRE(read.ok());
  CHECK(EncodeManifest(*read) == EncodeManifest(manifest));
  const Bytes bytes = EncodeManifest(manifest);
  for (size_t size = 0; size < bytes.size(); ++size) {
    CHECK_FALSE(DecodeManifest(ByteSpan(bytes).first(size)).ok());
  }
}

// The mesh whose parts a level's fragments are: a cut of as many triangles as the level says.
TriangleMesh MeshOfLevel(const Written& w, size_t level) {
  if (level == 0) return ReadMesh(w.example.full);
  const Folder folder;
  const uint64_t count = w.example.info.at("triangles").get<uint64_t>() >> (2 * level);
  RunOk({"extract", w.example.store, folder.File("cut.ply"), "--triangles", std::to_string(count)});
  return ReadMesh(folder.File("cut.ply"));
}

struct Measures {
  double area = 0, volume = 0;
  void Add(Vec3d a, Vec3d b, Vec3d c) {
    area += Length(Cross(b - a, c - a)) / 2;
    volume += Dot(a, Cross(b, c)) / 6;
  }
};

TEST_CASE("a level's fragments, put together, are the mesh that extract writes", "[tile]") {
  const Written& w = TheWritten();
  for (size_t level = 0; level < w.segment.levels.size(); ++level) {
    INFO("level " << level);
    const CornerTriangles triangles = TrianglesOf(w.segment.levels[level]);
    const TriangleMesh mesh = MeshOfLevel(w, level);
    CHECK(mesh.triangles.size() ==
          w.answer.at("levels").at(w.segment.levels.size() - 1 - level).at("triangles"));
    // No cracks: each edge has two triangles, in opposite directions.
    std::map<std::pair<Corner, Corner>, int> edges;
    std::set<Corner> corners;
    Measures cut, whole;
    for (const auto& t : triangles) {
      for (size_t i = 0; i < 3; ++i) {
        ++edges[{t[i], t[(i + 1) % 3]}];
        --edges[{t[(i + 1) % 3], t[i]}];
        corners.insert(t[i]);
      }
      cut.Add(w.segment.PlaceOf(level, t[0]), w.segment.PlaceOf(level, t[1]),
              w.segment.PlaceOf(level, t[2]));
    }
    size_t open = 0;
    for (const auto& [edge, count] : edges) open += count == 0 ? 0 : 1;
    CHECK(open == 0);
    // Each vertex of the mesh is one of the fragments', rounded to the lattice.
    const double step = w.segment.chunk[0] * std::pow(2.0, level) / kMost;
    size_t missing = 0;
    for (const Vec3d& p : mesh.positions) {
      Corner near{};
      for (int i = 0; i < 3; ++i) {
        const auto axis = static_cast<size_t>(i);
        near[axis] = std::llround((p[i] * kUnit - w.segment.origin[axis]) / step);
      }
      bool found = corners.contains(near);
      for (int i = 0; i < 27 && !found; ++i) {
        found =
            corners.contains({near[0] + i % 3 - 1, near[1] + i / 3 % 3 - 1, near[2] + i / 9 - 1});
      }
      missing += found ? 0 : 1;
    }
    CHECK(missing == 0);
    for (const TriangleVertices& t : mesh.triangles) {
      whole.Add(mesh.positions[t[0]] * kUnit, mesh.positions[t[1]] * kUnit,
                mesh.positions[t[2]] * kUnit);
    }
    CHECK(cut.area == Approx(whole.area).epsilon(1e-4));
    CHECK(cut.volume == Approx(whole.volume).epsilon(1e-4));
  }
}

TEST_CASE("a level's scale is a bound of distances from the full resolution", "[tile]") {
  const Written& w = TheWritten();
  const TriangleMesh full = ReadMesh(w.example.full);
  const size_t level = w.segment.levels.size() - 1;
  std::vector<Triangle3d> all;
  for (const auto& t : TrianglesOf(w.segment.levels[level])) {
    all.push_back({w.segment.PlaceOf(level, t[0]), w.segment.PlaceOf(level, t[1]),
                   w.segment.PlaceOf(level, t[2])});
  }
  double farthest = 0;
  for (size_t v = 0; v < full.positions.size(); v += 7) {
    double nearest = std::numeric_limits<double>::infinity();
    const Vec3d p = full.positions[v] * kUnit;
    for (const Triangle3d& t : all) {
      nearest = std::min(nearest, SquaredDistancePointTriangle(p, t[0], t[1], t[2]));
    }
    farthest = std::max(farthest, nearest);
  }
  CHECK(std::sqrt(farthest) <= w.segment.scales[level]);
  CHECK(std::sqrt(farthest) > 0.3 * w.segment.scales[level]);
}

// Three objects in one store.
struct Several {
  Folder folder;
  std::string store = folder.File("cells.mtdb");
  Several() {
    for (const auto& [name, triangles] : std::vector<std::pair<std::string, std::string>>{
             {"42", "3000"}, {"b", "9000"}, {"a", "600"}}) {
      const std::string mesh = folder.File(name + ".ply");
      RunOk({"generate", "sculpture", mesh, "--triangles", triangles});
      RunOk({"ingest", mesh, store, "--name", name, "--units", "um", "--quiet"});
    }
  }
};
const Several& TheSeveral() {
  static const Several kSeveral;
  return kSeveral;
}

TEST_CASE("objects become segments, in files of their own or in shards with the same bytes",
          "[tile]") {
  const Several& several = TheSeveral();
  const Folder folder;
  const std::string plain = folder.File("plain"), shards = folder.File("shards");
  const Arguments how{"--as", "neuroglancer", "--ids", "all", "--tile-triangles", "300"};
  Arguments to_plain{"tile", several.store, plain},
      to_shards{"tile", several.store, shards, "--sharded"};
  for (Arguments* const arguments : {&to_plain, &to_shards}) {
    arguments->insert(arguments->end(), how.begin(), how.end());
    RunOk(*arguments);
  }
  const Json names = ParseJson(ReadText(plain + "/segment_properties/info")).at("inline");
  CHECK(names.at("ids") == Json::array({"1", "2", "42"}));
  CHECK(names.at("properties").at(0).at("values") == Json::array({"a", "b", "42"}));
  const Json sharding = ParseJson(ReadText(shards + "/info")).at("sharding");
  CHECK(sharding.at("@type") == "neuroglancer_uint64_sharded_v1");
  CHECK(sharding.at("hash") == "identity");
  REQUIRE(sharding.at("minishard_bits") == 0);
  REQUIRE(sharding.at("shard_bits") == 0);
  const std::string shard = ReadText(shards + "/0.shard");
  ByteReader index(AsBytes(shard));
  const auto begin = 16 + index.Get<uint64_t>(), end = 16 + index.Get<uint64_t>();
  CHECK(end == shard.size());
  REQUIRE(end - begin == 3 * 24);
  uint64_t id = 0, at = 16;
  for (size_t i = 0; i < 3; ++i) {
    const auto number = [&](size_t row) {
      uint64_t value = 0;
      std::memcpy(&value, shard.data() + begin + 8 * (3 * row + i), sizeof(value));
      return value;
    };
    id += number(0);
    at += number(1);
    const std::string name = std::to_string(id);
    INFO("segment " << name);
    const std::string manifest = shard.substr(at, number(2));
    CHECK(manifest == ReadText(plain + "/" + name + ".index"));
    const std::string fragments = ReadText(plain + "/" + name);
    REQUIRE(at >= fragments.size());
    CHECK(shard.substr(at - fragments.size(), fragments.size()) == fragments);
    at += number(2);
    const Segment segment = ReadUnsharded(plain, name);
    CHECK(segment.chunk[0] * std::pow(2, segment.levels.size() - 1) > 100);  // micrometres
  }
  for (const std::string& tiles : {plain, shards}) {
    for (const std::string name : {"42", "a", "b"}) {
      const Json report = RunJson({"verify", several.store, "--name", name, "--tiles", tiles});
      INFO(TextOf(report, 1));
      CHECK(report.at("ok") == true);
    }
  }
}

TEST_CASE("ids are taken as they are given, and refused where they are unclear", "[tile]") {
  const Several& several = TheSeveral();
  const Folder folder;
  const auto arguments = [&](const std::string& ids) {
    return Arguments{"tile", several.store, folder.File("t"), "--as", "neuroglancer", "--ids", ids};
  };
  RunOk(arguments("18446744073709551615=b,7=a"));
  CHECK(Exists(folder.File("t/18446744073709551615.index")));
  CHECK(Exists(folder.File("t/7")));
  RunFails(1, arguments("1=a,1=b"), {"two objects have the id 1"});
  RunFails(1, arguments("a"), {"ID=NAME"});
  RunFails(1, arguments("01=a"), {"ID=NAME"});
  RunFails(1, arguments("1=nothing"), {"nothing"});
  RunFails(1, arguments("1=a"), {"--replace"});
  Arguments named = arguments("all");
  named.insert(named.end(), {"--name", "a"});
  RunFails(1, named, {"leave --name out"});
  RunFails(1, {"tile", several.store, folder.File("u"), "--ids", "all"}, {"neuroglancer"});
  RunFails(2,
           {"tile", several.store, folder.File("u"), "--as", "neuroglancer", "--resolution=1,0,1"},
           {"nanometres"});
}

TEST_CASE("a killed run goes on, and a folder that is complete is left", "[tile]") {
  const Written& w = TheWritten();
  const Folder folder;
  const std::string other = folder.File("ng");
  const Arguments arguments{"tile",         w.example.store,
                            other,          "--as",
                            "neuroglancer", "--tile-triangles",
                            "500",          "--resolution=1000,1000,1000",
                            "--threads",    "1"};
  const pid_t child = Start(arguments, folder.File("out"), folder.File("err"));
  while (!Exists(other + "/parts/1/1") && !Exists(other + "/info")) ::usleep(1000);
  ::kill(child, SIGKILL);
  Finish(child);
  RunOk(arguments);
  for (const char* name : {"info", "1", "1.index", "segment_properties/info"}) {
    INFO(name);
    CHECK(ReadText(other + "/" + name) == ReadText(w.folder + "/" + name));
  }
  CHECK_FALSE(Exists(other + "/parts"));
  CHECK(RunJson(arguments).at("levels_found") == w.segment.levels.size());
}

TEST_CASE("verify finds fragments that are not what they say", "[tile]") {
  const Folder folder;
  const Example& example = SmallExample();
  const std::string tiles = folder.File("tiles");
  RunOk({"tile", example.store, tiles, "--as", "neuroglancer", "--tile-triangles", "100"});
  const Segment segment = ReadUnsharded(tiles, "1");
  CHECK(RunJson({"verify", example.store, "--tiles", tiles}).at("ok") == true);
  const std::string copy = folder.File("copy");
  const auto damaged = [&](const std::string& name, const auto& change, const std::string& what) {
    INFO(what);
    std::filesystem::remove_all(copy);
    std::filesystem::copy(tiles, copy, std::filesystem::copy_options::recursive);
    std::string text = ReadText(copy + "/" + name);
    change(&text);
    WriteText(copy + "/" + name, text);
    const Outcome outcome = Run({"verify", example.store, "--tiles", copy});
    CHECK(outcome.exit_code == 1);
    CHECK_THAT(outcome.out, Catch::Contains("FAILED: ") && Catch::Contains(what));
  };
  damaged(
      "1", [](std::string* text) { text->resize(text->size() / 2); }, "shorter");
  damaged(
      "1", [](std::string* text) { (*text)[0] ^= 1; }, "Draco");
  damaged(
      "1.index", [](std::string* text) { text->resize(text->size() - 4); }, "size");
  // The scale of the coarsest level as that of a finer one.
  const size_t levels = segment.levels.size();
  damaged(
      "1.index",
      [&](std::string* text) {
        const float scale = segment.scales[levels - 2];
        std::memcpy(text->data() + 28 + 4 * (levels - 1), &scale, sizeof(scale));
      },
      "the tile states");
  damaged(
      "1.index",
      [&](std::string* text) {
        const float scale = 0;
        std::memcpy(text->data() + 28 + 4 * (levels - 1), &scale, sizeof(scale));
      },
      "do not rise");
}

}  // namespace
}  // namespace mtdb::test
