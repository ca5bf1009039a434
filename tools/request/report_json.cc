// SPDX-License-Identifier: Apache-2.0
#include "tools/request/report_json.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "query/heights.h"
#include "store/base/redact.h"
#include "store/base/scalar_names.h"
#include "store/texture_pages.h"
#include "tools/request/root_reason.h"

namespace mtdb {

namespace {

Json AttributesJson(const ObjectRecord& r) {
  Json attributes = Json::Array();
  for (const VertexAttribute& a : r.attributes.attributes) {
    Json& json = attributes.push_back({{"name", a.name}, {"type", ScalarName(a.type)}});
    if (a.step > 0) json["step"] = a.step;
    if (a.normal_bits > 0) json["normal_bits"] = a.normal_bits;
  }
  return attributes;
}

// JSON has no infinity.
Json LengthJson(double length) { return std::isfinite(length) ? Json(length) : Json(); }

Json IntervalJson(const DistanceInterval& interval) {
  return {{"low", LengthJson(interval.low)}, {"high", LengthJson(interval.high)}};
}

Json IntervalJson(const ValueInterval& interval) {
  return {{"low", LengthJson(interval.low)}, {"high", LengthJson(interval.high)}};
}

Json LargestChangeJson(const LargestChange& change) {
  Json json = {{"height", IntervalJson(change.height)}};
  if (change.point) json["point"] = Json(*change.point);
  return json;
}

Json OneSidedJson(const OneSidedDistance& side) {
  Json json = {{"distance", IntervalJson(side.distance)}, {"verdict", VerdictName(side.verdict)}};
  if (side.point) json["point"] = Json(*side.point);
  json["places"] = Json::Array();
  for (const ComparePlace& place : side.places) {
    json["places"].push_back({{"box", {{"min", Json(place.box.min)}, {"max", Json(place.box.max)}}},
                              {"point", Json(place.point)},
                              {"distance", IntervalJson(place.distance)},
                              {"verdict", VerdictName(place.verdict)},
                              {"missing", place.missing}});
  }
  return json;
}

Json InputJson(const InputReport& in) {
  return {{"vertices", in.vertices},
          {"triangles", in.triangles},
          {"unreferenced_vertices", in.unreferenced_vertices},
          {"degenerate_triangles", in.degenerate_triangles},
          {"duplicate_triangles", in.duplicate_triangles},
          {"two_sided_triangles", in.two_sided_triangles},
          {"nonmanifold_edges", in.nonmanifold_edges},
          {"nonmanifold_vertices", in.nonmanifold_vertices},
          {"inconsistent_edges", in.inconsistent_edges},
          {"turned_triangles", in.turned_triangles},
          {"unorientable_sheets", in.unorientable_sheets}};
}

Json TextureJson(const TextureRecord& t) {
  Json pages = Json::Array();
  for (const TextureRecord::Page& page : t.pages) {
    pages.push_back({{"name", page.name},
                     {"media_type", page.media_type},
                     {"width", page.width},
                     {"height", page.height},
                     {"bytes", page.bytes}});
  }
  return {{"step", t.step},
          {"scale", t.scale},
          {"rounding", t.rounding},
          {"pages", pages},
          {"tiles_bytes", t.tiles.bytes}};
}

Json RoundsJson(const ObjectRecord& r) {
  Json rounds = Json::Array();
  for (const RoundReport& round : r.rounds) {
    rounds.push_back({{"triangles_in", round.triangles_in},
                      {"triangles_out", round.triangles_out},
                      {"tiles", round.tiles},
                      {"clusters", round.clusters},
                      {"nodes", round.nodes},
                      {"locked_vertices", round.locked_vertices},
                      {"stuck_topology", round.stuck_topology},
                      {"stuck_degree", round.stuck_degree},
                      {"error_max", r.grid.Error(round.error_code_max)}});
  }
  return rounds;
}

}  // namespace

double BitsPerVertex(const ObjectRecord& r) {
  if (r.vertices == 0) return 0;
  const uint64_t bytes = r.stored_bytes - std::min(r.stored_bytes, TextureBytes(r));
  return 8.0 * static_cast<double>(bytes) / static_cast<double>(r.vertices);
}

Json RasterJson(const RasterFrame& f, const std::string& crs) {
  Json json = {{"columns", f.columns},
               {"rows", f.rows},
               {"geotransform", f.geotransform},
               {"transform_of", f.transform_of_samples ? "samples" : "pixel corners"},
               {"area_or_point", f.is_area ? "Area" : "Point"},
               {"sample_type", f.sample_type},
               {"height_units", f.height_units},
               {"vertical_datum", f.vertical_datum},
               {"filled", f.filled},
               {"crs", crs}};
  if (f.nodata) json["nodata"] = *f.nodata;
  return json;
}

Json RecordJson(const ObjectRecord& r, uint64_t file_bytes) {
  const bool lossless = r.grid.mode == PositionMode::kLossless;
  Json json = {
      {"object", r.name},
      {"vertices", r.vertices},
      {"triangles", r.triangles},
      {"components", r.components},
      {"boundary_edges", r.boundary_edges},
      {"boundary_loops", r.boundary_loops},
      {"euler_characteristic", r.euler_characteristic},
      {"input", InputJson(r.input)},
      {"attributes", AttributesJson(r)},
      {"digest", r.digest_hex()},
      {"bounds", {{"min", Json(r.bounds.min)}, {"max", Json(r.bounds.max)}}},
      {"diagonal", r.diagonal()},
      {"positions", lossless   ? "float32"
                    : r.raster ? "raster"
                               : "grid"},
      {"bits", r.bits},
      {"step", lossless ? 0.0 : r.grid.step},
      {"rounding_error", r.rounding_error},
      {"error_measure", r.error_measure == ErrorMeasure::kVertical ? "vertical" : "distance"},
      {"rounds", RoundsJson(r)},
      {"clusters", r.clusters},
      {"nodes", r.nodes},
      {"root_pieces", r.root_pieces},
      {"root_vertices", r.root_vertices},
      {"root_triangles", r.root_triangles},
      {"root_reason", RootReasonText(r)},
      {"depth", r.depth},
      {"max_degree", r.max_degree},
      {"file_bytes", file_bytes},
      {"stored_bytes", r.stored_bytes},
      {"payload_bytes", r.payload_bytes},
      {"bits_per_vertex", BitsPerVertex(r)},
      {"error_max", r.grid.Error(r.error_code_max)},
      {"units", r.units},
  };
  if (r.texture) json["texture"] = TextureJson(*r.texture);
  if (r.up) {
    json["up"] = Json(r.up->direction);
    json["up_given"] = r.up->given;
  }
  if (r.raster) {
    json["raster"] = RasterJson(*r.raster, r.georeference);
    json["raster"]["metres_of_unit"] = MetresOfUnit(r);
  }
  return json;
}

Json CatalogJson(const std::vector<ObjectRecord>& records) {
  Json objects = Json::Array();
  for (const ObjectRecord& r : records) {
    objects.push_back({{"object", r.name}, {"triangles", r.triangles}, {"vertices", r.vertices}});
  }
  return {{"objects", objects}};
}

Json ProbeJson(const ObjectRecord& record, const ProbeAnswer& answer, bool ray) {
  Json json = {{"object", record.name}, {"hit", answer.hit.has_value()}};
  if (answer.hit) {
    json["point"] = Json(answer.hit->point);
    json["distance"] = answer.hit->distance;
    if (ray) json["parameter"] = answer.hit->parameter;
    json["front"] = answer.hit->front;
    json["triangle"] = Json::Array();
    for (const Vec3d& p : answer.hit->triangle) json["triangle"].push_back(Json(p));
    json["error_bound"] = answer.error_bound;
    json["excess"] = answer.excess;
  }
  json["queries"] = answer.queries;
  json["clusters_read"] = answer.clusters_read;
  json["clusters_total"] = record.clusters;
  json["bytes_read"] = answer.bytes_read;
  return json;
}

const char* VerdictName(CompareVerdict verdict) {
  switch (verdict) {
    case CompareVerdict::kWithin: return "within";
    case CompareVerdict::kExceeds: return "exceeds";
    case CompareVerdict::kUndecided: return "undecided";
  }
  return "";
}

Json ComparisonJson(const ObjectRecord& a, const ObjectRecord& b, const Comparison& comparison) {
  Json json = {{"object", a.name},
               {"other", b.name},
               {"identical", comparison.identical},
               {"verdict", VerdictName(comparison.verdict)},
               {"distance", IntervalJson(comparison.distance)},
               {"out_of_time", comparison.out_of_time},
               {"out_of_memory", comparison.out_of_memory}};
  if (comparison.a_to_b) json["a_to_b"] = OneSidedJson(*comparison.a_to_b);
  if (comparison.b_to_a) json["b_to_a"] = OneSidedJson(*comparison.b_to_a);
  json["triangles"] = comparison.triangles;
  json["clusters_read"] = comparison.clusters_read;
  json["clusters_total"] = comparison.clusters_total;
  json["bytes_read"] = comparison.bytes_read;
  return json;
}

Json HeightChangeJson(const ObjectRecord& a, const ObjectRecord& b, const HeightChange& change) {
  Json json = {{"object", a.name},
               {"other", b.name},
               {"identical", change.identical},
               {"verdict", VerdictName(change.verdict)},
               {"rise", LargestChangeJson(change.rise)},
               {"fall", LargestChangeJson(change.fall)},
               {"fill_volume", IntervalJson(change.fill_volume)},
               {"cut_volume", IntervalJson(change.cut_volume)},
               {"net_volume", IntervalJson(change.net_volume)},
               {"area_both", IntervalJson(change.area_both)},
               {"area_a", IntervalJson(change.area_a)},
               {"area_b", IntervalJson(change.area_b)},
               {"metres_of_unit", MetresOfUnit(a)},
               {"out_of_time", change.out_of_time},
               {"triangles", change.triangles},
               {"clusters_read", change.clusters_read},
               {"clusters_total", change.clusters_total},
               {"bytes_read", change.bytes_read}};
  return json;
}

const char* LimitName(QueryLimit limit) {
  switch (limit) {
    case QueryLimit::kThreshold: return "accuracy";
    case QueryLimit::kTriangles: return "triangles";
    case QueryLimit::kBytes: return "bytes";
    case QueryLimit::kTime: return "time";
    case QueryLimit::kMissing: return "missing";
  }
  return "unknown";
}

const char* LimitText(QueryLimit limit) {
  switch (limit) {
    case QueryLimit::kThreshold: return "the accuracy that was asked for was reached";
    case QueryLimit::kTriangles: return "the limit of triangles ended the refinement";
    case QueryLimit::kBytes: return "the limit of bytes to be read ended the refinement";
    case QueryLimit::kTime: return "the limit of time ended the refinement";
    case QueryLimit::kMissing: return "clusters that are not in memory ended the refinement";
  }
  return "unknown";
}

Json ChecksJson(const CheckReport& report) {
  return {{"ok", report.ok()}, {"checks", report.checks}, {"failures", report.failures}};
}

namespace {

// Files and URLs as they were given, and messages.
bool MayHaveSecrets(const std::string& key) {
  constexpr std::array<std::string_view, 13> kKeys{
      "store",  "target",   "url",      "output", "input",    "inputs", "file",
      "source", "failures", "warnings", "notes",  "journals", "message"};
  return std::ranges::find(kKeys, key) != kKeys.end();
}

void TakeSecrets(Json& json, bool any_string) {
  if (const std::string* const text = json.string()) {
    if (any_string) json = WithoutSecrets(*text);
  } else if (json.is_array()) {
    for (Json& element : json.elements()) TakeSecrets(element, any_string);
  } else if (json.is_object()) {
    for (auto& [key, value] : json.members()) TakeSecrets(value, any_string || MayHaveSecrets(key));
  }
}

}  // namespace

void PrintAnswer(const char* answer, const Json& json, std::FILE* to) {
  constexpr const char* kVersion = "/1";
  Json whole = {{"schema", std::string("mtdb/") + answer + kVersion}};
  whole.Update(json);
  TakeSecrets(whole, false);
  PrintJson(whole, to);
}

void PrintJson(const Json& json, std::FILE* to) {
  const std::string text = json.Text(Json::Form::kLines);
  std::fprintf(to, "%s\n", text.c_str());
}

}  // namespace mtdb
