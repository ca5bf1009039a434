// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/diff/place_files.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/request/report_json.h"

namespace mtdb {
namespace {

constexpr size_t kPlacesOfQuery = 2000;  // of each object; a query has at most 4096 regions
// Longitude, latitude; with the ellipsoid's heights.
constexpr int kWgs84 = 4326, kWgs84WithHeights = 4979;

// What `write` writes into a file of that name.
template <typename Write>
Status WriteFile(const std::string& path, const Write& write) {
  std::FILE* const file = std::fopen(path.c_str(), "w");
  if (file == nullptr) return IoError(path + ": cannot be written");
  write(file);
  const bool written = std::ferror(file) == 0;
  return std::fclose(file) == 0 && written ? Status::Ok() : IoError(path + ": cannot be written");
}

// Calls f("a" or "b", place).
template <typename F>
void ForEachPlace(const Comparison& found, const F& f) {
  for (const auto& [of, side] : {std::pair{"a", &found.a_to_b}, {"b", &found.b_to_a}}) {
    if (!*side) continue;
    for (const ComparePlace& place : (*side)->places) f(of, place);
  }
}

// JSON has no infinity.
Json LengthJson(double length) { return std::isfinite(length) ? Json(length) : Json(); }

Json FeatureOf(const char* of, const ComparePlace& place) {
  const Vec3d& min = place.box.min;
  const Vec3d& max = place.box.max;
  Json::Array ring;  // the outer one goes round against the clock
  for (const auto& [x, y] :
       {std::pair{min.x, min.y}, {max.x, min.y}, {max.x, max.y}, {min.x, max.y}, {min.x, min.y}}) {
    ring.push_back(Json::Array{x, y});
  }
  return {{"type", "Feature"},
          {"properties",
           {{"of", of},
            {"verdict", VerdictName(place.verdict)},
            {"missing", place.missing},
            {"low", LengthJson(place.distance.low)},
            {"high", LengthJson(place.distance.high)},
            {"x", place.point.x},
            {"y", place.point.y},
            {"z", place.point.z},
            {"min_z", min.z},
            {"max_z", max.z}}},
          {"geometry", {{"type", "Polygon"}, {"coordinates", Json::Array{std::move(ring)}}}}};
}

}  // namespace

Status WritePlacesCsv(const std::string& path, const Comparison& found) {
  return WriteFile(path, [&](std::FILE* file) {
    std::fprintf(file, "of,verdict,missing,low,high,x,y,z,min_x,min_y,min_z,max_x,max_y,max_z\n");
    ForEachPlace(found, [&](const char* of, const ComparePlace& p) {
      std::fprintf(file,
                   "%s,%s,%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n",
                   of, VerdictName(p.verdict), p.missing ? 1 : 0, p.distance.low, p.distance.high,
                   p.point.x, p.point.y, p.point.z, p.box.min.x, p.box.min.y, p.box.min.z,
                   p.box.max.x, p.box.max.y, p.box.max.z);
    });
  });
}

Status WritePlacesQuery(const std::string& path, const Comparison& found) {
  Json::Array boxes;
  for (const std::optional<OneSidedDistance>* side : {&found.a_to_b, &found.b_to_a}) {
    if (!*side) continue;
    const std::vector<ComparePlace>& places = (*side)->places;
    for (size_t i = 0; i < std::min(places.size(), kPlacesOfQuery); ++i) {
      const Box3d& box = places[i].box;
      boxes.push_back({{"box", {{"min", Json(box.min)}, {"max", Json(box.max)}}}});
    }
  }
  if (boxes.empty()) return Status::Ok();
  const Json query{
      {"region", {{"union", std::move(boxes)}}}, {"threshold", "full"}, {"clip", true}};
  return WriteFile(path, [&](std::FILE* file) { PrintJson(query, file); });
}

// The code of the whole stands last in WKT: ...,ID["EPSG",25832]] or
// ...,AUTHORITY["EPSG","25832"]].
std::optional<int> EpsgCodeOf(const std::string& georeference) {
  std::string text;
  for (const char c : georeference) {
    if (c != '"' && c != ' ' && c != '\n' && c != '\t' && c != '\r') text += c;
  }
  std::string_view digits = text;
  if (digits.starts_with("EPSG:")) {
    digits.remove_prefix(5);
  } else {
    if (!digits.ends_with("]]")) return std::nullopt;
    digits.remove_suffix(2);
    const size_t comma = digits.rfind(',');
    if (comma == std::string_view::npos) return std::nullopt;
    const std::string_view before = digits.substr(0, comma);
    if (!before.ends_with(",ID[EPSG") && !before.ends_with(",AUTHORITY[EPSG")) return std::nullopt;
    digits.remove_prefix(comma + 1);
  }
  int code = 0;
  const char* const end = digits.data() + digits.size();
  const auto [at, error] = std::from_chars(digits.data(), end, code);
  if (error != std::errc() || at != end || code <= 0) return std::nullopt;
  return code;
}

Status WritePlacesGeoJson(const std::string& path, const std::string& georeference,
                          const Comparison& found, std::string* note) {
  Json json{{"type", "FeatureCollection"}};
  const std::optional<int> code = EpsgCodeOf(georeference);
  if (!code) {
    *note = path +
            ": the coordinates are the object's own, of which it is not known where on Earth they "
            "are; GeoJSON takes them for degrees, so name the layer's reference system in QGIS";
  } else if (*code != kWgs84 && *code != kWgs84WithHeights) {
    const std::string name = "urn:ogc:def:crs:EPSG::" + std::to_string(*code);
    json["crs"] = Json{{"type", "name"}, {"properties", Json{{"name", name}}}};
  }
  Json::Array features;
  ForEachPlace(found, [&](const char* of, const ComparePlace& place) {
    features.push_back(FeatureOf(of, place));
  });
  json["features"] = std::move(features);
  return WriteFile(path, [&](std::FILE* file) { PrintJson(json, file); });
}

}  // namespace mtdb
