// SPDX-License-Identifier: Apache-2.0
// The C interface, linked as libmtdb.so: equal to the C++ one, and safe with what callers get
// wrong.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <regex>
#include <set>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "query/probe.h"
#include "tests/builder/fixture.h"
#include "tests/support/temporary_folder.h"
#include "tools/c/mtdb.h"

namespace mtdb::testing {
namespace {

// A store of one object with a numbered vertex attribute, open both ways.
struct Opened {
  BuiltObject built;
  mtdb_database* database = nullptr;
  mtdb_object* object = nullptr;

  Opened()
      : Opened([] {
          TriangleMesh mesh = MakeSculpture(6000);
          NumberVertices(&mesh);
          return Build(mesh);
        }()) {}
  explicit Opened(BuiltObject object_built) : built(std::move(object_built)) {
    mtdb_error error;
    REQUIRE(mtdb_open(built.store->path().c_str(), nullptr, &database, &error) == MTDB_OK);
    REQUIRE(mtdb_open_object(database, nullptr, nullptr, &object, &error) == MTDB_OK);
  }
  ~Opened() {
    mtdb_free_database(database);  // before the object, which goes on
    mtdb_free_object(object);
  }
};

Opened& TheObject() {
  static Opened opened;
  return opened;
}

std::string ReadText(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

struct Arrays {
  std::vector<double> positions;
  std::vector<float> floats;
  std::vector<uint32_t> indices;
  std::vector<unsigned char> rows;
};

Arrays Copy(mtdb_object* object, const mtdb_query* query, mtdb_stats* stats,
            const std::array<double, 3>& origin = {}) {
  mtdb_error error;
  mtdb_cut* cut = nullptr;
  mtdb_info info;
  MTDB_INIT(info);
  REQUIRE(mtdb_get_object_info(object, &info, &error) == MTDB_OK);
  REQUIRE(mtdb_select(object, query, nullptr, &cut, &error) == MTDB_OK);
  REQUIRE(mtdb_get_cut_stats(cut, stats, &error) == MTDB_OK);
  Arrays arrays;
  arrays.positions.resize(stats->vertices * 3);
  arrays.floats.resize(stats->vertices * 3);
  arrays.indices.resize(stats->triangles * 3);
  arrays.rows.resize(stats->vertices * info.row_bytes);
  mtdb_arrays to{sizeof(mtdb_arrays),     stats->vertices,      stats->triangles,
                 arrays.positions.data(), arrays.floats.data(), {origin[0], origin[1], origin[2]},
                 arrays.indices.data(),   arrays.rows.data()};
  REQUIRE(mtdb_copy_cut(cut, &to, &error) == MTDB_OK);
  to.triangle_capacity -= 1;
  REQUIRE(mtdb_copy_cut(cut, &to, &error) == MTDB_BUDGET_EXCEEDED);
  REQUIRE(std::string(error.message).find("have room for") != std::string::npos);
  mtdb_free_cut(cut);
  return arrays;
}

// With all its digits.
std::string Number(double value) {
  char text[40];
  std::snprintf(text, sizeof(text), "%.17g", value);
  return text;
}

void CheckSame(const Arrays& arrays, const TriangleMesh& mesh) {
  REQUIRE(arrays.positions.size() == mesh.positions.size() * 3);
  REQUIRE(arrays.indices.size() == mesh.triangles.size() * 3);
  for (size_t i = 0; i < arrays.positions.size(); ++i) {
    REQUIRE(arrays.positions[i] == mesh.positions[i / 3][static_cast<int>(i % 3)]);
  }
  for (size_t i = 0; i < arrays.indices.size(); ++i) {
    REQUIRE(arrays.indices[i] == mesh.triangles[i / 3][i % 3]);
  }
  REQUIRE(arrays.rows.size() == mesh.rows.size());
  REQUIRE(std::ranges::equal(std::as_bytes(std::span(arrays.rows)), std::span(mesh.rows)));
}

}  // namespace

// "kNotYet = 303" and "MTDB_NOT_YET = 303" as "NOT_YET 303".
std::set<std::string> CodesIn(const std::string& file, const std::regex& code) {
  std::ifstream in(std::string(MTDB_SOURCE_DIR) + "/" + file);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  std::set<std::string> codes;
  for (std::sregex_iterator at(text.begin(), text.end(), code), end; at != end; ++at) {
    std::string name;
    for (const char c : (*at)[1].str()) {
      const bool starts_word = c >= 'A' && c <= 'Z' && !name.empty() && file != "tools/c/mtdb.h";
      if (starts_word) name += '_';
      name += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    }
    codes.insert(name + " " + (*at)[2].str());
  }
  return codes;
}

TEST_CASE("C has the codes of C++, by the same names") {
  const auto in_c = CodesIn("tools/c/mtdb.h", std::regex("MTDB_([A-Z_]+) = (0|[1-9][0-9]{2})\\b"));
  const auto in_cc = CodesIn("store/base/status.h", std::regex("\\bk([A-Za-z]+) = ([0-9]+)"));
  REQUIRE(in_cc.contains("NOT_YET 303"));
  for (const std::string& code : in_cc) {
    INFO(code);
    CHECK(in_c.contains(code));
  }
}

TEST_CASE("C sees the objects of a store and what they are") {
  Opened& o = TheObject();
  REQUIRE(mtdb_get_abi_version() == MTDB_ABI_VERSION);
  REQUIRE(std::string(mtdb_get_version()).starts_with("0."));
  mtdb_error error;
  mtdb_texts* names = nullptr;
  REQUIRE(mtdb_list_objects(o.database, &names, &error) == MTDB_OK);
  REQUIRE(mtdb_count_texts(names) == 1);
  REQUIRE(mtdb_get_text(names, 0) == o.built.record.name);
  REQUIRE(mtdb_get_text(names, 1) == nullptr);
  mtdb_free_texts(names);
  REQUIRE(mtdb_get_object_name(o.object) == o.built.record.name);
  mtdb_info info;
  MTDB_INIT(info);
  REQUIRE(mtdb_get_object_info(o.object, &info, &error) == MTDB_OK);
  REQUIRE(info.triangles == o.built.record.triangles);
  REQUIRE(info.vertices == o.built.record.vertices);
  REQUIRE(info.bounds_min[1] == o.built.record.bounds.min.y);
  REQUIRE(info.bounds_max[2] == o.built.record.bounds.max.z);
  REQUIRE(info.row_bytes == o.built.record.attributes.row_bytes());
  mtdb_attribute attribute;
  MTDB_INIT(attribute);
  uint32_t bytes = 0;
  for (uint32_t i = 0; i < info.attributes; ++i) {
    REQUIRE(mtdb_get_object_attribute(o.object, i, &attribute, &error) == MTDB_OK);
    REQUIRE(attribute.name == o.built.record.attributes.attributes[i].name);
    REQUIRE(attribute.offset == bytes);
    bytes += static_cast<uint32_t>(ScalarSize(static_cast<ScalarType>(attribute.type)));
  }
  REQUIRE(bytes == info.row_bytes);
  REQUIRE(mtdb_get_object_attribute(o.object, info.attributes, &attribute, &error) ==
          MTDB_NOT_FOUND);
}

TEST_CASE("Rows of every kind of attribute are the same in C and C++") {
  for (const AttributeKind& kind : AttributeKinds(MakeSculpture(2000))) {
    INFO(kind.name);
    const Opened o(Build(kind));
    mtdb_stats stats;
    MTDB_INIT(stats);
    CheckSame(Copy(o.object, nullptr, &stats), Extract(*o.built.surface, Query{}));
  }
}

TEST_CASE("Queries through C give the mesh that C++ gives") {
  Opened& o = TheObject();
  const ObjectRecord& record = o.built.record;
  const double size = record.diagonal();
  const Vec3d low = record.bounds.min;
  const Vec3d high = record.bounds.max;
  const Vec3d middle = (low + high) * 0.5;
  struct Case {
    std::string json;
    std::function<void(Query*)> fill;
  };
  const auto point = [](Vec3d p) {
    return "[" + Number(p.x) + ", " + Number(p.y) + ", " + Number(p.z) + "]";
  };
  const std::string box =
      R"({"box": {"min": )" + point(low) + R"(, "max": )" + point(middle) + "}}";
  const std::string ball =
      R"({"sphere": {"centre": )" + point(high) + R"(, "radius": )" + Number(size / 3) + "}}";
  const std::vector<Case> cases{
      {"{}", [](Query*) {}},
      {R"({"region": )" + box + "}",
       [&](Query* q) {
         q->region = BoxRegion({low, middle});
       }},
      {R"({"region": {"union": [)" + box + ", " + ball + R"(]}, "clip": true, "threshold": )" +
           Number(size * 1e-3) + "}",
       [&](Query* q) {
         q->region = UnionRegion({BoxRegion({low, middle}), SphereRegion(high, size / 3)});
         q->threshold = ConstantThreshold(size * 1e-3);
         q->clip = true;
       }},
      {R"({"threshold": {"smallest": [{"linear": {"point": )" + point(low) +
           R"(, "base": 0, "slope": 0.01}}, )" + Number(size * 2e-3) + "]}}",
       [&](Query* q) {
         q->threshold =
             MinThreshold({LinearThreshold(low, 0, 0.01), ConstantThreshold(size * 2e-3)});
       }},
      {R"({"threshold": "coarsest"})", [&](Query* q) { q->threshold = CoarsestThreshold(); }},
      {R"({"threshold": "full", "max_triangles": 1000})", [&](Query* q) {
         q->threshold = FullResolution();
         q->max_triangles = 1000;
       }}};
  for (const Case& c : cases) {
    mtdb_query* query = nullptr;
    REQUIRE(mtdb_create_query(o.object, c.json.c_str(), &query, nullptr) == MTDB_OK);
    Query expected;
    c.fill(&expected);
    mtdb_stats stats;
    MTDB_INIT(stats);
    const Arrays arrays = Copy(o.object, query, &stats, {low.x, low.y, low.z});
    mtdb_free_query(query);
    ExtractStats wanted;
    const TriangleMesh mesh = Extract(*o.built.surface, expected, &wanted);
    CheckSame(arrays, mesh);
    REQUIRE(stats.error_bound == wanted.error_bound);
    REQUIRE(stats.nodes_applied == wanted.nodes_applied);
    for (size_t i = 0; i < arrays.floats.size(); ++i) {
      const int k = static_cast<int>(i % 3);
      REQUIRE(arrays.floats[i] == static_cast<float>(mesh.positions[i / 3][k] - low[k]));
    }
  }
}

TEST_CASE("Blocks come through callbacks, and a callback can stop them") {
  Opened& o = TheObject();
  struct Seen {
    uint64_t announced = 0;
    Arrays arrays;
    size_t row_bytes = 0;
    int stop_after = -1;  // blocks
  } seen;
  seen.row_bytes = o.built.record.attributes.row_bytes();
  mtdb_sink sink;
  MTDB_INIT(sink);
  sink.user = &seen;
  sink.begin = [](void* user, uint64_t vertices, uint64_t triangles) {
    static_cast<Seen*>(user)->announced = vertices + triangles;
    return 0;
  };
  sink.vertices = [](void* user, const double* p, const unsigned char* rows, size_t count) {
    auto& s = *static_cast<Seen*>(user);
    s.arrays.positions.insert(s.arrays.positions.end(), p, p + 3 * count);
    s.arrays.rows.insert(s.arrays.rows.end(), rows, rows + s.row_bytes * count);
    return s.stop_after-- == 0 ? 1 : 0;
  };
  sink.triangles = [](void* user, const uint64_t* indices, size_t count) {
    auto& s = *static_cast<Seen*>(user);
    for (size_t i = 0; i < 3 * count; ++i) {
      s.arrays.indices.push_back(static_cast<uint32_t>(indices[i]));
    }
    return 0;
  };
  mtdb_error error;
  mtdb_cut* cut = nullptr;
  REQUIRE(mtdb_select(o.object, nullptr, nullptr, &cut, &error) == MTDB_OK);
  REQUIRE(mtdb_emit_cut(cut, &sink, &error) == MTDB_OK);
  CheckSame(seen.arrays, Extract(*o.built.surface, {}));
  REQUIRE(seen.announced == o.built.record.vertices + o.built.record.triangles);
  seen.stop_after = 0;
  REQUIRE(mtdb_emit_cut(cut, &sink, &error) == MTDB_CANCELLED);
  REQUIRE(std::string(error.message).find("callback") != std::string::npos);
  MTDB_INIT(sink);
  REQUIRE(mtdb_emit_cut(cut, &sink, &error) == MTDB_OK);
  mtdb_free_cut(cut);
}

TEST_CASE("Probes through C are those of C++") {
  Opened& o = TheObject();
  const Vec3d high = o.built.record.bounds.max;
  const Vec3d low = o.built.record.bounds.min;
  const double infinity = std::numeric_limits<double>::infinity();
  mtdb_error error;
  mtdb_hit hit;
  MTDB_INIT(hit);
  REQUIRE(mtdb_find_closest_point(o.object, &high.x, infinity, nullptr, &hit, &error) == MTDB_OK);
  const ProbeAnswer closest = FindClosestPoint(*o.built.surface, high).value();
  REQUIRE(hit.found == 1);
  REQUIRE(hit.distance == closest.hit->distance);
  REQUIRE(hit.parameter == 0);
  REQUIRE(hit.point[1] == closest.hit->point.y);
  REQUIRE(hit.triangle[5] == closest.hit->triangle[1].z);
  REQUIRE(hit.front == 1);
  mtdb_probe_options coarse;
  MTDB_INIT(coarse);
  coarse.error = 0.1;
  REQUIRE(mtdb_find_closest_point(o.object, &high.x, hit.distance / 3, &coarse, &hit, &error) ==
          MTDB_OK);
  REQUIRE(hit.found == 0);
  const Vec3d direction = high - low;
  REQUIRE(mtdb_cast_ray(o.object, &low.x, &direction.x, infinity, nullptr, &hit, &error) ==
          MTDB_OK);
  const ProbeAnswer first = CastRay(*o.built.surface, low, direction).value();
  REQUIRE(hit.found == 1);
  REQUIRE(hit.parameter == first.hit->parameter);
  const Vec3d met{hit.point[0], hit.point[1], hit.point[2]};
  REQUIRE(hit.distance == Approx(Length(met - low)));
  const double zero[3] = {0, 0, 0};
  REQUIRE(mtdb_cast_ray(o.object, &low.x, zero, infinity, nullptr, &hit, &error) ==
          MTDB_INVALID_ARGUMENT);
}

TEST_CASE("What a C caller gets wrong is an error code with a text") {
  Opened& o = TheObject();
  mtdb_error error;
  const auto refused = [&](mtdb_code code, const char* part) {
    INFO(error.message);
    REQUIRE(code == MTDB_INVALID_ARGUMENT);
    REQUIRE(std::string(error.message).find(part) != std::string::npos);
  };
  mtdb_database* database = nullptr;
  mtdb_object* object = nullptr;
  mtdb_query* query = nullptr;
  mtdb_cut* cut = nullptr;
  REQUIRE(mtdb_open_abi(MTDB_ABI_VERSION + 1, "x", nullptr, &database, &error) == MTDB_UNSUPPORTED);
  REQUIRE(std::string(error.message).find("ABI version") != std::string::npos);
  REQUIRE(mtdb_open("/no/such/store", nullptr, &database, &error) == MTDB_NOT_FOUND);
  REQUIRE(std::string(error.message).find("/no/such/store") != std::string::npos);
  REQUIRE(mtdb_open("/no/such/store", nullptr, &database, nullptr) == MTDB_NOT_FOUND);
  const std::string longest(5000, 'x');
  REQUIRE(mtdb_open(longest.c_str(), nullptr, &database, &error) != MTDB_OK);
  REQUIRE(std::strlen(error.message) == sizeof(error.message) - 1);
  std::string umlauts = "/";
  for (int i = 0; i < 600; ++i) umlauts += "\xc3\xa4";  // two bytes each: none is cut in half
  REQUIRE(mtdb_open(umlauts.c_str(), nullptr, &database, &error) != MTDB_OK);
  REQUIRE(std::string(error.message).ends_with("\xc3\xa4"));
  REQUIRE(database == nullptr);
  refused(mtdb_open(nullptr, nullptr, &database, &error), "path");
  refused(mtdb_open("x", nullptr, nullptr, &error), "database");
  refused(mtdb_open_object(nullptr, nullptr, nullptr, &object, &error), "database");
  REQUIRE(mtdb_open_object(o.database, "other", nullptr, &object, &error) == MTDB_NOT_FOUND);
  refused(mtdb_list_objects(o.database, nullptr, &error), "names");
  refused(mtdb_get_object_info(nullptr, nullptr, &error), "object");
  refused(mtdb_get_object_attribute(o.object, 0, nullptr, &error), "attribute");
  refused(mtdb_create_query(o.object, "{}", nullptr, &error), "query");
  refused(mtdb_select(nullptr, nullptr, nullptr, &cut, &error), "object");
  refused(mtdb_select(o.object, nullptr, nullptr, nullptr, &error), "cut");
  refused(mtdb_get_cut_stats(nullptr, nullptr, &error), "cut");
  refused(mtdb_copy_cut(nullptr, nullptr, &error), "cut");
  refused(mtdb_emit_cut(nullptr, nullptr, &error), "cut");
  refused(mtdb_create_query(nullptr, "{}", &query, &error), "object");
  refused(mtdb_find_closest_point(o.object, nullptr, 1, nullptr, nullptr, &error), "point");
  refused(mtdb_create_query(o.object, R"({"threshold": -1})", &query, &error), "threshold");
  REQUIRE(query == nullptr);
  mtdb_probe_options probing;
  MTDB_INIT(probing);
  mtdb_hit hit{};  // without its size
  const double zero[3] = {0, 0, 0};
  refused(mtdb_find_closest_point(o.object, zero, 1, &probing, &hit, &error), "hit.struct_bytes");

  REQUIRE(mtdb_get_object_name(nullptr) == nullptr);
  REQUIRE(mtdb_count_texts(nullptr) == 0);
  REQUIRE(mtdb_get_text(nullptr, 0) == nullptr);
  mtdb_free_database(nullptr);
  mtdb_free_texts(nullptr);
  mtdb_free_object(nullptr);
  mtdb_free_query(nullptr);
  mtdb_free_cut(nullptr);
}

TEST_CASE("A program in C calls every function there is, and each does what it should") {
  const TemporaryFolder folder;
  const std::string output = folder.path() + "/out";
  const std::string command = std::string("'") + MTDB_C_API_CALLS + "' '" +
                              TheObject().built.store->path() + "' > '" + output + "' 2>&1";
  const int status = std::system(command.c_str());
  const std::string printed = ReadText(output);
  INFO(printed);
  REQUIRE(status == 0);
  REQUIRE(printed == "all is well\n");
  // The headers have no other functions than those, and those of c_api_more_calls.c.
  const std::string root = MTDB_SOURCE_DIR;
  std::string header;
  for (const char* name :
       {"mtdb.h", "mtdb_write.h", "mtdb_follow.h", "mtdb_show.h", "mtdb_terrain.h"}) {
    header += ReadText(root + "/tools/c/" + name);
  }
  const std::string program = ReadText(root + "/tests/query/c_api_calls.c") +
                              ReadText(root + "/tests/query/c_api_more_calls.c");
  int functions = 0;
  for (size_t at = 0; (at = header.find("MTDB_API ", at)) != std::string::npos; ++at) {
    const size_t end = header.find('(', at);
    const size_t begin = header.find_last_of(" *", end) + 1;
    const std::string name = header.substr(begin, end - begin);
    if (!name.starts_with("mtdb_")) continue;
    INFO(name);
    // mtdb_open is a macro of mtdb_open_abi, and so on.
    const std::string macro = name.ends_with("_abi") ? name.substr(0, name.size() - 4) : name;
    REQUIRE(program.find(macro + "(") != std::string::npos);
    ++functions;
  }
  REQUIRE(functions > 60);
}

TEST_CASE("A C object serves several threads") {
  Opened& o = TheObject();
  std::vector<std::thread> threads;
  std::vector<uint64_t> triangles(4, 0);
  for (size_t i = 0; i < triangles.size(); ++i) {
    threads.emplace_back([&, i] {
      mtdb_query* query = nullptr;
      mtdb_cut* cut = nullptr;
      mtdb_stats stats;
      MTDB_INIT(stats);
      if (mtdb_create_query(o.object, R"({"threshold": 0.01})", &query, nullptr) == MTDB_OK &&
          mtdb_select(o.object, query, nullptr, &cut, nullptr) == MTDB_OK &&
          mtdb_get_cut_stats(cut, &stats, nullptr) == MTDB_OK) {
        triangles[i] = stats.triangles;
      }
      mtdb_free_cut(cut);
      mtdb_free_query(query);
    });
  }
  for (std::thread& t : threads) t.join();
  for (const uint64_t n : triangles) {
    REQUIRE(n > 0);
    REQUIRE(n == triangles[0]);
  }
}

}  // namespace mtdb::testing
