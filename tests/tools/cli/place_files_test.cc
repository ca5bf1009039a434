// SPDX-License-Identifier: Apache-2.0
// Places of comparisons in files; how they leave the program is in cli_diff_test.cc.
#include "tools/cli/diff/place_files.h"

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

TEST_CASE("the EPSG code of a reference system is that of the whole, or none", "[cli]") {
  CHECK(EpsgCodeOf("EPSG:25832") == 25832);
  CHECK(EpsgCodeOf("PROJCRS[\"x\",BASEGEOGCRS[\"y\",ID[\"EPSG\",4258]],ID[\"EPSG\",25832]]") ==
        25832);
  CHECK(EpsgCodeOf(
            "PROJCS[\"x\",AUTHORITY[\"EPSG\",\"9001\"]],\n  AUTHORITY[\"EPSG\", \"25832\"]]\n") ==
        25832);
  CHECK(EpsgCodeOf("GEOGCRS[\"WGS 84\",CS[ellipsoidal,2],ID[\"EPSG\",4326]]") == 4326);
  // Only a part has a code, or nobody has.
  for (const char* const none :
       {"", "EPSG:", "EPSG:x", "EPSG:0", "EPSG:-3", "EPSG:99999999999", "WGS 84", "]]", ",]]",
        "PROJCRS[\"x\",BASEGEOGCRS[\"y\",ID[\"EPSG\",4258]]]",
        "COMPOUNDCRS[\"x\",PROJCRS[\"y\",ID[\"EPSG\",25832]],VERTCRS[\"z\",ID[\"EPSG\",5773]]]",
        "PROJCRS[\"x\",ID[\"ESRI\",102003]]", "PROJCRS[\"x\",ID[\"EPSG\",]]"}) {
    INFO(none);
    CHECK_FALSE(EpsgCodeOf(none));
  }
}

Comparison TwoPlaces() {
  Comparison found;
  ComparePlace place{{{500000, 5500000, 1}, {500010, 5500020, 3}},
                     {500004, 5500006, 2},
                     {1.5, std::numeric_limits<double>::infinity()},
                     CompareVerdict::kExceeds,
                     true};
  found.a_to_b.emplace().places = {place};
  place.verdict = CompareVerdict::kUndecided;
  place.distance = {0, 0.25};
  place.missing = false;
  found.b_to_a.emplace().places = {place};
  return found;
}

TEST_CASE("places are polygons in GeoJSON, with what is known of them", "[cli]") {
  const Folder folder;
  const std::string path = folder.File("places.geojson");
  std::string note;
  REQUIRE(WritePlacesGeoJson(path, "EPSG:25832", TwoPlaces(), &note).ok());
  CHECK(note.empty());
  const Json json = ParseJson(ReadText(path));
  CHECK(json.at("type") == "FeatureCollection");
  CHECK(json.at("crs") == ParseJson(R"({"type": "name", "properties":
                                       {"name": "urn:ogc:def:crs:EPSG::25832"}})"));
  REQUIRE(json.at("features").size() == 2);
  const Json& first = json.at("features").at(0);
  CHECK(first == ParseJson(R"({"type": "Feature",
    "properties": {"of": "a", "verdict": "exceeds", "missing": true, "low": 1.5, "high": null,
                   "x": 500004, "y": 5500006, "z": 2, "min_z": 1, "max_z": 3},
    "geometry": {"type": "Polygon", "coordinates": [[[500000, 5500000], [500010, 5500000],
      [500010, 5500020], [500000, 5500020], [500000, 5500000]]]}})"));
  const Json& second = json.at("features").at(1).at("properties");
  CHECK(second.at("of") == "b");
  CHECK(second.at("verdict") == "undecided");
  CHECK(second.at("high") == 0.25);
}

TEST_CASE("GeoJSON tells where its coordinates are, or a note does", "[cli]") {
  const Folder folder;
  const std::string path = folder.File("places.geojson");
  const auto written = [&](const std::string& georeference, std::string* note) {
    note->clear();
    REQUIRE(WritePlacesGeoJson(path, georeference, TwoPlaces(), note).ok());
    return ParseJson(ReadText(path));
  };
  std::string note;
  CHECK_FALSE(written("EPSG:4326", &note).contains("crs"));
  CHECK(note.empty());
  CHECK_FALSE(written("GEOGCRS[\"WGS 84\",ID[\"EPSG\",4979]]", &note).contains("crs"));
  CHECK(note.empty());
  CHECK_FALSE(written("", &note).contains("crs"));
  CHECK_THAT(note, Catch::StartsWith(path) && Catch::Contains("QGIS"));
  CHECK_FALSE(written("LOCAL_CS[\"quarry\"]", &note).contains("crs"));
  CHECK_FALSE(note.empty());
  CHECK_FALSE(WritePlacesGeoJson(folder.File("none/x.geojson"), "", TwoPlaces(), &note).ok());
  if (std::system("ogrinfo --version > /dev/null 2>&1") != 0) return;
  // What GDAL, and so QGIS, makes of it.
  written("EPSG:25832", &note);
  const std::string told = folder.File("told");
  REQUIRE(std::system(("ogrinfo -al '" + path + "' > '" + told + "'").c_str()) == 0);
  CHECK_THAT(ReadText(told), Catch::Contains("ETRS89 / UTM zone 32N") &&
                                 Catch::Contains("Feature Count: 2") &&
                                 Catch::Contains("POLYGON ((500000 5500000"));
}

}  // namespace
}  // namespace mtdb::test
