// SPDX-License-Identifier: Apache-2.0
// Rasters through the command line: in, what is said of them, and out in their own coordinates.
#include <cmath>
#include <map>
#include <numbers>
#include <png.h>
#include <set>

#include "tests/tools/terrain_testing.h"

namespace mtdb::test {
namespace {

TEST_CASE("neighbouring .hgt files become one terrain, the first one's samples where they differ",
          "[cli]") {
  const Folder folder;
  constexpr uint32_t kSide = 41;
  const std::vector<double> north = MakeHeights(kSide, kSide, 1);
  std::vector<double> south = MakeHeights(kSide, kSide, 2);
  std::copy(north.end() - kSide, north.end(), south.begin());
  south[3] += 2;
  south[9] -= 1;
  south[200] = kHole;
  WriteHgt(folder.File("N11E007.hgt"), north);
  WriteHgt(folder.File("N10E007.hgt"), south);
  const std::string store = folder.File("s.mtdb");
  const Json report = RunJson(
      {"ingest", folder.File("N10E007.hgt"), folder.File("N11E007.hgt"), store, "--name", "both"});
  CHECK(report.at("raster_input").at("overlapping") == kSide);
  CHECK(report.at("raster_input").at("differing") == 2);
  CHECK(report.at("raster_input").at("largest_difference") == 2);
  CHECK(report.at("raster_input").at("holes") == 1);
  CHECK(report.at("error_measure") == "vertical");
  CHECK(report.at("raster").at("columns") == kSide);
  CHECK(report.at("raster").at("rows") == 2 * kSide - 1);
  CHECK(report.at("raster").at("geotransform") ==
        Json::array({7.0, 1.0 / (kSide - 1), 0.0, 12.0, 0.0, -1.0 / (kSide - 1)}));
  CHECK(report.at("raster").at("nodata") == -32768);
  CHECK_THAT(report.at("raster").at("crs").get<std::string>(), Catch::Contains("WGS 84"));
  const std::string size = std::to_string(kSide) + " x " + std::to_string(2 * kSide - 1);
  CHECK_THAT(RunOk({"info", store}), Catch::Contains("vertical") && Catch::Contains("EGM96") &&
                                         Catch::Contains(size) && Catch::Contains("apart in x") &&
                                         Catch::Contains("WGS 84") &&
                                         Catch::Contains("the first at 7 12, the last at 8 10") &&
                                         Catch::Contains("nodata was -32768"));
  CHECK_THAT(RunOk({"verify", store, "--level", "global"}), Catch::Contains("ok"));

  RunOk({"extract", store, folder.File("full.ply")});
  const auto heights = HeightsOf(folder.File("full.ply"));
  CHECK(heights.size() == kSide * (2 * kSide - 1) - 1);
  for (uint32_t r = 0; r < 2 * kSide - 1; ++r) {
    for (uint32_t c = 0; c < kSide; ++c) {
      // In the raster's own coordinates, up to the last digit of the sums.
      const double x = 7 + c / double(kSide - 1);
      const double y = 12 - r / double(kSide - 1);
      const double expected =
          r >= kSide - 1 ? south[(r - kSide + 1) * kSide + c] : north[r * kSide + c];
      const auto at = heights.lower_bound({x - 1e-9, y - 1e-3});
      bool found = false;
      for (auto i = at; i != heights.end() && i->first.first < x + 1e-9; ++i) {
        if (std::abs(i->first.second - y) > 1e-9) continue;
        found = true;
        CHECK(i->second == expected);
      }
      CHECK(found == !std::isnan(expected));
    }
  }
  // An error in metres, and a part in degrees.
  const Json coarse = RunJson({"extract", store, folder.File("c.ply"), "--error", "10"});
  CHECK(coarse.at("error_bound") <= 10);
  CHECK(coarse.at("triangles") < 4000);
  const Json part =
      RunJson({"extract", store, folder.File("p.ply"), "--box=7.2,10.2,0,7.4,10.4,3000"});
  CHECK(part.at("triangles") < 1500);
}

TEST_CASE("an ASCII grid keeps its decimals, its place and its holes", "[cli]") {
  const Folder folder;
  constexpr uint32_t kColumns = 31, kRows = 27;
  std::vector<double> heights = MakeHeights(kColumns, kRows, 3);
  for (double& h : heights) h += 0.25;
  heights[40] = heights[41] = kHole;
  const std::string file = folder.File("dem.asc");
  WriteGrid(file,
            "ncols 31\nnrows 27\nxllcorner 500000\nyllcorner 5100000.5\ncellsize 30\n"
            "NODATA_value -9999\n",
            kColumns, heights);
  WriteText(folder.File("dem.prj"), "LOCAL_CS[\"here\"]\n");
  const std::string store = folder.File("s.mtdb");
  const Json report = RunJson({"ingest", file, store});
  CHECK(report.at("step") == 0.01);
  CHECK(report.at("raster").at("crs") == "LOCAL_CS[\"here\"]");
  CHECK(report.at("raster").at("area_or_point") == "Area");
  CHECK(report.at("raster_input").at("holes") == 2);
  RunOk({"extract", store, folder.File("full.ply")});
  const auto found = HeightsOf(folder.File("full.ply"));
  CHECK(found.size() == kColumns * kRows - 2);
  for (const auto& [place, height] : found) {
    const double c = (place.first - 500015) / 30;  // of pixels: half of one from the corner
    const double r = (5100000.5 + 27 * 30 - 15 - place.second) / 30;
    REQUIRE(c == std::floor(c));
    REQUIRE(r == std::floor(r));
    CHECK(height == Approx(heights[static_cast<size_t>(r * kColumns + c)]).epsilon(1e-12));
  }
  CHECK(RunJson({"ingest", file, store, "--name", "rough", "--height-step", "2"})
            .at("rounding_error") <= 1.0001);
}

TEST_CASE("heights of so many steps that float32 cannot count them come back", "[cli]") {
  const Folder folder;
  const std::string file = folder.File("dem.asc");
  const std::string rows = "1695.7391 -1682.6271\n107374.1823 0.0001\n";
  WriteText(file, "ncols 2\nnrows 2\nxllcenter 0\nyllcenter 0\ncellsize 1\n" + rows);
  const Json report = RunJson({"ingest", file, folder.File("s.mtdb"), "--name", "t"});
  CHECK(report.at("rounding_error") <= 1e-10);
  RunOk({"extract", folder.File("s.mtdb"), folder.File("out.asc")});
  CHECK_THAT(ReadText(folder.File("out.asc")),
             Catch::Contains("1695.7391 -1682.6271") && Catch::Contains("107374.1823 0.0001"));
  RunOk({"extract", folder.File("s.mtdb"), folder.File("out.ply")});
  const auto heights = HeightsOf(folder.File("out.ply"));
  CHECK(heights.at({0, 0}) == Approx(107374.1823).epsilon(1e-12));
}

TEST_CASE("rasters that are none, or not of one grid, are refused with the reason", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const auto refused = [&](const Arguments& inputs, const std::string& why) {
    Arguments arguments{"ingest"};
    arguments.insert(arguments.end(), inputs.begin(), inputs.end());
    const Outcome outcome = Run(arguments);
    CHECK(outcome.exit_code != 0);
    CHECK_THAT(outcome.err, Catch::Contains(why));
    CHECK(!Exists(store));
  };
  WriteHgt(folder.File("N11E007.hgt"), MakeHeights(11, 11, 1));
  WriteHgt(folder.File("N12E007.hgt"), MakeHeights(12, 12, 1));
  WriteHgt(folder.File("hills.hgt"), MakeHeights(11, 11, 1));
  WriteText(folder.File("N13E007.hgt"), std::string(100, 'x'));
  WriteHgt(folder.File("N14E007.hgt"), std::vector<double>(121, kHole));
  WriteText(folder.File("short.asc"),
            "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2");
  WriteText(folder.File("word.asc"),
            "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 four");
  WriteText(folder.File("one.asc"), "ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n7\n");
  WriteText(folder.File("dem.tif"), "no tiff");
  WriteText(folder.File("m.off"), "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
  const auto f = [&](const char* name) { return folder.File(name); };
  refused({f("N11E007.hgt"), f("N12E007.hgt"), store}, "spacing of samples differs");
  refused({f("hills.hgt"), store}, "N37W120.hgt");
  refused({f("N13E007.hgt"), store}, "square of int16");
  refused({f("N14E007.hgt"), store}, "0 of 11 x 11 samples have a height");
  refused({f("short.asc"), store}, "the end of the file");
  refused({f("word.asc"), store}, "row 1, column 1: expected a number, found 'four'");
  refused({f("one.asc"), store}, "no three heights beside each other");
  refused({f("N11E007.hgt"), f("m.off"), store}, "is no raster");
  refused({f("N11E007.hgt"), store, "--bits", "12"}, "--height-step");
  refused({f("m.off"), store, "--height-step", "1"}, "is for rasters");
  refused({f("dem.tif"), store}, MTDB_TEST_GDAL != 0 ? "dem.tif" : "without GDAL");
}

TEST_CASE("a raster of one row or column has no surface", "[cli]") {
  const Folder folder;
  WriteText(folder.File("row.asc"),
            "ncols 5\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3 4 5\n");
  const Outcome outcome = Run({"ingest", folder.File("row.asc"), folder.File("s.mtdb")});
  CHECK(outcome.exit_code != 0);
  CHECK_THAT(outcome.err, Catch::Contains("5 of 5 x 1 samples have a height"));
}

TEST_CASE("ingest --fill closes small holes, and says how many", "[cli]") {
  const Folder folder;
  constexpr uint32_t kSide = 40;
  std::vector<double> heights = MakeHeights(kSide, kSide, 6);
  const auto hole = [&](uint32_t row, uint32_t column, uint32_t rows, uint32_t columns) {
    for (uint32_t r = row; r < row + rows; ++r) {
      for (uint32_t c = column; c < column + columns; ++c) heights[r * kSide + c] = kHole;
    }
  };
  hole(5, 5, 3, 2);
  hole(20, 10, 1, 1);
  hole(25, 20, 8, 3);
  hole(0, 30, 2, 2);
  // Across the files of a mosaic.
  const std::string store = folder.File("s.mtdb");
  const auto part = [&](const char* name, uint32_t begin, uint32_t end) {
    const std::string header = "ncols 40\nnrows " + std::to_string(end - begin) +
                               "\nxllcenter 0\nyllcenter " + std::to_string(kSide - end) +
                               "\ncellsize 1\nNODATA_value -9999\n";
    WriteGrid(folder.File(name), header, kSide,
              {heights.begin() + begin * kSide, heights.begin() + end * kSide});
    return folder.File(name);
  };
  const std::string north = part("north.asc", 0, 7), south = part("south.asc", 7, kSide);
  const Json report = RunJson({"ingest", north, south, store, "--name", "t", "--fill", "3"});
  CHECK(report.at("raster_input").at("filled") == 7);
  CHECK(report.at("raster_input").at("filled_holes") == 2);
  CHECK(report.at("raster_input").at("larger_holes") == 1);
  CHECK(report.at("raster_input").at("holes") == 28);
  CHECK(report.at("raster").at("filled") == 7);
  CHECK(report.at("vertices") == kSide * kSide - 28);
  CHECK(report.at("rounding_error") == 0);
  CHECK_THAT(RunOk({"info", store}), Catch::Contains("7 samples that had no height"));
  CHECK_THAT(RunOk({"ingest", north, south, store, "--name", "again", "--fill", "3"}),
             Catch::Contains("7 samples of 2 holes got a height; 1 larger holes were left"));
  RunOk({"extract", store, folder.File("t.asc"), "--name", "t"});
  CHECK_THAT(Run({"ingest", north, folder.File("x.mtdb"), "--fill", "0"}).err,
             Catch::Contains("--fill"));
  WriteText(folder.File("m.off"), "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
  CHECK_THAT(Run({"ingest", folder.File("m.off"), folder.File("x.mtdb"), "--fill", "2"}).err,
             Catch::Contains("closes holes of rasters"));
}

TEST_CASE("a mesh that is a height field becomes a terrain, and another one is refused", "[cli]") {
  const Folder folder;
  constexpr uint32_t kSide = 30;
  const std::vector<double> heights = MakeHeights(kSide, kSide, 4);
  WriteGrid(folder.File("dem.asc"),
            "ncols 30\nnrows 30\nxllcenter 0\nyllcenter 0\ncellsize 2\nNODATA_value -32768\n",
            kSide, heights);
  const std::string raster = folder.File("raster.mtdb"), store = folder.File("mesh.mtdb");
  RunOk({"ingest", folder.File("dem.asc"), raster});
  // (A .glb has y for up: its terrains are read as they stand.)
  for (const std::string format : {"ply", "obj", "stl", "off"}) {
    const std::string mesh = folder.File("m_" + format + "." + format);
    RunOk({"extract", raster, mesh});
    const std::string name = "m_" + format;
    const Json report = RunJson({"ingest", mesh, store, "--terrain"});
    CHECK(report.at("error_measure") == "vertical");
    CHECK(report.at("rounding_error") == 0);
    CHECK(report.at("vertices") == kSide * kSide);
    const Json probed = RunJson({"probe", store, "--name", name, "--height=7,20"});
    CHECK(probed.at("heights").at(0).at("height") ==
          RunJson({"probe", raster, "--height=7,20"}).at("heights").at(0).at("height"));
    CHECK(RunJson({"extract", store, folder.File("c.ply"), "--name", name, "--error", "20"})
              .at("error_bound") <= 20);
  }
  CHECK_THAT(RunOk({"info", store, "--name", "m_ply"}), Catch::Contains("vertical"));
  CHECK(RunJson({"profile", store, "--name", "m_ply", "--line=1,1,50,40"}).at("points").size() >
        30);
  RunOk({"extract", store, folder.File("again.asc"), "--name", "m_ply", "--spacing", "2"});
  RunOk({"ingest", folder.File("again.asc"), store});
  RunOk({"extract", store, folder.File("one.asc"), "--name", "again"});
  RunOk({"extract", raster, folder.File("two.asc")});
  CHECK(ReadText(folder.File("one.asc")) == ReadText(folder.File("two.asc")));
  CHECK_THAT(Run({"extract", store, folder.File("x.asc"), "--name", "m_ply"}).err,
             Catch::Contains("name a spacing"));
  RunOk({"generate", "sculpture", folder.File("s.ply"), "--triangles", "2000"});
  const Outcome folded = Run({"ingest", folder.File("s.ply"), store, "--terrain"});
  CHECK(folded.exit_code != 0);
  CHECK_THAT(folded.err, Catch::Contains("s.ply: is no height field") && Catch::Contains("near"));
  const Outcome dry = Run({"ingest", folder.File("s.ply"), store, "--terrain", "--dry-run"});
  CHECK(dry.exit_code == 1);
  CHECK(dry.err.substr(dry.err.find("s.ply")) == folded.err.substr(folded.err.find("s.ply")));
  CHECK_THAT(
      Run({"ingest", folder.File("m_ply.ply"), store, "--terrain", "--lossless", "--replace"}).err,
      Catch::Contains("--lossless"));
}

TEST_CASE("a terrain goes out as the raster that it was", "[cli]") {
  {
    const Tile t;
    // Byte for byte.
    const std::filesystem::path folder = t.folder.File("out");
    std::filesystem::create_directory(folder);
    const std::string out = (folder / "N09E007.hgt").string();
    CHECK_THAT(RunOk({"extract", t.store, out}), Catch::Contains("60 of them holes"));
    CHECK(ReadText(out) == ReadText(t.hgt));
    CHECK_THAT(Run({"extract", t.store, t.folder.File("N09E008.hgt")}).err,
               Catch::Contains("whole degrees"));
    // As text, and in again.
    RunOk({"extract", t.store, t.folder.File("all.asc")});
    RunOk({"ingest", t.folder.File("all.asc"), t.folder.File("again.mtdb")});
    const Json again = RunJson({"info", t.folder.File("again.mtdb")}).at("objects").at(0);
    CHECK(again.at("vertices") == 51 * 51 - 60);
    // A part, coarser, within the error.
    const Json part = RunJson({"extract", t.store, t.folder.File("part.asc"), "--window",
                               "7.2,9.2,7.4,9.5", "--spacing", "0.01", "--error", "15"});
    CHECK(part.at("columns") == 21);
    CHECK(part.at("rows") == 31);
    CHECK(part.at("error_bound") <= 15);
  }
}

TEST_CASE("a GeoTIFF goes in, and comes back sample by sample", "[cli]") {
  if (MTDB_TEST_GDAL == 0) {
    WARN("skipped: without GDAL");
    return;
  }
  const Tile t;
  const std::string tif = t.folder.File("dem.tif");
  RunOk({"extract", t.store, tif});
  const std::string store = t.folder.File("tif.mtdb");
  const Json report = RunJson({"ingest", tif, store});
  CHECK(report.at("raster").at("sample_type") == "int16");
  CHECK(report.at("raster").at("area_or_point") == "Point");
  CHECK(report.at("raster").at("nodata") == -32768);
  CHECK(report.at("raster_input").at("holes") == 60);
  CHECK_THAT(report.at("raster").at("crs").get<std::string>(),
             Catch::Contains("GEOGCRS[\"WGS 84\""));
  std::filesystem::create_directory(t.folder.File("out"));
  RunOk({"extract", store, t.folder.File("out/N09E007.hgt")});
  CHECK(ReadText(t.folder.File("out/N09E007.hgt")) == ReadText(t.hgt));
}

// A virtual raster of GDAL: a window of type `type` on another file, or on none.
void WriteVrt(const std::string& path, const std::string& size, const std::string& geotransform,
              const std::string& type, const std::string& band) {
  WriteText(path, "<VRTDataset " + size + "><GeoTransform>" + geotransform +
                      "</GeoTransform><VRTRasterBand dataType=\"" + type + "\" band=\"1\">" + band +
                      "</VRTRasterBand></VRTDataset>");
}
constexpr const char* kFourByFour = "rasterXSize=\"4\" rasterYSize=\"4\"";

// The numbers of an ASCII grid: NaN where there is none.
std::vector<double> GridOf(const std::string& path) {
  std::ifstream in(path);
  std::string word;
  while (in >> word && word != "NODATA_value") {
  }
  double nodata = 0;
  in >> nodata;
  std::vector<double> heights;
  for (double h = 0; in >> h;) heights.push_back(h == nodata ? kHole : h);
  return heights;
}

bool Same(const std::vector<double>& a, const std::vector<double>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](double u, double v) {
    return std::isnan(u) ? std::isnan(v) : std::abs(u - v) < 1e-9;
  });
}

TEST_CASE("a GeoTIFF has all heights and holes, whatever type and nodata value the files had",
          "[cli]") {
  if (MTDB_TEST_GDAL == 0) {
    WARN("skipped: without GDAL");
    return;
  }
  const Folder folder;
  const auto f = [&](const std::string& name) { return folder.File(name); };
  const auto header = [](int x, int y) {
    return "ncols 4\nnrows 4\nxllcorner " + std::to_string(x) + "\nyllcorner " + std::to_string(y) +
           "\ncellsize 1\n";
  };
  const std::string rows = "1 2 3 4\n5 6 7 8\n9 10 11 12\n13 14 15 123\n";
  const std::string source =
      "<SimpleSource><SourceFilename relativeToVRT=\"1\">whole.asc</SourceFilename>"
      "<SourceBand>1</SourceBand></SimpleSource>";
  WriteText(f("whole.asc"), header(0, 0) + rows);
  WriteText(f("decimals.asc"), header(4, 0) + "1 2 3.25 4\n5 6 7 8\n9 1 1 12\n13 14 15 12.34\n");
  WriteText(f("apart.asc"), header(4, 4) + "NODATA_value 7\n" + rows);
  WriteText(f("zero.asc"), header(0, 0) + "NODATA_value 0\n-1 0 -1 2\n2 2 2 2\n2 2 2 2\n2 2 2 2\n");
  WriteText(f("zeroes.asc"), header(4, 0) + "0 2 2 2\n2 2 2 2\n2 2 2 2\n2 2 2 -2\n");
  WriteVrt(f("scaled.vrt"), kFourByFour, "0,1,0,4,0,-1", "Int16",
           "<Scale>0.1</Scale><Offset>0.5</Offset><NoDataValue>7</NoDataValue>" + source);
  WriteVrt(f("byte.vrt"), kFourByFour, "0,1,0,4,0,-1", "Byte", source);
  WriteVrt(f("byte2.vrt"), kFourByFour, "4,1,0,0,0,-1", "Byte", source);
  const auto trip = [&](Arguments inputs, const std::string& type, size_t holes,
                        const Arguments& more = {}) {
    INFO(inputs.at(0));
    const std::string store = f("s.mtdb");
    const std::string again = f("again.mtdb");
    const auto extract = [&](const std::string& from, const std::string& to) {
      Arguments arguments{"extract", from, f(to)};
      if (from == store) arguments.insert(arguments.end(), more.begin(), more.end());
      RunOk(arguments);
    };
    for (std::string& name : inputs) name = f(name);
    inputs.insert(inputs.begin(), "ingest");
    inputs.push_back(store);
    RunOk(inputs);
    extract(store, "direct.asc");
    extract(store, "dem.tif");
    const Json report = RunJson({"ingest", f("dem.tif"), again, "--height-step", "0.01"});
    extract(again, "indirect.asc");
    CHECK(report.at("raster").at("sample_type") == type);
    CHECK(report.at("raster_input").at("holes") == holes);
    const std::vector<double> direct = GridOf(f("direct.asc"));
    CHECK(Same(direct, GridOf(f("indirect.asc"))));
    CHECK(std::count_if(direct.begin(), direct.end(), [](double h) { return std::isnan(h); }) ==
          static_cast<std::ptrdiff_t>(holes));
    std::filesystem::remove(store);
    std::filesystem::remove(again);
  };
  trip({"whole.asc"}, "int32", 0);
  trip({"byte.vrt"}, "byte", 0);
  trip({"byte.vrt", "byte2.vrt"}, "byte", 32);
  trip({"scaled.vrt"}, "float64", 1);
  trip({"whole.asc", "decimals.asc"}, "float64", 0);
  trip({"whole.asc", "apart.asc"}, "int32", 33);
  trip({"zero.asc", "zeroes.asc"}, "int32", 1);
  trip({"zeroes.asc", "zero.asc"}, "int32", 1);
  trip({"zero.asc"}, "float32", 4, {"--spacing", "0.5"});
  trip({"whole.asc"}, "float32", 7 + 7 + 1, {"--spacing", "0.5", "--window", "0,0.5,3.5,4"});

  // A type without room for a nodata value.
  WriteText(f("whole.asc"), header(0, 0) + "0 1 2 3\n5 6 7 8\n9 10 11 12\n13 14 15 255\n");
  trip({"byte.vrt"}, "byte", 0);
  trip({"byte.vrt", "byte2.vrt"}, "float64", 32);

  // What float32 rounds is in the bound that is told.
  WriteText(f("whole.asc"), header(0, 0) + "8848.123 1 2 3\n5 6 7 8\n9 1 1 1\n13 14 15 25\n");
  RunOk({"ingest", f("whole.asc"), f("s.mtdb")});
  const Json told = RunJson({"extract", f("s.mtdb"), f("dem.tif"), "--spacing", "1"});
  CHECK(told.at("error_bound") > std::abs(8848.123 - double{8848.123F}) - 1e-9);
}

TEST_CASE("rasters whose samples have no places, or no end, are refused", "[cli]") {
  const Folder folder;
  const auto f = [&](const std::string& name) { return folder.File(name); };
  const auto refused = [&](const Arguments& inputs, const std::string& why) {
    Arguments arguments{"ingest"};
    for (const std::string& name : inputs) arguments.push_back(f(name));
    arguments.insert(arguments.end(), {f("s.mtdb"), "--memory", "1G"});
    const Outcome outcome = Run(arguments);
    INFO(inputs.at(0));
    CHECK(outcome.exit_code == 1);
    CHECK_THAT(outcome.err, Catch::Contains(f(inputs.back())) && Catch::Contains(why));
    CHECK(!Exists(f("s.mtdb")));
  };
  const std::string rows = "\n1 2\n3 4\n";
  WriteText(f("far.asc"), "ncols 2\nnrows 2\nxllcorner 1e15\nyllcorner 0\ncellsize 1e-3" + rows);
  refused({"far.asc"}, "closer together");
  WriteText(f("long.asc"), "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3 " +
                               std::string(5000, '4'));
  refused({"long.asc"}, "without a space");
  std::string names;
  for (int i = 0; i < 200; ++i) names += "name" + std::to_string(i) + " 1\n";
  WriteText(f("names.asc"), "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n" + names);
  refused({"names.asc"}, "names");
  if (MTDB_TEST_GDAL == 0) {
    WARN("skipped: without GDAL");
    return;
  }
  WriteVrt(f("good.vrt"), kFourByFour, "0, 1, 0, 0, 0, -1", "Byte", "");
  const std::string large = "rasterXSize=\"500000\" rasterYSize=\"4\"";
  for (const char* transform : {"nan, 1, 0, 0, 0, -1", "0, 1, 0, inf, 0, -1", "0, nan, 0, 0, 0, -1",
                                "0, 1, nan, 0, 0, -1", "-inf, 1, 0, 0, 0, -1"}) {
    WriteVrt(f("bad.vrt"), large, transform, "Byte", "");
    refused({"bad.vrt"}, "1e30");
    refused({"good.vrt", "bad.vrt"}, "1e30");
  }
  WriteVrt(f("bad.vrt"), large, "1e308, 1, 0, 1e308, 0, -1", "Byte", "");
  refused({"bad.vrt"}, "1e30");
  WriteVrt(f("bad.vrt"), large, "0, 1, 1, 0, 1, 1", "Byte", "");
  refused({"bad.vrt"}, "one direction");
  WriteVrt(f("bad.vrt"), "rasterXSize=\"1000000000\" rasterYSize=\"4\"", "0, 1, 0, 0, 0, -1",
           "Byte", "");
  refused({"bad.vrt"}, "--memory");
  WriteVrt(f("bad.vrt"), "rasterXSize=\"2000000000\" rasterYSize=\"4\"", "0, 1, 0, 0, 0, -1",
           "Byte", "");
  refused({"bad.vrt"}, "2^30");
}

TEST_CASE("what has no heights is told so", "[cli]") {
  const Example& example = TheExample();
  for (const Arguments& arguments : {Arguments{"probe", example.store, "--height", "1,2"},
                                     Arguments{"profile", example.store, "--line", "1,2,3,4"},
                                     Arguments{"extract", example.store, "never.asc"}}) {
    const Outcome outcome = Run(arguments);
    CHECK(outcome.exit_code != 0);
    CHECK_THAT(outcome.err, Catch::Contains("is no terrain"));
  }
  CHECK(!Exists("never.asc"));
}

TEST_CASE("the shared tiles join at their common row", "[cli]") {
  const std::string folder = std::string(MTDB_SOURCE_DIR) + "/../shared/data/";
  if (!Exists(folder + "N37W120.hgt")) {
    WARN("skipped: no " << folder << "N37W120.hgt");
    return;
  }
  const Folder out;
  const std::string store = out.File("sierra.mtdb");
  const Json report = RunJson(
      {"ingest", folder + "N37W120.hgt", folder + "N38W120.hgt", store, "--name", "sierra"});
  CHECK(report.at("vertices") == 1201 * 2401);
  CHECK(report.at("raster_input").at("overlapping") == 1201);
  CHECK(report.at("raster_input").at("differing") == 133);
  CHECK(report.at("raster_input").at("largest_difference") == 1);
  CHECK(RunJson({"extract", store, out.File("c.ply"), "--error", "10"}).at("error_bound") <= 10);
  const Json helens = RunJson({"ingest", folder + "SainteHelens.dem", out.File("h.mtdb")});
  CHECK(helens.at("raster").at("columns") == 327);
  CHECK_THAT(helens.at("raster").at("crs").get<std::string>(), Catch::Contains("UTM zone 10N"));
}

TEST_CASE("a picture of a terrain in degrees shows it as long and as wide as it is", "[cli]") {
  const Folder folder;
  WriteHgt(folder.File("N60E007.hgt"), MakeHeights(31, 31, 1));
  const std::string store = folder.File("s.mtdb"), picture = folder.File("s.png");
  RunOk({"ingest", folder.File("N60E007.hgt"), store, "--name", "t"});
  RunOk({"render", store, picture, "--view", "top", "--size", "200x200", "--background",
         "transparent", "--full", "--no-legend"});
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  REQUIRE(png_image_begin_read_from_file(&png, picture.c_str()) != 0);
  png.format = PNG_FORMAT_RGBA;
  std::vector<uint8_t> pixels(PNG_IMAGE_SIZE(png));
  REQUIRE(png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr) != 0);
  std::set<size_t> columns, rows;
  for (size_t i = 0; i < 200 * 200; ++i) {
    if (pixels[4 * i + 3] < 128) continue;
    columns.insert(i % 200);
    rows.insert(i / 200);
  }
  // Half as wide as it is long, at 60 degrees north.
  CHECK(std::max(columns.size(), rows.size()) > 150);
  const double ratio = static_cast<double>(std::min(columns.size(), rows.size())) /
                       static_cast<double>(std::max(columns.size(), rows.size()));
  CHECK(ratio == Approx(0.5).margin(0.04));
  RunOk({"render", store, folder.File("e.png"), "--eye", "7.5,59,900", "--target", "7.5,60.5,0",
         "--frustum", "--pixels", "2", "--size", "120x90"});
}

// A terrain in degrees, and the same one in metres.
struct TwoUnits {
  Folder folder;
  static constexpr uint32_t kSide = 61;
  // A degree is 111,195 m along y, and cos 60.5 of that along x.
  const double metres = 111195 * std::cos(60.5 * std::numbers::pi / 180);

  TwoUnits() {
    const std::vector<double> heights = MakeHeights(kSide, kSide, 4);
    WriteHgt(folder.File("N60E007.hgt"), heights);
    char header[200];
    std::snprintf(header, sizeof(header),
                  "ncols 61\nnrows 61\nxllcenter 0\nyllcenter 0\ndx %.12g\ndy %.12g\n"
                  "NODATA_value -9999\n",
                  metres / 60, 111195.0 / 60);
    WriteGrid(folder.File("m.asc"), header, kSide, heights);
    RunOk({"ingest", folder.File("N60E007.hgt"), folder.File("d.mtdb")});
    RunOk({"ingest", folder.File("m.asc"), folder.File("m.mtdb")});
  }
  std::string Store(bool degrees) const { return folder.File(degrees ? "d.mtdb" : "m.mtdb"); }
  // Of parts of the tile's sides, and metres of height.
  std::string Place(double x, double y, double z, bool degrees) const {
    return Flat(x, y, degrees) + "," + std::to_string(z);
  }
  std::string Flat(double x, double y, bool degrees) const {
    char text[100];
    std::snprintf(text, sizeof(text), "%.12g,%.12g", degrees ? x + 7 : x * metres,
                  degrees ? y + 60 : y * 111195);
    return text;
  }
};

TEST_CASE("queries over degrees are those over metres: lengths are metres", "[cli]") {
  const TwoUnits t;
  const std::string query = t.folder.File("q.json");
  const auto triangles = [&](bool degrees, const std::function<std::string(bool)>& text) {
    WriteText(query, text(degrees));
    RunOk({"extract", t.Store(degrees), t.folder.File("x.ply"), "--query", query});
    const TriangleMesh mesh = ReadMesh(t.folder.File("x.ply"));
    std::vector<double> heights;
    for (const Vec3d& p : mesh.positions) heights.push_back(p.z);
    std::sort(heights.begin(), heights.end());
    return std::pair{mesh.triangles.size(), heights};
  };
  const auto at = [&](double x, double y, double z, bool d) {
    return "[" + t.Place(x, y, z, d) + "]";
  };
  // A direction in parts of the tile.
  const auto along = [&](double x, double y, bool d) {
    return std::to_string(d ? x : x * t.metres) + "," + std::to_string(d ? y : y * 111195);
  };
  using Text = std::function<std::string(bool)>;
  const std::string linear = R"({"linear": {"point": )";
  const auto camera = [&](bool d) {
    return R"({"eye": )" + at(0.2, -0.1, 6000, d) + R"(, "target": )" + at(0.6, 0.7, 500, d) +
           R"(, "fov": 30, "viewport": [400, 300], "far": 60000})";
  };
  const std::vector<Text> regions{
      [&](bool d) {
        return R"({"sphere": {"centre": )" + at(0.4, 0.6, 700, d) + R"(, "radius": 9000}})";
      },
      [&](bool d) { return R"({"frustum": )" + camera(d) + "}"; },
      [&](bool d) {
        return R"({"tube": {"line": [)" + at(0.1, 0.2, 800, d) + "," + at(0.8, 0.6, 800, d) +
               R"(], "radius": 3000}})";
      },
      [&](bool d) {
        return R"({"wedge": {"apex": [)" + t.Flat(0.3, 0.2, d) + R"(], "direction": [)" +
               along(1, 1, d) + R"(], "angle": 40, "far": 40000}})";
      },
      [&](bool d) {
        return R"({"box": {"min": )" + at(0.21, 0.33, 0, d) + R"(, "max": )" +
               at(0.47, 0.52, 2000, d) + "}}";
      },
      [&](bool d) {
        return R"({"prism": {"polygon": [[)" + t.Flat(0.1, 0.15, d) + "],[" + t.Flat(0.7, 0.25, d) +
               "],[" + t.Flat(0.3, 0.8, d) + "]]}}";
      },
      // The plane is the same: where directions are longer, normals are shorter.
      [&](bool d) {
        return R"({"outside": {"half_space": {"point": )" + at(0.5, 0.5, 0, d) +
               R"(, "normal": [)" + std::to_string(d ? 1 : 1e5 / t.metres) + "," +
               std::to_string(d ? 0.5 : 0.5e5 / 111195) + ", 0]}}}";
      },
  };
  const std::vector<Text> thresholds{
      [](bool) { return "5"; },
      [&](bool d) { return linear + at(0.3, 0.3, 700, d) + R"(, "base": 1, "slope": 0.002}})"; },
      [&](bool d) { return R"({"screen": {"pixels": 1.5, "camera": )" + camera(d) + "}}"; },
  };
  std::set<size_t> sizes;
  for (const Text& region : regions) {
    for (const Text& threshold : thresholds) {
      const Text text = [&](bool d) {
        return R"({"region": )" + region(d) + R"(, "threshold": )" + threshold(d) + "}";
      };
      CAPTURE(text(true));
      const auto found = triangles(true, text);
      CHECK(found == triangles(false, text));
      sizes.insert(found.first);
    }
  }
  CHECK(sizes.size() > 12);
  // Options say the same as JSON.
  const auto seen = [&](bool d) {
    return RunJson({"extract", t.Store(d), t.folder.File("o.ply"), "--pixels", "1", "--frustum",
                    "--eye=" + t.Place(0.2, -0.1, 6000, d),
                    "--target=" + t.Place(0.6, 0.7, 500, d)})
        .at("triangles");
  };
  CHECK(seen(true) == seen(false));
  CHECK(seen(true) > 100);
}

TEST_CASE("a terrain in degrees looks from --eye as the same terrain in metres does", "[cli]") {
  const TwoUnits t;
  const auto picture = [&](bool degrees, const std::string& exaggerate) {
    const std::string path = t.folder.File(degrees ? "d.png" : "m.png");
    RunOk({"render", t.Store(degrees), path, "--size", "120x90",
           "--eye=" + t.Place(0.5, -0.5, 40000, degrees),
           "--target=" + t.Place(0.5, 0.5, 500, degrees), "--exaggerate", exaggerate,
           "--no-legend"});
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    REQUIRE(png_image_begin_read_from_file(&png, path.c_str()) != 0);
    png.format = PNG_FORMAT_RGB;
    std::vector<uint8_t> pixels(PNG_IMAGE_SIZE(png));
    REQUIRE(png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr) != 0);
    return pixels;
  };
  const auto difference = [](const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += std::abs(double{1} * a[i] - b[i]);
    return sum / static_cast<double>(a.size());
  };
  const std::vector<uint8_t> flat = picture(true, "1");
  CHECK(difference(flat, picture(false, "1")) < 0.5);
  const std::vector<uint8_t> high = picture(true, "8");
  CHECK(difference(high, picture(false, "8")) < 0.5);
  CHECK(difference(flat, high) > 2);
  const Json info = RunJson({"info", t.Store(true)});
  CHECK(info.at("objects").at(0).at("raster").at("metres_of_unit").at(1) == 111195);
  CHECK(info.at("objects").at(0).at("raster").at("metres_of_unit").at(0).get<double>() ==
        Approx(t.metres));
  CHECK_THAT(RunOk({"render", t.Store(true), t.folder.File("map.png"), "--size", "80x80"}),
             Catch::Contains("colours: height in m"));
}

}  // namespace
}  // namespace mtdb::test
