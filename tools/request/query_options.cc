// SPDX-License-Identifier: Apache-2.0
#include "tools/request/query_options.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "query/query_from_json.h"
#include "tools/request/read_file.h"

namespace mtdb {

namespace {

using Numbers = std::vector<double>;

Json PointAt(const Numbers& n, size_t i) { return Json::Array{n[i], n[i + 1], n[i + 2]}; }

// What the numbers mean is checked where JSON is.
Result<Json> Checked(const std::string& text, Json part, const Status& status) {
  if (status.ok()) return part;
  return InvalidArgument(status.message() + ", in '" + text + "'");
}

Result<Json> CheckedRegion(const std::string& text, Json region) {
  const Status status = RegionFromJson(region).status();
  return Checked(text, std::move(region), status);
}

Json ThresholdOf(const AskedError& error) {
  return error.relative ? Json{{"relative", error.value}} : Json(error.value);
}

// One part as it is, several as the list of a part that puts them together.
Json Together(const char* key, Json::Array parts) {
  if (parts.size() == 1) return std::move(parts[0]);
  return {{key, Json(std::move(parts))}};
}

Result<Json> ReadQueryFile(const std::string& path) {
  constexpr uint64_t kMostBytes = uint64_t{64} << 20;
  MTDB_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMostBytes));
  Result<Json> json = ParseQueryText(text);
  if (!json.ok()) return Status(json.status().code(), path + ": " + json.status().message());
  return json;
}

Result<Json> BoxOption(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const Numbers n, ParseNumbers(text, 6, "X0,Y0,Z0,X1,Y1,Z1"));
  // Any two opposite corners.
  Numbers least(3), most(3);
  for (size_t i = 0; i < 3; ++i) {
    least[i] = std::min(n[i], n[i + 3]);
    most[i] = std::max(n[i], n[i + 3]);
  }
  return CheckedRegion(text, {{"box", {{"min", PointAt(least, 0)}, {"max", PointAt(most, 0)}}}});
}

Result<Json> SphereOption(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const Numbers n, ParseNumbers(text, 4, "X,Y,Z,R"));
  return CheckedRegion(text, {{"sphere", {{"centre", PointAt(n, 0)}, {"radius", n[3]}}}});
}

Result<Json> HalfSpaceOption(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const Numbers n, ParseNumbers(text, 6, "X,Y,Z,NX,NY,NZ"));
  return CheckedRegion(text,
                       {{"half_space", {{"point", PointAt(n, 0)}, {"normal", PointAt(n, 3)}}}});
}

Result<Json> PointRegionOption(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const Vec3d point, ParsePoint(text));
  return CheckedRegion(text, {{"point", Json(point)}});
}

Result<Json> SegmentOption(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const Numbers n, ParseNumbers(text, 6, "X0,Y0,Z0,X1,Y1,Z1"));
  return CheckedRegion(text, {{"segment", {{"from", PointAt(n, 0)}, {"to", PointAt(n, 3)}}}});
}

Result<Json> TubeOption(const std::string& text) {
  const std::string form = "R,X0,Y0,Z0,X1,Y1,Z1,...";
  MTDB_ASSIGN_OR_RETURN(const Numbers n, ParseList(text, form));
  if (n.size() < 4 || n.size() % 3 != 1) {
    return Unexpected(text, form + ": a radius and points of three numbers");
  }
  Json line = Json::Array();
  for (size_t i = 1; i < n.size(); i += 3) line.push_back(PointAt(n, i));
  return CheckedRegion(text, {{"tube", {{"line", line}, {"radius", n[0]}}}});
}

Result<Json> PrismOption(const std::string& text) {
  const std::string form = "X0,Y0,X1,Y1,X2,Y2,...";
  MTDB_ASSIGN_OR_RETURN(const Numbers n, ParseList(text, form));
  if (n.size() < 6 || n.size() % 2 != 0) {
    return Unexpected(text, form + ": at least three corners of two numbers");
  }
  Json polygon = Json::Array();
  for (size_t i = 0; i < n.size(); i += 2) polygon.push_back({n[i], n[i + 1]});
  return CheckedRegion(text, {{"prism", {{"polygon", polygon}}}});
}

Result<Json> WedgeOption(const std::string& text) {
  const std::string form = "X,Y,DX,DY,ANGLE[,FAR]";
  MTDB_ASSIGN_OR_RETURN(const Numbers n, ParseList(text, form));
  if (n.size() != 5 && n.size() != 6) return Unexpected(text, "5 or 6 numbers " + form);
  Json wedge = {{"apex", {n[0], n[1]}}, {"direction", {n[2], n[3]}}, {"angle", n[4]}};
  if (n.size() == 6) wedge["far"] = n[5];
  return CheckedRegion(text, {{"wedge", wedge}});
}

constexpr RegionOption kRegionOptions[] = {
    {"--box", "X0,Y0,Z0,X1,Y1,Z1", BoxOption, "a box, by two corners"},
    {"--sphere", "X,Y,Z,R", SphereOption, "a ball, by centre and radius"},
    {"--half-space", "X,Y,Z,NX,NY,NZ", HalfSpaceOption,
     "what is behind the plane through X,Y,Z that faces NX,NY,NZ"},
    {"--prism", "X0,Y0,X1,Y1,...", PrismOption, "above and below a polygon"},
    {"--wedge", "X,Y,DX,DY,ANGLE[,FAR]", WedgeOption,
     "above and below a wedge at X,Y that looks along DX,DY, ANGLE degrees wide"},
    {"--point", "X,Y,Z", PointRegionOption, "a point"},
    {"--segment", "X0,Y0,Z0,X1,Y1,Z1", SegmentOption, "a segment: a line of sight"},
    {"--tube", "R,X0,Y0,Z0,X1,Y1,Z1,...", TubeOption, "what is within R of a line through points"},
};

}  // namespace

std::span<const RegionOption> RegionOptions() { return kRegionOptions; }

Result<Json> ParseQueryText(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(Json json, Json::Parse(text, kDeepestQuery));
  MTDB_RETURN_IF_ERROR(QueryFromJson(json, 0).status());
  return json;
}

Result<Json> ErrorAtOption(const std::string& text) {
  // A law, its key, and that of its last number.
  constexpr const char* kLaws[][3] = {{"linear", "linear", "slope"},
                                      {"quadratic", "quadratic", "factor"},
                                      {"sqrt", "square_root", "factor"},
                                      {"exp", "exponential", "rate"}};
  const size_t comma = text.find(',');
  for (const auto& law : kLaws) {
    if (comma == std::string::npos || text.substr(0, comma) != law[0]) continue;
    const Result<Numbers> numbers = ParseNumbers(text.substr(comma + 1), 5, "");
    if (!numbers.ok()) return Unexpected(text, "5 numbers after the law: LAW,X,Y,Z,BASE,F");
    const Numbers& n = *numbers;
    Json part = {{law[1], {{"point", PointAt(n, 0)}, {"base", n[3]}, {law[2], n[4]}}}};
    const Status status = ThresholdFromJson(part, 0).status();
    return Checked(text, std::move(part), status);
  }
  return Unexpected(text, "linear, quadratic, sqrt or exp, and numbers: LAW,X,Y,Z,BASE,F");
}

Status CheckOptions(const QueryOptions& o, bool draws) {
  const bool region = o.frustum || !o.regions.empty();
  const bool threshold = o.full || o.error || o.pixels || o.error_outside || !o.errors_at.empty();
  const auto wrong = [](const std::string& option, const char* why) {
    return InvalidArgument(option + ": " + why);
  };
  if (!o.file.empty()) {
    if (region || threshold || o.intersect || o.outside) {
      return wrong("--query",
                   "its file holds region and threshold: give no other options for them");
    }
    if (o.eye && !draws) return wrong("--eye", "does not go with --query: its file has cameras");
  } else {
    constexpr const char* kNeedsRegion = "needs a region: give --box, --sphere or another";
    if (o.clip && !region) return wrong("--clip", kNeedsRegion);
    if (o.error_outside && !region) return wrong("--error-outside", kNeedsRegion);
    if (o.intersect && !region) return wrong("--intersect", kNeedsRegion);
    if (o.outside && !region) return wrong("--outside", kNeedsRegion);
    if (o.error_outside && o.clip) {
      return wrong("--error-outside", "does not go with --clip: it asks for what is outside");
    }
  }
  if (!o.has_camera()) {
    constexpr const char* kNeedsCamera = "needs a camera: give --eye and --target";
    if (o.frustum) return wrong("--frustum", kNeedsCamera);
    if (o.pixels) return wrong("--pixels", kNeedsCamera);
    if (o.eye) return wrong("--eye", kNeedsCamera);
    if (o.target) return wrong("--target", kNeedsCamera);
    if (o.up && !draws) return wrong("--up", kNeedsCamera);
    if (o.up && SquaredLength(*o.up) == 0) {
      return wrong("--up", "must not be 0,0,0");
    }
    if (o.fov) return wrong("--fov", kNeedsCamera);
    if (o.viewport) return wrong("--viewport", kNeedsCamera);
    return Status::Ok();
  }
  if (!draws && !o.frustum && !o.pixels) {
    return wrong("--eye", "is of no use without --frustum or --pixels");
  }
  const Result<Camera> camera = CameraFromJson(CameraOf(o, {1200, 900}));
  return camera.ok()
             ? Status::Ok()
             : InvalidArgument("--eye, --target, --up, --fov: " + camera.status().message());
}

Json CameraOf(const QueryOptions& o, const Extent& viewport) {
  const Extent size = o.viewport.value_or(viewport);
  Json camera = {{"eye", Json(*o.eye)}, {"target", Json(*o.target)}};
  if (o.up) camera["up"] = Json(*o.up);
  if (o.fov) camera["fov"] = *o.fov;
  camera["viewport"] = {size.width, size.height};
  return camera;
}

Result<Json> QueryOf(const QueryOptions& o, const Extent& viewport) {
  Json query = Json::Object();
  if (!o.file.empty()) {
    MTDB_ASSIGN_OR_RETURN(query, ReadQueryFile(o.file));
    if (o.clip && !query.contains("region")) {
      return InvalidArgument(o.file + ": has no region for --clip");
    }
  } else {
    Json::Array regions = o.regions;
    if (o.frustum) regions.push_back({{"frustum", CameraOf(o, viewport)}});
    Json region;
    if (!regions.empty()) region = Together(o.intersect ? "intersection" : "union", regions);
    if (o.outside) region = {{"outside", region}};
    Json::Array thresholds = o.errors_at;
    if (o.error) thresholds.push_back(ThresholdOf(*o.error));
    if (o.pixels) {
      thresholds.push_back(
          {{"screen", {{"camera", CameraOf(o, viewport)}, {"pixels", *o.pixels}}}});
    }
    if (thresholds.empty()) thresholds.push_back("full");
    Json threshold = Together("smallest", thresholds);
    if (o.error_outside) {
      threshold = {{"by_region",
                    {{"region", region},
                     {"inside", threshold},
                     {"outside", ThresholdOf(*o.error_outside)}}}};
    } else if (!regions.empty()) {
      query["region"] = region;
    }
    query["threshold"] = threshold;
  }
  if (o.triangles) query["max_triangles"] = *o.triangles;
  if (o.max_bytes) query["max_bytes"] = *o.max_bytes;
  if (o.max_milliseconds) query["max_milliseconds"] = *o.max_milliseconds;
  if (o.clip) query["clip"] = true;
  if (o.normals) query["normals"] = true;
  return query;
}

}  // namespace mtdb
