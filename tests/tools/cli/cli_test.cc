// SPDX-License-Identifier: Apache-2.0
// What the verbs of mtdb do and print, on files as a user has them.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>
#include <pty.h>
#include <set>

#include "query/region.h"
#include "tests/support/mesh_check.h"
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// Half the diagonal of a grid cell: what rounding adds to an error.
double CellError(const Example& example) { return example.step() * std::numbers::sqrt3 / 2; }

void CheckStats(const Json& json, const std::string& output) {
  CHECK(json.at("object") == "sculpture");
  CHECK(json.at("output") == output);
  for (const char* key :
       {"triangles", "vertices", "active_triangles", "nodes_applied", "nodes_forced",
        "nodes_visited", "clusters_read", "clusters_cached", "clusters_total", "bytes_read"}) {
    INFO(key);
    CHECK(json.at(key).is_number_unsigned());
  }
  CHECK(json.at("error_bound").is_number());
  CHECK(json.at("error_bound") >= 0.0);
  CHECK(json.at("clusters_read") <= json.at("clusters_total"));
  CHECK(json.at("nodes_forced") <= json.at("nodes_applied"));
  CHECK(json.at("bytes_read") > 0);
  double sum = 0;
  for (const char* key : {"open", "select", "load", "emit", "write"}) {
    INFO(key);
    const double seconds = json.at("seconds").at(key);
    CHECK(seconds >= 0);
    sum += seconds;
  }
  CHECK(sum <= json.at("seconds").at("total").get<double>() * 1.01 + 1e-3);
}

TriangleMesh Extract(const Example& example, Arguments options, Json* json,
                     const std::string& extension = ".ply") {
  const Folder folder;
  const std::string output = folder.File("cut" + extension);
  Arguments arguments{"extract", example.store, output};
  arguments.insert(arguments.end(), options.begin(), options.end());
  *json = RunJson(arguments);
  CheckStats(*json, output);
  if (extension == ".drc") {
    CHECK(ReadText(output).starts_with("DRACO"));
    return {};
  }
  TriangleMesh mesh = ReadMesh(output);
  CHECK(mesh.triangles.size() == json->at("triangles"));
  CHECK(mesh.positions.size() == json->at("vertices"));
  return mesh;
}

Triangle3d Corners(const TriangleMesh& mesh, const TriangleVertices& t) {
  return {mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
}

std::string Numbers(const std::vector<double>& numbers) {
  std::string text;
  for (const double n : numbers) text += (text.empty() ? "" : ",") + std::to_string(n);
  return text;
}

// A square of two triangles at height `z`.
std::string Square(double z, bool colours) {
  std::string text = "ply\nformat ascii 1.0\nelement vertex 4\n";
  for (const char* axis : {"x", "y", "z"}) text += std::string("property float ") + axis + "\n";
  if (colours) {
    for (const char* c : {"red", "green", "blue"})
      text += std::string("property uchar ") + c + "\n";
  }
  text += "property float quality\nelement face 2\nproperty list uchar int vertex_indices\n";
  text += "end_header\n";
  for (const char* corner : {"0 0 ", "1 0 ", "1 1 ", "0 1 "}) {
    text += corner + std::to_string(z) + (colours ? " 10 20 30" : "") + " 0.5\n";
  }
  return text + "3 0 1 2\n3 0 2 3\n";
}

TEST_CASE("ingest and info tell what is in the store", "[cli]") {
  const Example& example = TheExample();
  const TriangleMesh mesh = ReadMesh(example.mesh);
  const Json& info = example.info;
  CHECK(info.at("object") == "sculpture");
  CHECK(info.at("triangles") == mesh.triangles.size());
  CHECK(info.at("vertices") == mesh.positions.size());
  CHECK(info.at("components") == 1);
  CHECK(info.at("boundary_edges") == 0);
  CHECK(info.at("attributes").is_array());
  CHECK(info.at("digest").get<std::string>().size() == 32);
  CHECK(info.at("bits") == 16);
  CHECK(info.at("rounds").is_array());
  CHECK(info.at("rounds").size() >= 2);
  CHECK(info.at("rounds").at(0).at("triangles_in") == mesh.triangles.size());
  CHECK(info.at("clusters") >= 2);
  CHECK(info.at("nodes") > mesh.positions.size() / 2);
  CHECK(info.at("nodes") < mesh.positions.size());
  CHECK(info.at("root_triangles") < mesh.triangles.size() / 10);
  CHECK(info.at("depth") > 5);
  CHECK(info.at("max_degree") >= 6);
  CHECK(info.at("max_degree") <= 16);
  CHECK(info.at("file_bytes") == std::filesystem::file_size(example.store));
  CHECK(info.at("payload_bytes") > 10000);
  CHECK(info.at("payload_bytes") < info.at("file_bytes"));
  CHECK(info.at("bits_per_vertex") > 10.0);
  CHECK(info.at("bits_per_vertex") < 400.0);
  const double diagonal = info.at("diagonal");
  CHECK(info.at("error_max") > 0.0);
  CHECK(info.at("error_max") < diagonal);
  Box3d bounds;
  for (const Vec3d p : mesh.positions) bounds.Add(p);
  double longest = 0;
  for (int i = 0; i < 3; ++i) {
    const size_t axis = static_cast<size_t>(i);
    CHECK(info.at("bounds").at("min").at(axis).get<double>() ==
          Approx(bounds.min[i]).margin(example.step()));
    CHECK(info.at("bounds").at("max").at(axis).get<double>() ==
          Approx(bounds.max[i]).margin(example.step()));
    longest = std::max(longest, bounds.max[i] - bounds.min[i]);
  }
  CHECK(diagonal == Approx(Diagonal(bounds)).epsilon(1e-3));
  CHECK(example.step() == Approx(longest / 65535));

  const std::string text = RunOk({"info", example.store});
  CHECK_THAT(text, Catch::Contains(info.at("digest").get<std::string>()));
  CHECK_THAT(text, Catch::Contains("store: "));
  CHECK(RunJson({"info", example.store, "--name", "sculpture"}).at("objects").at(0) == info);
}

TEST_CASE("every output format holds the same surface", "[cli]") {
  const Example& example = TheExample();
  for (const std::string extension : {".ply", ".obj", ".stl", ".off", ".drc"}) {
    INFO(extension);
    Json json;
    const TriangleMesh mesh = Extract(example, {"--full"}, &json, extension);
    CHECK(json.at("triangles") == example.info.at("triangles"));
    CHECK(json.at("vertices") == example.info.at("vertices"));
    // STL and Draco round again.
    const double again = extension == ".drc" ? 1.2 : 1.01;
    CHECK(json.at("error_bound").get<double>() <= CellError(example) * again);
    if (extension == ".drc") continue;
    const auto check = testing::CheckMesh(mesh);
    CHECK(check.ok());
    CHECK(check.boundary_edges == 0);
    CHECK(check.euler_characteristic == example.info.at("euler_characteristic"));
  }
}

TEST_CASE("extract --full gives back the input", "[cli]") {
  const Example& example = TheExample();
  const auto canonical = [&](const TriangleMesh& mesh) {
    const Vec3d origin{example.info.at("bounds").at("min").at(0),
                       example.info.at("bounds").at("min").at(1),
                       example.info.at("bounds").at("min").at(2)};
    std::vector<std::array<std::array<int64_t, 3>, 3>> triangles;
    for (const TriangleVertices& t : mesh.triangles) {
      auto& corners = triangles.emplace_back();
      for (size_t c = 0; c < 3; ++c) {
        for (int i = 0; i < 3; ++i) {
          corners[c][static_cast<size_t>(i)] =
              std::llround((mesh.positions[t[c]][i] - origin[i]) / example.step());
        }
      }
      std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    }
    std::sort(triangles.begin(), triangles.end());
    return triangles;
  };
  CHECK(canonical(ReadMesh(example.full)) == canonical(ReadMesh(example.mesh)));
}

TEST_CASE("extract --implicit writes the same mesh", "[cli]") {
  const Example& example = TheExample();
  Json json;
  const TriangleMesh mesh = Extract(example, {"--error", "0.2%"}, &json);
  const TriangleMesh again = Extract(example, {"--error", "0.2%", "--implicit"}, &json);
  CHECK(again.positions == mesh.positions);
  CHECK(again.triangles == mesh.triangles);
}

TEST_CASE("info --streams tells what the streams take", "[cli]") {
  const Example& example = TheExample();
  const Json info = RunJson({"info", example.store, "--streams"}).at("objects").at(0);
  double sum = 0;
  for (const auto& [name, bits] : info.at("stream_bits_per_vertex").items()) {
    sum += bits.get<double>();
  }
  const double vertices = info.at("vertices");
  CHECK(sum == Approx(8 * info.at("payload_bytes").get<double>() / vertices));
  CHECK(!example.info.contains("stream_bits_per_vertex"));
  CHECK_THAT(RunOk({"info", example.store, "--streams"}), Catch::Contains("topology"));
}

TEST_CASE("extract --error keeps its promise, in units and in percent of the diagonal", "[cli]") {
  const Example& example = TheExample();
  const double diagonal = example.info.at("diagonal");
  uint64_t last = example.info.at("triangles").get<uint64_t>() + 1;
  for (const double relative : {1e-4, 1e-3, 1e-2}) {
    INFO(relative);
    Json json;
    const TriangleMesh mesh =
        Extract(example, {"--error", std::to_string(100 * relative) + "%"}, &json);
    CHECK(json.at("error_bound").get<double>() <= relative * diagonal + CellError(example));
    CHECK(json.at("triangles") < last);
    last = json.at("triangles");
    CHECK(testing::CheckMesh(mesh).ok());
    Json same;
    Extract(example, {"--error", std::to_string(relative * diagonal)}, &same);
    CHECK(same.at("error_bound").get<double>() <= relative * diagonal * 1.001 + CellError(example));
  }
  Json zero;
  Extract(example, {"--error", "0"}, &zero);
  CHECK(zero.at("error_bound").get<double>() <= CellError(example) * 1.001);
}

TEST_CASE("extract --triangles keeps to the budget and uses it", "[cli]") {
  const Example& example = TheExample();
  double last = example.info.at("diagonal");
  for (const uint64_t budget : {1000, 5000, 15000}) {
    Json json;
    const TriangleMesh mesh = Extract(example, {"--triangles", std::to_string(budget)}, &json);
    CHECK(json.at("triangles") <= budget);
    CHECK(json.at("triangles") > budget * 9 / 10);
    CHECK(json.at("error_bound") < last);
    last = json.at("error_bound");
    CHECK(testing::CheckMesh(mesh).ok());
  }
  Json few;
  Extract(example, {"--max-bytes", "20000"}, &few);
  CHECK(few.at("bytes_read") <= 20000);
  CHECK(few.at("limit") == "bytes");
  Extract(example, {"--max-milliseconds", "0"}, &few);
  CHECK(few.at("nodes_applied") == 0);
  Json coarse;
  Extract(example, {"--triangles", "15000", "--error", "1%"}, &coarse);
  CHECK(coarse.at("triangles") < 5000);
}

TEST_CASE("a region is accurate, the rest coarse, and --clip drops the rest", "[cli]") {
  const Example& example = TheExample();
  std::vector<double> lower, upper, ball;
  Box3d box;
  for (int i = 0; i < 3; ++i) {
    const size_t axis = static_cast<size_t>(i);
    const double min = example.info.at("bounds").at("min").at(axis);
    const double max = example.info.at("bounds").at("max").at(axis);
    lower.push_back(min - 1);  // negative: must not be taken for an option
    upper.push_back(i == 0 ? min + 0.3 * (max - min) : max);
    ball.push_back(min);
  }
  std::string corners = Numbers(lower) + "," + Numbers(upper);
  // What the text says, after rounding to six decimals.
  for (int i = 0; i < 3; ++i) {
    const size_t axis = static_cast<size_t>(i);
    box.min[i] = std::stod(std::to_string(lower[axis]));
    box.max[i] = std::stod(std::to_string(upper[axis]));
  }
  REQUIRE(corners[0] == '-');
  Json whole, clipped;
  const TriangleMesh with_rest = Extract(example, {"--box", corners}, &whole);
  const TriangleMesh inside = Extract(example, {"--box", corners, "--clip"}, &clipped);
  CHECK(testing::CheckMesh(with_rest).ok());
  CHECK(whole.at("triangles") < example.info.at("triangles"));
  CHECK(clipped.at("triangles") < whole.at("triangles"));
  CHECK(whole.at("error_bound").get<double>() <= CellError(example) * 1.001);
  const RegionPtr region = BoxRegion(box);
  const double rounding = 1e-6;  // of positions to float32 in the file
  for (const TriangleVertices& t : inside.triangles) {
    REQUIRE(region->Within(Corners(inside, t), rounding));
  }
  const auto near =
      std::count_if(with_rest.triangles.begin(), with_rest.triangles.end(),
                    [&](const auto& t) { return region->Within(Corners(with_rest, t), rounding); });
  const Box3d shrunk{box.min, {box.max.x - rounding, box.max.y, box.max.z}};
  const auto surely_near = std::count_if(
      with_rest.triangles.begin(), with_rest.triangles.end(),
      [&](const auto& t) { return BoxRegion(shrunk)->Within(Corners(with_rest, t), 0); });
  CHECK(clipped.at("triangles") <= near);
  CHECK(clipped.at("triangles") >= surely_near);

  // All of the region at full resolution: the input has as many triangles there.
  const TriangleMesh full = ReadMesh(example.full);
  const auto of_full =
      std::count_if(full.triangles.begin(), full.triangles.end(),
                    [&](const auto& t) { return region->Within(Corners(full, t), rounding); });
  CHECK(of_full >= clipped.at("triangles").get<int64_t>());
  CHECK(of_full - clipped.at("triangles").get<int64_t>() <= near - surely_near);

  ball.push_back(example.info.at("diagonal").get<double>() / 3);
  Json sphere, both;
  Extract(example, {"--sphere=" + Numbers(ball), "--clip", "--error", "0.1%"}, &sphere);
  CHECK(sphere.at("triangles") > 0);
  CHECK(sphere.at("triangles") < example.info.at("triangles"));
  Extract(example, {"--sphere", Numbers(ball), "--box", corners, "--clip"}, &both);
  CHECK(both.at("triangles") >= clipped.at("triangles"));

  // Nothing there: an empty mesh, not an error.
  for (const std::string extension : {".ply", ".obj", ".stl", ".off"}) {
    const Folder folder;
    const std::string output = folder.File("nothing" + extension);
    const Json nothing =
        RunJson({"extract", example.store, output, "--sphere", "1000,0,0,1", "--clip"});
    CHECK(nothing.at("triangles") == 0);
    CHECK(nothing.at("vertices") == 0);
    CHECK(Exists(output));
  }
}

TEST_CASE("verify passes every level on a good store", "[cli]") {
  const Example& example = TheExample();
  size_t last = 0;
  for (const std::string level : {"fast", "full", "global"}) {
    const Json json = RunJson({"verify", example.store, "--level", level});
    CHECK(json.at("ok") == true);
    CHECK(json.at("failures").empty());
    CHECK(json.at("checks").size() >= last);
    last = json.at("checks").size();
    CHECK(json.at("checks").at(0).is_string());
    CHECK_THAT(RunOk({"verify", example.store, "--level", level, "--name", "sculpture"}),
               Catch::Contains(example.store + ": ok\n"));
  }
  CHECK(last > 4);
}

TEST_CASE("render makes a picture of the size that was asked for", "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string picture = folder.File("picture.png");
  const Json json = RunJson(
      {"render", example.store, picture, "--error", "0.5%", "--size", "123x45", "--wireframe"});
  CheckStats(json, picture);
  const std::string bytes = ReadText(picture);
  REQUIRE(bytes.size() > 100);
  CHECK(bytes.substr(0, 4) == "\x89PNG");
  CHECK(bytes.substr(16, 8) == std::string("\0\0\0\x7b\0\0\0\x2d", 8));
  RunFails(2, {"render", example.store, folder.File("picture.bmp")}, {"picture.bmp", ".png"});
  RunFails(1, {"render", example.store, folder.File("no/picture.png")}, {"no/picture.png"});
  RunFails(1, {"render", example.store, picture, "--sphere", "1000,0,0,1", "--clip"},
           {"triangles"});
}

TEST_CASE("STL files of one ingest share the vertices that they have in common", "[cli]") {
  const Folder folder;
  const Example& example = TheExample();
  const std::string mesh = folder.File("mesh.stl");
  const std::string store = folder.File("joined.mtdb");
  RunOk({"extract", example.store, mesh, "--error", "1%"});
  const Json once = RunJson({"ingest", mesh, store, "--name", "once"});
  const Json twice = RunJson({"ingest", mesh, mesh, store, "--name", "twice"});
  CHECK(twice.at("vertices") == once.at("vertices"));
  CHECK(twice.at("triangles") == once.at("triangles"));  // the second copy's are duplicates
}

TEST_CASE("a store holds many objects of any name", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("several.mtdb");
  const std::string mesh = folder.File("hill.ply");
  RunOk({"generate", "terrain", mesh, "--triangles", "800"});
  CHECK(ParseJson(RunOk({"ingest", mesh, store, "--json"})).at("object") == "hill");
  const Arguments names{"a b",
                        "Stra\xc3\x9f"
                        "e/\xe6\xbc\xa2",
                        "../up", "x,y=z"};
  for (const std::string& name : names) RunOk({"ingest", mesh, store, "--name", name, "--quiet"});
  std::set<std::string> found;
  const Json list = RunJson({"list", store});
  for (const Json& object : list.at("objects")) {
    found.insert(object.at("object"));
    CHECK(object.at("triangles").get<uint64_t>() > 600);
    CHECK(object.at("vertices").get<uint64_t>() > 300);
  }
  std::set<std::string> expected(names.begin(), names.end());
  expected.insert("hill");
  CHECK(found == expected);
  const std::string text = RunOk({"list", store});
  const std::string output = folder.File("out.off");
  for (const std::string& name : expected) {
    CHECK_THAT(text, Catch::Contains("  " + name + "\n"));
    CHECK(RunJson({"extract", store, output, "--name", name}).at("object") == name);
  }
  CHECK(RunJson({"info", store}).at("objects").size() == 5);
  RunFails(1, {"extract", store, output}, {store, "5 objects", "hill", "--name"});
  RunFails(1, {"render", store, folder.File("a.png")}, {store, "5 objects", "--name"});
  RunFails(1, {"extract", store, output, "--name", "cave"}, {store, "cave"});
  RunFails(1, {"info", store, "--name", "cave"}, {store, "cave"});
  RunFails(1, {"verify", store, "--name", "cave"}, {store, "cave"});
  RunFails(1, {"remove", store, "cave"}, {store, "cave"});
  RunFails(2, {"ingest", mesh, store, "--name", std::string(600, 'n')}, {"name", "500"});
  RunFails(2, {"ingest", mesh, folder.File("new.mtdb"), "--name", std::string(600, 'n')},
           {"name", "500"});
  RunFails(2, {"ingest", mesh, store, "--name", "\xff"}, {"name", "UTF-8", "255"});
  RunFails(2, {"ingest", mesh, store, "--name", "two\nlines"}, {"name", "control"});
  CHECK_FALSE(Exists(folder.File("new.mtdb")));
  for (const std::string& name : names)
    CHECK_THAT(RunOk({"remove", store, name}), Catch::StartsWith("removed " + name + "\n"));
  CHECK(RunJson({"list", store}).at("objects").size() == 1);
  CHECK(RunJson({"extract", store, output}).at("object") == "hill");
  RunOk({"remove", store, "hill"});
  CHECK(RunJson({"list", store}).at("objects").empty());
  CHECK_THAT(RunOk({"list", store}), Catch::Contains(": 0 objects, "));
  RunFails(1, {"extract", store, output}, {store, "no object"});
  CHECK(RunJson({"verify", store, "--level", "global"}).at("ok") == true);
}

TEST_CASE("an object is replaced only with --replace", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const std::string small = folder.File("small.ply");
  const std::string large = folder.File("large.ply");
  RunOk({"generate", "terrain", small, "--triangles", "500", "--seed", "7"});
  RunOk({"generate", "terrain", large, "--triangles", "5000"});
  RunOk({"ingest", small, store, "--name", "it"});
  const std::string before = ReadText(store);
  RunFails(1, {"ingest", large, store, "--name", "it"}, {store, "it", "--replace"});
  CHECK(ReadText(store) == before);
  const Json replaced = RunJson({"ingest", large, store, "--name", "it", "--replace"});
  CHECK(replaced.at("triangles") > 4000);
  const Json objects = RunJson({"info", store}).at("objects");
  REQUIRE(objects.size() == 1);
  CHECK(objects.at(0).at("digest") == replaced.at("digest"));
  CHECK(RunJson({"verify", store, "--level", "global"}).at("ok") == true);
}

TEST_CASE("several inputs become one object", "[cli]") {
  const Folder folder;
  const std::string low = folder.File("low.ply");
  const std::string high = folder.File("high.ply");
  const std::string store = folder.File("s.mtdb");
  WriteText(low, Square(0, true));
  WriteText(high, Square(1, false));
  const Json one = RunJson({"ingest", low, store});
  CHECK(one.at("attributes").size() == 4);
  CHECK(one.at("notes").empty());
  const Json both = RunJson({"ingest", low, high, store, "--name", "both"});
  CHECK(both.at("triangles") == 4);
  CHECK(both.at("vertices") == 8);
  CHECK(both.at("components") == 2);
  CHECK(both.at("boundary_edges") == 8);
  REQUIRE(both.at("attributes").size() == 1);
  CHECK(both.at("attributes").at(0) == Json{{"name", "quality"}, {"type", "float32"}});
  REQUIRE(both.at("notes").size() == 3);
  CHECK_THAT(both.at("notes").at(0).get<std::string>(), Catch::Contains("red"));
  CHECK_THAT(both.at("notes").at(0).get<std::string>(), Catch::Contains(high));
  CHECK_THAT(RunOk({"ingest", high, low, store, "--name", "again"}),
             Catch::Contains("note: attribute red dropped"));
  const std::string output = folder.File("out.ply");
  RunOk({"extract", store, output, "--name", "low"});
  CHECK(ReadMesh(output).header.attributes.attributes.size() == 4);
  // An error names the file that it is in.
  WriteText(high, "ply\n");
  RunFails(1, {"ingest", low, high, store, "--name", "third", "--quiet"}, {high});
}

TEST_CASE("--lossless takes text for what a float32 was written as, and no more", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("mesh.obj");
  const auto ingest = [&](double shift, const char* format, bool single) {
    std::string text;
    for (const Vec3d& p : {Vec3d{0.1, 0.2, 1e-7}, Vec3d{1 / 3.0, 12.3456789, -0.7},
                           Vec3d{-4e-5, 987.654321, 2 / 3.0}}) {
      text += "v";
      for (int i = 0; i < 3; ++i) {
        const double value = shift + p[i];
        char number[64];
        std::snprintf(number, sizeof(number), format,
                      single ? static_cast<double>(static_cast<float>(value)) : value);
        text += " " + std::string(number);
      }
      text += "\n";
    }
    WriteText(mesh, text + "f 1 2 3\n");
    return Arguments{"ingest",     mesh,      folder.File("store.mtdb"),
                     "--lossless", "--quiet", "--replace"};
  };
  for (const char* format : {"%g", "%.6f", "%.9g", "%.17g"}) {
    INFO(format);
    for (const double shift : {0.0, 4.5e6}) RunOk(ingest(shift, format, true));
    if (std::string(format) == "%g") continue;
    RunFails(1, ingest(4.5e6, format, false), {mesh, "float32", "--step or --bits"});
  }
}

TEST_CASE("--lossless keeps every bit, --bits and --step set the grid", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const Json info = RunJson({"ingest", example.mesh, store, "--name", "exact", "--lossless"});
  CHECK(info.at("positions") == "float32");
  const std::string output = folder.File("out.ply");
  RunOk({"extract", store, output, "--name", "exact"});
  const auto sorted = [](const TriangleMesh& mesh) {
    std::vector<std::array<double, 3>> points;
    for (const Vec3d p : mesh.positions) points.push_back({p.x, p.y, p.z});
    std::sort(points.begin(), points.end());
    return points;
  };
  CHECK(sorted(ReadMesh(output)) == sorted(ReadMesh(example.mesh)));
  const Json coarse = RunJson({"ingest", example.mesh, store, "--name", "b", "--bits", "10"});
  CHECK(coarse.at("bits") == 10);
  const Json stepped = RunJson({"ingest", example.mesh, store, "--name", "s", "--step", "0.01"});
  CHECK(stepped.at("step") == 0.01);
  // Steps that the grid cannot count are an error, and leave the store as it was.
  const std::string before = ReadText(store);
  RunFails(1, {"ingest", example.mesh, store, "--name", "t", "--step", "1e-12", "--quiet"},
           {"step"});
  CHECK(ReadText(store) == before);
}

TEST_CASE("--normal-bits and --attribute-step round attributes, and info says so", "[cli]") {
  const Folder folder;
  const std::string input = folder.File("in.ply");
  const std::string store = folder.File("s.mtdb");
  std::string text = Square(0, false);
  for (const char* axis : {"nx", "ny", "nz"}) {
    text.insert(text.find("property float quality"), std::string("property float ") + axis + "\n");
  }
  for (size_t at = 0; (at = text.find(" 0.5\n", at)) != std::string::npos; at += 14) {
    text.insert(at, " 0.6 0 0.8");
  }
  WriteText(input, text);
  const Json rounded = RunJson({"ingest", input, store, "--normal-bits", "8", "--attribute-step",
                                "quality=0.3", "--name", "a"});
  const Json& attributes = rounded.at("attributes");
  REQUIRE(attributes.size() == 4);
  CHECK(attributes.at(0) == Json{{"name", "nx"}, {"type", "float32"}, {"normal_bits", 8}});
  CHECK(attributes.at(3) == Json{{"name", "quality"}, {"type", "float32"}, {"step", 0.3}});
  CHECK_THAT(RunOk({"info", store}), Catch::Contains("attribute    quality, step 0.3"));
  CHECK_THAT(RunOk({"info", store}), Catch::Contains("attribute    nx and the next two"));
  const std::string output = folder.File("out.ply");
  RunOk({"extract", store, output});
  const TriangleMesh mesh = ReadMesh(output);
  ByteReader row(mesh.rows);
  CHECK(row.Get<float>() == Approx(0.6).margin(2.13 / 127));
  CHECK(row.Get<float>() == Approx(0).margin(2.13 / 127));
  CHECK(row.Get<float>() == Approx(0.8).margin(2.13 / 127));
  CHECK(row.Get<float>() == Approx(0.6));
  RunFails(1, {"ingest", input, store, "--attribute-step", "none=1", "--quiet"}, {"none"});
  RunFails(2, {"ingest", input, store, "--attribute-step", "quality=0"}, {"NAME=STEP"});
  RunFails(2, {"ingest", input, store, "--attribute-step", "quality"}, {"NAME=STEP"});
  RunFails(2, {"ingest", input, store, "--normal-bits", "3"}, {"--normal-bits"});
  WriteText(input, Square(0, true));
  RunFails(1, {"ingest", input, store, "--normal-bits", "8", "--quiet"}, {"nx, ny, nz"});
}

TEST_CASE("the digest does not depend on threads", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  for (const std::string threads : {"1", "2", "5"}) {
    const Json json = RunJson({"ingest", example.mesh, folder.File(threads), "--name", "sculpture",
                               "--threads", threads});
    CHECK(json.at("digest") == example.info.at("digest"));
  }
}

TEST_CASE("a build with too little --memory does not begin", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  RunFails(2, {"ingest", example.mesh, store, "--memory", "64K", "--quiet"}, {"memory", "256M"});
  CHECK_FALSE(Exists(store));
}

TEST_CASE("generate is deterministic by seed", "[cli]") {
  const Folder folder;
  for (const std::string shape : {"sculpture", "terrain"}) {
    Arguments seeds{"1", "1", "2"};
    std::vector<std::string> bytes;
    for (const std::string& seed : seeds) {
      const std::string path = folder.File("a.ply");
      CHECK_THAT(RunOk({"generate", shape, path, "--triangles", "1000", "--seed", seed}),
                 Catch::StartsWith(path + ": ") && Catch::Contains(" triangles, "));
      bytes.push_back(ReadText(path));
    }
    CHECK(bytes[0] == bytes[1]);
    CHECK(bytes[0] != bytes[2]);
  }
  RunFails(1, {"generate", "terrain", folder.File("no/a.ply"), "--triangles", "1000"},
           {"no/a.ply"});
}

TEST_CASE("--quiet is silent, and progress off a terminal is plain lines", "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const Outcome quiet = Run({"ingest", example.mesh, store, "--name", "a", "--quiet"});
  CHECK(quiet.exit_code == 0);
  CHECK(quiet.out.empty());
  CHECK(quiet.err.empty());
  const Outcome loud = Run({"ingest", example.mesh, store, "--name", "b"});
  CHECK(loud.exit_code == 0);
  CHECK_THAT(loud.out, Catch::Contains("b: ") && Catch::Contains(" triangles, "));
  CHECK_THAT(loud.out, Catch::Contains("bits per vertex"));
  CHECK(loud.err.find_first_of("\r\033") == std::string::npos);
  const auto lines = std::count(loud.err.begin(), loud.err.end(), '\n');
  CHECK(lines >= 3);
  CHECK(lines <= 12);
  CHECK(loud.err.ends_with("\n"));
  CHECK_THAT(loud.err, Catch::Contains("round 1, "));
}

TEST_CASE("progress on a terminal is one line, rewritten", "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  int terminal = -1;
  const pid_t child = ::forkpty(&terminal, nullptr, nullptr, nullptr);
  if (child < 0) {
    WARN("skipped: this system gives no pseudo terminals");
    return;
  }
  if (child == 0) {
    ::alarm(kTimeoutSeconds);
    ::execl(MTDB_BINARY, "mtdb", "ingest", example.mesh.c_str(), store.c_str(), "--name", "a",
            nullptr);
    ::_exit(127);
  }
  std::string text;
  std::array<char, 4096> block;
  for (ssize_t n = 0; (n = ::read(terminal, block.data(), block.size())) > 0;) {
    text.append(block.data(), static_cast<size_t>(n));
  }
  ::close(terminal);
  CHECK(Finish(child).exit_code == 0);
  INFO(text);
  // All of the progress comes before the first line feed, and is wiped at its end.
  const std::string progress = text.substr(0, text.find("a: "));
  CHECK(progress.find('\n') == std::string::npos);
  CHECK(progress.starts_with("\r\033[K"));
  CHECK(progress.ends_with("\r\033[K"));
  CHECK_THAT(progress, Catch::Contains(" %  "));
  CHECK_THAT(text, Catch::Contains("bits per vertex"));
}

TEST_CASE("wrong usage gives exit status 2 and one line that names the culprit", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string out = folder.File("out.ply");
  const Arguments extract{"extract", example.store, out};
  const auto with = [](Arguments base, const Arguments& more) {
    base.insert(base.end(), more.begin(), more.end());
    return base;
  };
  RunFails(2, {"paint"}, {"paint", "mtdb help"});
  RunFails(2, {"help", "paint"}, {"paint"});
  RunFails(2, {"--paint"}, {"--paint"});
  RunFails(2, {"ingest", example.mesh}, {"STORE"});
  RunFails(2, {"extract", example.store}, {"OUTPUT"});
  RunFails(2, {"render", example.store}, {"OUT.png"});
  RunFails(2, {"remove", example.store}, {"NAME"});
  RunFails(2, {"generate", "terrain", out}, {"--triangles"});
  RunFails(2, {"list", example.store, "another"}, {"another"});
  RunFails(2, with(extract, {"--colour"}), {"--colour"});
  for (const Arguments& more :
       std::vector<Arguments>{{"--error", "1"}, {"--error", "100%"}, {"--triangles", "1"}}) {
    RunFails(2, with(extract, with({"--full"}, more)), {"--full", more[0]});
  }
  for (const char* value : {"", "x", "-1", "nan", "inf", "1e999", "1,2", "1 "}) {
    RunFails(2, with(extract, {std::string("--error=") + value}), {"--error"});
    RunFails(2, {"ingest", example.mesh, folder.File("s"), std::string("--step=") + value},
             {"--step"});
  }
  RunFails(2, with(extract, {"--error"}), {"--error"});
  for (const char* value : {"0", "-5", "x", "1.5"}) {
    RunFails(2, with(extract, {std::string("--triangles=") + value}), {"--triangles"});
  }
  for (const char* value : {"1,2,3", "1,2,3,4,5,6,7", "1,2,3,4,5,x", "1,2,3,4,5,nan", "1,,3,4,5,6",
                            "1,2,3,4,5,6,", "", "1 2 3 4 5 6"}) {
    RunFails(2, with(extract, {std::string("--box=") + value}), {"--box", value});
  }
  for (const char* value : {"1,2,3", "1,2,3,-4", "1,2,3,inf", "a,b,c,d"}) {
    RunFails(2, with(extract, {std::string("--sphere=") + value}), {"--sphere", value});
  }
  RunFails(2, with(extract, {"--clip"}), {"--clip", "--box", "--sphere"});
  const Arguments render{"render", example.store, folder.File("a.png")};
  for (const char* value : {"12", "0x5", "5x0", "-1x5", "axb", "5x5x5", "99999x10", "x"}) {
    RunFails(2, with(render, {std::string("--size=") + value}), {"--size", value});
  }
  const Arguments ingest{"ingest", example.mesh, folder.File("s.mtdb")};
  for (const char* value : {"0", "4X", "G", "-1G", "1.5", "99999999999999999999", "16777216T"}) {
    RunFails(2, with(ingest, {std::string("--memory=") + value}), {"--memory", value});
  }
  for (const char* value : {"0", "25", "-1", "x"}) {
    RunFails(2, with(ingest, {std::string("--bits=") + value}), {"--bits"});
  }
  RunFails(2, with(ingest, {"--bits", "12", "--step", "1"}), {"--bits", "--step"});
  RunFails(2, with(ingest, {"--bits", "12", "--lossless"}), {"--bits", "--lossless"});
  RunFails(2, with(ingest, {"--step", "1", "--lossless"}), {"--step", "--lossless"});
  RunFails(2, with(ingest, {"--threads", "0"}), {"--threads"});
  RunFails(2, {"verify", example.store, "--level", "most"}, {"--level", "most"});
  RunFails(2, {"generate", "cube", out, "--triangles", "1000"}, {"SHAPE", "cube"});
  for (const char* value : {"99", "20000000001", "-1", "x"}) {
    RunFails(2, {"generate", "terrain", out, std::string("--triangles=") + value}, {"--triangles"});
  }
  CHECK_FALSE(Exists(out));
  CHECK_FALSE(Exists(folder.File("s.mtdb")));
}

}  // namespace
}  // namespace mtdb::test
