// SPDX-License-Identifier: Apache-2.0
// Rasters as GDAL's own tools write them: in, and out again as GeoTIFF, sample by sample.
#include <cstring>
#include <random>

#include "tests/tools/terrain_testing.h"

namespace mtdb::test {
namespace {

// Says so when it is missing.
bool HasGdal() {
  if (MTDB_TEST_GDAL != 0 && std::system("gdal_translate --version > /dev/null 2>&1") == 0) {
    return true;
  }
  WARN("skipped: without GDAL or gdal-bin");
  return false;
}

void Shell(const std::string& command) {
  INFO(command);
  REQUIRE(std::system((command + " > /dev/null 2>&1").c_str()) == 0);
}

std::string Quoted(const std::string& path) { return "'" + path + "'"; }

// The heights of a raster that GDAL reads, scaled, row after row; NaN where there is none.
std::vector<double> HeightsBy(const Folder& folder, const std::string& path) {
  const std::string raw = folder.File("raw.bin"), mask = folder.File("mask.bin");
  Shell("gdal_translate -q -unscale -ot Float64 -b 1 -of ENVI " + Quoted(path) + " " + Quoted(raw));
  Shell("gdal_translate -q -ot Byte -b mask -of ENVI " + Quoted(path) + " " + Quoted(mask));
  const std::string bytes = ReadText(raw), valid = ReadText(mask);
  std::vector<double> heights(bytes.size() / sizeof(double));
  REQUIRE(valid.size() == heights.size());
  std::memcpy(heights.data(), bytes.data(), bytes.size());
  for (size_t i = 0; i < heights.size(); ++i) {
    if (valid[i] == 0) heights[i] = kHole;
  }
  return heights;
}

void CheckSame(const std::vector<double>& found, const std::vector<double>& expected,
               double margin = 0) {
  REQUIRE(found.size() == expected.size());
  for (size_t i = 0; i < found.size(); ++i) {
    CAPTURE(i, found[i], expected[i]);
    REQUIRE(std::isnan(found[i]) == std::isnan(expected[i]));
    if (!std::isnan(found[i])) REQUIRE(std::abs(found[i] - expected[i]) <= margin);
  }
}

constexpr uint32_t kColumns = 83, kRows = 71;

// A grid in UTM, with a lake and a collar that are holes unless `full`.
std::string WriteSource(const Folder& folder, double unit = 1, bool full = false) {
  std::vector<double> heights = MakeHeights(kColumns, kRows, 5);
  for (uint32_t r = 0; r < kRows; ++r) {
    for (uint32_t c = 0; c < kColumns; ++c) {
      double& h = heights[r * kColumns + c];
      h = std::abs(h) + unit * ((c * 7 + r) % 4);
      const bool none = std::hypot(r - 30.0, c - 50.0) < 9 || c + 2 * r < 20;
      if (none && !full) h = kHole;
    }
  }
  const std::string path = folder.File("source.asc");
  std::ofstream out(path);
  out << "ncols 83\nnrows 71\nxllcorner 500000\nyllcorner 5100000\ncellsize 30\n"
         "NODATA_value -9999\n";
  for (size_t i = 0; i < heights.size(); ++i) {
    char text[40];
    std::snprintf(text, sizeof(text), "%.2f ", std::isnan(heights[i]) ? -9999.0 : heights[i]);
    out << text << (i % kColumns + 1 == kColumns ? "\n" : "");
  }
  return path;
}

// Ingests the file, takes it out again and compares; what `info` says of it.
Json ThereAndBack(const Folder& folder, const std::string& file, const Arguments& options = {},
                  double margin = 0) {
  const std::string store = folder.File("s.mtdb"), back = folder.File("back.tif");
  Arguments ingest{"ingest", file, store, "--replace", "--name", "t"};
  ingest.insert(ingest.end(), options.begin(), options.end());
  const Json report = RunJson(ingest);
  RunOk({"extract", store, back});
  CheckSame(HeightsBy(folder, back), HeightsBy(folder, file), margin);
  return report.at("raster");
}

TEST_CASE("GeoTIFFs of all sample types and compressions come back sample by sample", "[cli]") {
  if (!HasGdal()) return;
  const Folder folder;
  const std::string source = WriteSource(folder), tif = folder.File("in.tif");
  for (const std::string creation :
       {"-ot Int16", "-ot Int16 -co TILED=YES -co BLOCKXSIZE=32 -co BLOCKYSIZE=16",
        "-ot UInt16 -a_nodata 65535", "-ot Int32 -co COMPRESS=LZW -co PREDICTOR=2",
        "-ot UInt32 -a_nodata 0", "-ot Int16 -co COMPRESS=DEFLATE -co PREDICTOR=2",
        "-ot Int16 -co COMPRESS=ZSTD", "-ot Int16 -co COMPRESS=LERC -co MAX_Z_ERROR=0",
        "-ot Int16 -co COMPRESS=LERC_DEFLATE", "-ot Int16 -co BIGTIFF=YES -co INTERLEAVE=BAND",
        "-ot Int16 -of COG -co BLOCKSIZE=128 -co COMPRESS=LZW", "-ot Int16 -mo AREA_OR_POINT=Point",
        "-ot Int16 -co ENDIANNESS=BIG"}) {
    CAPTURE(creation);
    const size_t compress = creation.find("COMPRESS=");
    const std::string name =
        compress == std::string::npos
            ? ""
            : creation.substr(compress + 9, creation.find(' ', compress) - compress - 9);
    const std::string known = "gdalinfo --format GTiff | grep -q '<Value>" + name + "</Value>'";
    if (!name.empty() && std::system(known.c_str()) != 0) {
      WARN("skipped: this GDAL has no " << name);
      continue;
    }
    Shell("gdal_translate -q " + creation + " " + Quoted(source) + " " + Quoted(tif));
    const Json raster = ThereAndBack(folder, tif);
    CHECK(raster.at("columns") == kColumns);
    CHECK(raster.at("area_or_point") ==
          (creation.find("Point") == std::string::npos ? "Area" : "Point"));
    CHECK(raster.at("geotransform") ==
          Json::array({500000.0, 30.0, 0.0, 5100000.0 + 30 * kRows, 0.0, -30.0}));
  }
}

TEST_CASE("GeoTIFFs of floats come back as exactly as the step", "[cli]") {
  if (!HasGdal()) return;
  const Folder folder;
  const std::string source = WriteSource(folder, 0.37), tif = folder.File("in.tif");
  for (const std::string creation : {"-ot Float32 -co COMPRESS=DEFLATE -co PREDICTOR=3",
                                     "-ot Float64 -co TILED=YES -co COMPRESS=LZW",
                                     "-ot Float32 -a_nodata nan -co COMPRESS=LERC"}) {
    CAPTURE(creation);
    Shell("gdal_translate -q " + creation + " " + Quoted(source) + " " + Quoted(tif));
    ThereAndBack(folder, tif, {"--height-step", "0.01"}, 0.0051);
  }
  // Its heights are decimals all the same.
  CHECK(RunJson({"info", tif}).at("height_step_reason") == "decimals");
  CHECK(RunJson({"info", tif}).at("height_step") == 0.01);
}

TEST_CASE("scale and offset of a GeoTIFF give its heights", "[cli]") {
  if (!HasGdal()) return;
  const Folder folder;
  const std::string source = WriteSource(folder), tif = folder.File("in.tif");
  Shell("gdal_translate -q -ot Int16 -a_scale 0.25 -a_offset 100 " + Quoted(source) + " " +
        Quoted(tif));
  const Json report = RunJson({"ingest", tif, folder.File("own.mtdb")});
  CHECK(report.at("step") == 0.25);
  CHECK(report.at("rounding_error") == 0);
  ThereAndBack(folder, tif, {}, 1e-9);
}

TEST_CASE("a mask makes holes as nodata does", "[cli]") {
  if (!HasGdal()) return;
  const Folder folder;
  const std::string source = WriteSource(folder), tif = folder.File("in.tif");
  Shell(
      "gdal_translate -q -ot Int16 -a_nodata none -b 1 -mask mask --config "
      "GDAL_TIFF_INTERNAL_MASK YES " +
      Quoted(source) + " " + Quoted(tif));
  ThereAndBack(folder, tif);
}

TEST_CASE("USGS DEM and VRT mosaics come back sample by sample", "[cli]") {
  if (!HasGdal()) return;
  const Folder folder;
  const std::string source = WriteSource(folder, 1, true);
  // GDAL's writer wants a coordinate system and whole arc seconds or metres.
  const std::string dem = folder.File("in.dem");
  Shell("gdal_translate -q -ot Int16 -a_srs EPSG:32610 -of USGSDEM -co ZRESOLUTION=1.0 " +
        Quoted(source) + " " + Quoted(dem));
  // Columns of a DEM may be of different lengths, so that GDAL gives it more rows than it has.
  RunOk({"ingest", dem, folder.File("dem.mtdb")});
  RunOk({"extract", folder.File("dem.mtdb"), folder.File("dem.tif")});
  CheckSame(HeightsBy(folder, folder.File("dem.tif")), HeightsBy(folder, source));
  const std::string west = folder.File("w.tif"), east = folder.File("e.tif"),
                    vrt = folder.File("both.vrt");
  Shell("gdal_translate -q -ot Int16 -srcwin 0 0 50 71 " + Quoted(source) + " " + Quoted(west));
  Shell("gdal_translate -q -ot Int16 -srcwin 40 0 43 71 " + Quoted(source) + " " + Quoted(east));
  Shell("gdalbuildvrt -q " + Quoted(vrt) + " " + Quoted(west) + " " + Quoted(east));
  ThereAndBack(folder, vrt);
  // The same by mtdb's own joining.
  const std::string store = folder.File("s.mtdb");
  const Json report = RunJson({"ingest", west, east, store, "--name", "own"});
  CHECK(report.at("raster_input").at("overlapping") == 10 * kRows);
  CHECK(report.at("raster_input").at("differing") == 0);
  RunOk({"extract", store, folder.File("own.tif"), "--name", "own"});
  CheckSame(HeightsBy(folder, folder.File("own.tif")), HeightsBy(folder, source));
}

TEST_CASE("a turned geotransform and half pixels put samples where GDAL has them", "[cli]") {
  if (!HasGdal()) return;
  const Folder folder;
  const std::string source = WriteSource(folder), tif = folder.File("in.tif"),
                    vrt = folder.File("turned.vrt"), store = folder.File("s.mtdb");
  Shell("gdal_translate -q -ot Int16 " + Quoted(source) + " " + Quoted(tif));
  const std::vector<double> heights = HeightsBy(folder, tif);
  for (const bool point : {false, true}) {
    std::string text =
        "<VRTDataset rasterXSize=\"83\" rasterYSize=\"71\">"
        "<GeoTransform>500000, 24, 18, 5100000, 18, -24</GeoTransform>";
    if (point) text += "<Metadata><MDI key=\"AREA_OR_POINT\">Point</MDI></Metadata>";
    text +=
        "<VRTRasterBand dataType=\"Int16\" band=\"1\"><NoDataValue>-9999</NoDataValue>"
        "<SimpleSource><SourceFilename>" +
        tif +
        "</SourceFilename><SourceBand>1</SourceBand></SimpleSource>"
        "</VRTRasterBand></VRTDataset>";
    WriteText(vrt, text);
    RunOk({"ingest", vrt, store, "--replace", "--name", "t"});
    std::string places;
    std::vector<double> expected;
    std::mt19937 random(3);
    for (int i = 0; i < 200; ++i) {
      const uint32_t column = random() % kColumns, row = random() % kRows;
      char place[100];
      // GDAL's transform is of pixels' corners, whatever a sample stands for.
      std::snprintf(place, sizeof(place), "%.12g,%.12g\n",
                    500000 + 24 * (column + 0.5) + 18 * (row + 0.5),
                    5100000 + 18 * (column + 0.5) - 24 * (row + 0.5));
      places += place;
      expected.push_back(heights[row * kColumns + column]);
    }
    WriteText(folder.File("places"), places);
    const Json found = RunJson({"probe", store, "--heights", folder.File("places")}).at("heights");
    REQUIRE(found.size() == expected.size());
    for (size_t i = 0; i < expected.size(); ++i) {
      const Json& height = found.at(i).at("height");
      CAPTURE(i);
      if (std::isnan(expected[i])) {
        CHECK(height.is_null());
      } else {
        REQUIRE(!height.is_null());
        CHECK(height == Approx(expected[i]).margin(1e-6));
      }
    }
    // As a raster of its own only at a spacing.
    CHECK_THAT(Run({"extract", store, folder.File("x.tif")}).err, Catch::Contains("spacing"));
  }
}

}  // namespace
}  // namespace mtdb::test
