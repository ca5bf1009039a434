// SPDX-License-Identifier: Apache-2.0
#include "query/query_json.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "query/query_from_json.h"
#include "store/base/coordinate_limit.h"
#include "store/base/out_of_memory.h"
#include "store/metres_of_unit.h"

namespace mtdb {

namespace {

constexpr size_t kExcerpt = 40;
constexpr int kMostParts = 4096;  // regions and thresholds; each may be asked for each triangle
constexpr int kLargestViewport = 1 << 20;

double Radians(double degrees) { return degrees * std::numbers::pi / 180; }

// What is the same for all of a query.
struct Reading {
  int parts = 0;             // regions and thresholds so far
  Vec3d metres = {1, 1, 1};  // places are multiplied by it, and what is made of them is scaled back
};

// A value and where it is.
struct Node {
  const Json& json;
  std::string path;
  Reading* reading;

  Node operator[](const char* key) const {
    return {json[key], (path.empty() ? "" : path + ".") + key, reading};
  }
  Node operator[](size_t i) const {
    return {json[i], path + "[" + std::to_string(i) + "]", reading};
  }
  bool has(const char* key) const { return json.contains(key); }
};

std::string Found(const Json& json) {
  if (json.is_object()) return "an object";
  if (json.is_array()) return "a list of " + std::to_string(json.size());
  std::string text = json.Text();
  if (text.size() > kExcerpt) text = text.substr(0, kExcerpt) + "...";
  return text;
}

Status Wrong(const Node& node, const std::string& what) {
  return InvalidArgument(node.path + ": " + what);
}

Status Unexpected(const Node& node, const std::string& expected) {
  return Wrong(node, "expected " + expected + ", found " + Found(node.json));
}

std::string Listed(const std::vector<const char*>& names) {
  std::string text;
  for (const char* name : names) text += (text.empty() ? "" : ", ") + std::string(name);
  return text;
}

// An object with all of the required keys and no others than the optional ones.
Status CheckKeys(const Node& node, std::initializer_list<const char*> required,
                 std::initializer_list<const char*> optional = {}) {
  std::vector<const char*> known(required);
  known.insert(known.end(), optional);
  if (!node.json.is_object()) return Unexpected(node, "an object with " + Listed(known));
  if (const std::string* const key = node.json.UnknownKey(known)) {
    return Wrong(node, "no key " + Found(*key) + " here; known are " + Listed(known));
  }
  for (const char* key : required) {
    if (!node.has(key)) return Wrong(node, std::string("the key \"") + key + "\" is missing");
  }
  return Status::Ok();
}

Result<double> Number(const Node& node) {
  if (node.json.is_number()) {
    const double value = node.json.number();
    if (IsCoordinate(value)) return value;
    return Unexpected(node, "a number from -1e30 to 1e30");
  }
  return Unexpected(node, "a number");
}

Result<double> NonNegative(const Node& node) {
  MTDB_ASSIGN_OR_RETURN(const double value, Number(node));
  if (value < 0) return Unexpected(node, "a number that is not negative");
  return value;
}

Result<double> Positive(const Node& node) {
  MTDB_ASSIGN_OR_RETURN(const double value, Number(node));
  if (!(value > 0)) return Unexpected(node, "a number above 0");
  return value;
}

// `form` is "[x, y, z]" or the like.
Result<std::vector<double>> Numbers(const Node& node, size_t count, const char* form) {
  if (!node.json.is_array() || node.json.size() != count) return Unexpected(node, form);
  std::vector<double> numbers;
  for (size_t i = 0; i < count; ++i) {
    MTDB_ASSIGN_OR_RETURN(const double value, Number(node[i]));
    numbers.push_back(value);
  }
  return numbers;
}

Result<Vec3d> Point(const Node& node) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, Numbers(node, 3, "[x, y, z]"));
  return Scaled({n[0], n[1], n[2]}, node.reading->metres);
}

// [x, y]
Result<std::array<double, 2>> PointInPlane(const Node& node) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, Numbers(node, 2, "[x, y]"));
  return std::array<double, 2>{n[0] * node.reading->metres.x, n[1] * node.reading->metres.y};
}

// Long enough to be divided by its length.
Result<Vec3d> Direction(const Node& node) {
  MTDB_ASSIGN_OR_RETURN(const Vec3d v, Point(node));
  if (std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}) < 1e-30) {
    return Wrong(node, "expected a direction, found one without length");
  }
  return v;
}

Result<double> AngleDegrees(const Node& node) {
  MTDB_ASSIGN_OR_RETURN(const double degrees, Number(node));
  if (!(degrees >= 1e-3 && degrees <= 179.999)) {
    return Unexpected(node, "an angle of 0.001 to 179.999 degrees");
  }
  return Radians(degrees);
}

Status ReadNearAndFar(const Node& node, double* near, double* far) {
  if (node.has("near")) {
    MTDB_ASSIGN_OR_RETURN(*near, NonNegative(node["near"]));
  }
  if (node.has("far")) {
    MTDB_ASSIGN_OR_RETURN(*far, Number(node["far"]));
    if (!(*far > *near)) return Unexpected(node["far"], "a number above near");
  }
  return Status::Ok();
}

// A list of at least `least` entries.
Status CheckList(const Node& node, size_t least, const char* of) {
  if (node.json.is_array() && node.json.size() >= least) return Status::Ok();
  return Unexpected(node, "a list of at least " + std::to_string(least) + " " + of);
}

Result<HalfSpace> HalfSpaceOf(const Node& node) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"point", "normal"}));
  HalfSpace h;
  MTDB_ASSIGN_OR_RETURN(h.point, Point(node["point"]));
  MTDB_ASSIGN_OR_RETURN(h.normal, Direction(node["normal"]));
  // The same plane: what a direction is multiplied by, a normal is divided by.
  const Vec3d m = node.reading->metres;
  h.normal = Scaled(h.normal, {1 / (m.x * m.x), 1 / (m.y * m.y), 1 / (m.z * m.z)});
  return h;
}

Result<RegionPtr> RegionOf(const Node& node, int depth);
Result<ThresholdPtr> ThresholdOf(const Node& node, double diagonal, int depth);

Result<RegionPtr> BoxOf(const Node& node, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"min", "max"}));
  Box3d box;
  MTDB_ASSIGN_OR_RETURN(box.min, Point(node["min"]));
  MTDB_ASSIGN_OR_RETURN(box.max, Point(node["max"]));
  if (box.empty()) return Wrong(node, "expected a min that does not exceed max");
  return BoxRegion(box);
}

Result<RegionPtr> SphereOf(const Node& node, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"centre", "radius"}));
  MTDB_ASSIGN_OR_RETURN(const Vec3d centre, Point(node["centre"]));
  MTDB_ASSIGN_OR_RETURN(const double radius, NonNegative(node["radius"]));
  return SphereRegion(centre, radius);
}

Result<RegionPtr> HalfSpaceRegionOf(const Node& node, int) {
  MTDB_ASSIGN_OR_RETURN(const HalfSpace h, HalfSpaceOf(node));
  return HalfSpaceRegion(h);
}

Result<RegionPtr> PolyhedronOf(const Node& node, int) {
  MTDB_RETURN_IF_ERROR(CheckList(node, 1, "half-spaces"));
  if (node.json.size() > kMaxHalfSpaces) {
    return Unexpected(node, "at most " + std::to_string(kMaxHalfSpaces) + " half-spaces");
  }
  std::vector<HalfSpace> half_spaces;
  for (size_t i = 0; i < node.json.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(const HalfSpace h, HalfSpaceOf(node[i]));
    half_spaces.push_back(h);
  }
  return ConvexRegion(half_spaces);
}

Result<Camera> CameraOf(const Node& node) {
  MTDB_RETURN_IF_ERROR(
      CheckKeys(node, {"eye"}, {"target", "direction", "up", "fov", "viewport", "near", "far"}));
  Camera camera;
  MTDB_ASSIGN_OR_RETURN(camera.eye, Point(node["eye"]));
  if (node.has("target") == node.has("direction")) {
    return Wrong(node, "expected either target or direction");
  }
  if (node.has("target")) {
    MTDB_ASSIGN_OR_RETURN(const Vec3d target, Point(node["target"]));
    camera.direction = target - camera.eye;
    if (SquaredLength(camera.direction) == 0) {
      return Wrong(node["target"], "the target must not be at the eye");
    }
  } else {
    MTDB_ASSIGN_OR_RETURN(camera.direction, Direction(node["direction"]));
  }
  if (node.has("up")) {
    MTDB_ASSIGN_OR_RETURN(camera.up, Direction(node["up"]));
  } else if (const Vec3d d = camera.direction; std::hypot(d.x, d.y) <= 1e-6 * std::abs(d.z)) {
    camera.up = {0, 1, 0};  // straight down, or up
  }
  camera.vertical_fov_rad = Radians(45);
  if (node.has("fov")) {
    MTDB_ASSIGN_OR_RETURN(camera.vertical_fov_rad, AngleDegrees(node["fov"]));
  }
  if (node.has("viewport")) {
    const Node viewport = node["viewport"];
    const char* form = "[width, height] in whole pixels";
    MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, Numbers(viewport, 2, form));
    for (size_t i = 0; i < 2; ++i) {
      if (n[i] != std::floor(n[i]) || n[i] < 1 || n[i] > kLargestViewport) {
        return Unexpected(viewport[i], "whole pixels, from 1 to 1048576");
      }
    }
    camera.width_px = static_cast<int>(n[0]);
    camera.height_px = static_cast<int>(n[1]);
  }
  MTDB_RETURN_IF_ERROR(ReadNearAndFar(node, &camera.near, &camera.far));
  const Status status = camera.Validate();
  if (!status.ok()) return Wrong(node, status.message());
  return camera;
}

Result<RegionPtr> FrustumOf(const Node& node, int) {
  MTDB_ASSIGN_OR_RETURN(const Camera camera, CameraOf(node));
  return FrustumRegion(camera);
}

Result<RegionPtr> FrustumShadowOf(const Node& node, int) {
  MTDB_ASSIGN_OR_RETURN(const Camera camera, CameraOf(node));
  if (!std::isfinite(camera.far)) return Wrong(node, "the key \"far\" is missing");
  return FrustumShadowRegion(camera);
}

Result<RegionPtr> WedgeOf(const Node& node, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"apex", "direction", "angle"}, {"near", "far"}));
  MTDB_ASSIGN_OR_RETURN(const auto apex, PointInPlane(node["apex"]));
  MTDB_ASSIGN_OR_RETURN(const auto direction, PointInPlane(node["direction"]));
  Wedge wedge{apex[0], apex[1], direction[0], direction[1]};
  if (std::max(std::abs(direction[0]), std::abs(direction[1])) < 1e-30) {
    return Wrong(node["direction"], "expected a direction, found one without length");
  }
  MTDB_ASSIGN_OR_RETURN(wedge.angle_rad, AngleDegrees(node["angle"]));
  MTDB_RETURN_IF_ERROR(ReadNearAndFar(node, &wedge.near, &wedge.far));
  return WedgeRegion(wedge);
}

Result<RegionPtr> PrismOf(const Node& node, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"polygon"}, {"min_z", "max_z"}));
  const Node corners = node["polygon"];
  MTDB_RETURN_IF_ERROR(CheckList(corners, 3, "corners [x, y]"));
  std::vector<std::array<double, 2>> polygon;
  for (size_t i = 0; i < corners.json.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(const auto corner, PointInPlane(corners[i]));
    polygon.push_back(corner);
  }
  double min_z = -std::numeric_limits<double>::infinity();
  double max_z = std::numeric_limits<double>::infinity();
  if (node.has("min_z")) {
    MTDB_ASSIGN_OR_RETURN(min_z, Number(node["min_z"]));
  }
  if (node.has("max_z")) {
    MTDB_ASSIGN_OR_RETURN(max_z, Number(node["max_z"]));
  }
  if (min_z > max_z) return Wrong(node, "expected a min_z that does not exceed max_z");
  return PrismRegion(polygon, min_z, max_z);
}

Result<RegionPtr> PointRegionOf(const Node& node, int) {
  MTDB_ASSIGN_OR_RETURN(const Vec3d point, Point(node));
  return PointRegion(point);
}

Result<RegionPtr> SegmentOf(const Node& node, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"from", "to"}));
  MTDB_ASSIGN_OR_RETURN(const Vec3d from, Point(node["from"]));
  MTDB_ASSIGN_OR_RETURN(const Vec3d to, Point(node["to"]));
  return SegmentRegion(from, to);
}

Result<RegionPtr> TubeOf(const Node& node, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"line", "radius"}));
  const Node points = node["line"];
  MTDB_RETURN_IF_ERROR(CheckList(points, 1, "points [x, y, z]"));
  std::vector<Vec3d> line;
  for (size_t i = 0; i < points.json.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(const Vec3d point, Point(points[i]));
    line.push_back(point);
  }
  MTDB_ASSIGN_OR_RETURN(const double radius, NonNegative(node["radius"]));
  return TubeRegion(line, radius);
}

Result<std::vector<RegionPtr>> RegionsOf(const Node& node, int depth) {
  MTDB_RETURN_IF_ERROR(CheckList(node, 1, "regions"));
  std::vector<RegionPtr> regions;
  for (size_t i = 0; i < node.json.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(RegionPtr region, RegionOf(node[i], depth));
    regions.push_back(std::move(region));
  }
  return regions;
}

Result<RegionPtr> UnionOf(const Node& node, int depth) {
  MTDB_ASSIGN_OR_RETURN(std::vector<RegionPtr> regions, RegionsOf(node, depth));
  return UnionRegion(std::move(regions));
}

Result<RegionPtr> IntersectionOf(const Node& node, int depth) {
  MTDB_ASSIGN_OR_RETURN(std::vector<RegionPtr> regions, RegionsOf(node, depth));
  return IntersectionRegion(std::move(regions));
}

Result<RegionPtr> OutsideOf(const Node& node, int depth) {
  MTDB_ASSIGN_OR_RETURN(RegionPtr region, RegionOf(node, depth));
  return ComplementRegion(std::move(region));
}

struct RegionKind {
  const char* name;
  Result<RegionPtr> (*parse)(const Node& node, int depth);
};
constexpr RegionKind kRegionKinds[] = {
    {"box", BoxOf},
    {"sphere", SphereOf},
    {"half_space", HalfSpaceRegionOf},
    {"polyhedron", PolyhedronOf},
    {"frustum", FrustumOf},
    {"frustum_shadow", FrustumShadowOf},
    {"wedge", WedgeOf},
    {"prism", PrismOf},
    {"point", PointRegionOf},
    {"segment", SegmentOf},
    {"tube", TubeOf},
    {"union", UnionOf},
    {"intersection", IntersectionOf},
    {"outside", OutsideOf},
};

// The kind that the only key of an object names.
template <typename Kind, size_t kCount>
Result<const Kind*> KindOf(const Node& node, const Kind (&kinds)[kCount], const char* what) {
  if (node.json.is_object() && node.json.size() == 1) {
    for (const Kind& kind : kinds) {
      if (node.has(kind.name)) return &kind;
    }
  }
  std::vector<const char*> names;
  for (const Kind& kind : kinds) names.push_back(kind.name);
  const std::string found =
      node.json.is_object() && node.json.size() == 1 ? Found(node.json.members().front().name)
      : node.json.is_object() ? "an object with " + std::to_string(node.json.size()) + " keys"
                              : Found(node.json);
  return Wrong(node, std::string("expected ") + what + ", an object with one of the keys " +
                         Listed(names) + "; found " + found);
}

Status CountPart(const Node& node) {
  if (++node.reading->parts <= kMostParts) return Status::Ok();
  return Wrong(node, "a query has at most " + std::to_string(kMostParts) +
                         " regions and thresholds, those within others counted");
}

Result<RegionPtr> RegionOf(const Node& node, int depth) {
  MTDB_RETURN_IF_ERROR(CountPart(node));
  if (depth == kDeepestQuery) return Wrong(node, "too many regions within each other");
  MTDB_ASSIGN_OR_RETURN(const RegionKind* kind, KindOf(node, kRegionKinds, "a region"));
  return kind->parse(node[kind->name], depth + 1);
}

Result<ThresholdPtr> RelativeOf(const Node& node, double diagonal, int) {
  MTDB_ASSIGN_OR_RETURN(const double fraction, NonNegative(node));
  return ConstantThreshold(fraction * diagonal);
}

// A point, a base and `factor`, which go to `make`.
template <typename Make>
Result<ThresholdPtr> OfDistance(const Node& node, const char* factor, Make make) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"point", "base", factor}));
  MTDB_ASSIGN_OR_RETURN(const Vec3d point, Point(node["point"]));
  MTDB_ASSIGN_OR_RETURN(const double base, Number(node["base"]));
  MTDB_ASSIGN_OR_RETURN(const double value, Number(node[factor]));
  return make(point, base, value);
}

Result<ThresholdPtr> LinearOf(const Node& node, double, int) {
  return OfDistance(node, "slope", LinearThreshold);
}
Result<ThresholdPtr> QuadraticOf(const Node& node, double, int) {
  return OfDistance(node, "factor", QuadraticThreshold);
}
Result<ThresholdPtr> SquareRootOf(const Node& node, double, int) {
  return OfDistance(node, "factor", SquareRootThreshold);
}
Result<ThresholdPtr> ExponentialOf(const Node& node, double, int) {
  return OfDistance(node, "rate", ExponentialThreshold);
}

Result<ThresholdPtr> ScreenOf(const Node& node, double, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"camera", "pixels"}));
  MTDB_ASSIGN_OR_RETURN(const Camera camera, CameraOf(node["camera"]));
  MTDB_ASSIGN_OR_RETURN(const double pixels, Positive(node["pixels"]));
  return ScreenThreshold(camera, pixels);
}

Result<ThresholdPtr> ByRegionOf(const Node& node, double diagonal, int depth) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"region", "inside", "outside"}));
  MTDB_ASSIGN_OR_RETURN(RegionPtr region, RegionOf(node["region"], depth));
  MTDB_ASSIGN_OR_RETURN(ThresholdPtr inside, ThresholdOf(node["inside"], diagonal, depth));
  MTDB_ASSIGN_OR_RETURN(ThresholdPtr outside, ThresholdOf(node["outside"], diagonal, depth));
  return RegionThreshold(std::move(region), std::move(inside), std::move(outside));
}

Result<ThresholdPtr> GridOf(const Node& node, double, int) {
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {"origin", "cell", "counts", "errors"}));
  GridField field;
  MTDB_ASSIGN_OR_RETURN(field.origin, Point(node["origin"]));
  MTDB_ASSIGN_OR_RETURN(field.cell_size, Point(node["cell"]));
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> counts,
                        Numbers(node["counts"], 3, "[cells along x, y, z]"));
  const Node errors = node["errors"];
  if (!errors.json.is_array()) return Unexpected(errors, "a list of errors");
  double cells = 1;
  for (size_t i = 0; i < 3; ++i) {
    if (!(field.cell_size[static_cast<int>(i)] > 0)) {
      return Unexpected(node["cell"][i], "a number above 0");
    }
    if (counts[i] != std::floor(counts[i]) || counts[i] < 1 || counts[i] > 1e9) {
      return Unexpected(node["counts"][i], "a whole number of cells, at least 1");
    }
    field.counts[i] = static_cast<uint32_t>(counts[i]);
    cells *= counts[i];
  }
  if (cells != static_cast<double>(errors.json.size())) {
    return Unexpected(errors, "an error for each cell");
  }
  for (size_t i = 0; i < errors.json.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(const double error, Number(errors[i]));
    field.errors.push_back(error);
  }
  return GridThreshold(std::move(field));
}

Result<std::vector<ThresholdPtr>> ThresholdsOf(const Node& node, double diagonal, int depth) {
  MTDB_RETURN_IF_ERROR(CheckList(node, 1, "thresholds"));
  std::vector<ThresholdPtr> thresholds;
  for (size_t i = 0; i < node.json.size(); ++i) {
    MTDB_ASSIGN_OR_RETURN(ThresholdPtr threshold, ThresholdOf(node[i], diagonal, depth));
    thresholds.push_back(std::move(threshold));
  }
  return thresholds;
}

Result<ThresholdPtr> SmallestOf(const Node& node, double diagonal, int depth) {
  MTDB_ASSIGN_OR_RETURN(std::vector<ThresholdPtr> all, ThresholdsOf(node, diagonal, depth));
  return MinThreshold(std::move(all));
}

Result<ThresholdPtr> LargestOf(const Node& node, double diagonal, int depth) {
  MTDB_ASSIGN_OR_RETURN(std::vector<ThresholdPtr> all, ThresholdsOf(node, diagonal, depth));
  return MaxThreshold(std::move(all));
}

struct ThresholdKind {
  const char* name;
  Result<ThresholdPtr> (*parse)(const Node& node, double diagonal, int depth);
};
constexpr ThresholdKind kThresholdKinds[] = {
    {"relative", RelativeOf},       {"linear", LinearOf},
    {"quadratic", QuadraticOf},     {"square_root", SquareRootOf},
    {"exponential", ExponentialOf}, {"screen", ScreenOf},
    {"by_region", ByRegionOf},      {"grid", GridOf},
    {"smallest", SmallestOf},       {"largest", LargestOf},
};

Result<ThresholdPtr> ThresholdOf(const Node& node, double diagonal, int depth) {
  MTDB_RETURN_IF_ERROR(CountPart(node));
  if (depth == kDeepestQuery) return Wrong(node, "too many thresholds within each other");
  if (node.json.is_number()) {
    MTDB_ASSIGN_OR_RETURN(const double error, NonNegative(node));
    return ConstantThreshold(error);
  }
  if (node.json == "full") return FullResolution();
  if (node.json == "coarsest") return CoarsestThreshold();
  MTDB_ASSIGN_OR_RETURN(
      const ThresholdKind* kind,
      KindOf(node, kThresholdKinds, "a threshold: a number, \"full\", \"coarsest\""));
  return kind->parse(node[kind->name], diagonal, depth + 1);
}

Result<Query> ReadQuery(const Json& json, double diagonal, Vec3d metres) {
  Reading reading{0, metres};
  const Node node{json, "query", &reading};
  const auto entry = [&](const char* key) { return Node{json[key], key, &reading}; };
  MTDB_RETURN_IF_ERROR(CheckKeys(node, {},
                                 {"region", "threshold", "max_triangles", "max_bytes",
                                  "max_milliseconds", "clip", "normals", "available_only"}));
  Query query;
  if (node.has("region")) {
    MTDB_ASSIGN_OR_RETURN(RegionPtr region, RegionOf(entry("region"), 0));
    query.region = ScaledRegion(std::move(region), metres);
  }
  if (node.has("threshold")) {
    MTDB_ASSIGN_OR_RETURN(ThresholdPtr threshold, ThresholdOf(entry("threshold"), diagonal, 0));
    query.threshold = ScaledThreshold(std::move(threshold), metres);
  }
  const auto count = [&](const char* key, std::optional<uint64_t>* value) -> Status {
    if (!node.has(key)) return Status::Ok();
    const Node n = entry(key);
    const uint64_t* const whole = n.json.whole_number();
    if (whole == nullptr || *whole == 0) return Unexpected(n, "a whole number above 0");
    *value = *whole;
    return Status::Ok();
  };
  const auto flag = [&](const char* key, bool* value) -> Status {
    if (!node.has(key)) return Status::Ok();
    const Node n = entry(key);
    if (n.json.boolean() == nullptr) return Unexpected(n, "true or false");
    *value = *n.json.boolean();
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(count("max_triangles", &query.max_triangles));
  MTDB_RETURN_IF_ERROR(count("max_bytes", &query.max_bytes));
  if (node.has("max_milliseconds")) {
    MTDB_ASSIGN_OR_RETURN(query.max_milliseconds, NonNegative(entry("max_milliseconds")));
  }
  MTDB_RETURN_IF_ERROR(flag("clip", &query.clip));
  MTDB_RETURN_IF_ERROR(flag("normals", &query.normals));
  MTDB_RETURN_IF_ERROR(flag("available_only", &query.available_only));
  if (query.clip && query.region == nullptr) return InvalidArgument("clip: needs a region");
  return query;
}

// What `read` makes of a text.
template <typename Read>
auto OfText(std::string_view text, Read read) {
  return CatchOutOfMemory([&]() -> decltype(read(Json())) {
    MTDB_ASSIGN_OR_RETURN(const Json json, Json::Parse(text, kDeepestQuery));
    return read(json);
  });
}

}  // namespace

Result<Query> QueryFromJson(const Json& json, double diagonal) {
  return CatchOutOfMemory([&] { return ReadQuery(json, diagonal, {1, 1, 1}); });
}

Result<Query> QueryFromJson(const Json& json, const ObjectRecord& record) {
  const std::array<double, 2> metres = MetresOfUnit(record);
  return CatchOutOfMemory([&] {
    return ReadQuery(json, record.diagonal(), {metres[0], metres[1], 1});
  });
}

Result<RegionPtr> RegionFromJson(const Json& json) {
  Reading reading;
  return CatchOutOfMemory([&] { return RegionOf({json, "region", &reading}, 0); });
}

Result<ThresholdPtr> ThresholdFromJson(const Json& json, double diagonal) {
  Reading reading;
  return CatchOutOfMemory([&] { return ThresholdOf({json, "threshold", &reading}, diagonal, 0); });
}

Result<Camera> CameraFromJson(const Json& json) {
  Reading reading;
  return CatchOutOfMemory([&] { return CameraOf({json, "camera", &reading}); });
}

Result<Query> ParseQuery(std::string_view text, double diagonal) {
  return OfText(text, [&](const Json& json) { return QueryFromJson(json, diagonal); });
}

Result<Query> ParseQuery(std::string_view text, const ObjectRecord& record) {
  return OfText(text, [&](const Json& json) { return QueryFromJson(json, record); });
}

Result<RegionPtr> ParseRegion(std::string_view text) { return OfText(text, RegionFromJson); }

Result<ThresholdPtr> ParseThreshold(std::string_view text, double diagonal) {
  return OfText(text, [&](const Json& json) { return ThresholdFromJson(json, diagonal); });
}

Result<Camera> ParseCamera(std::string_view text) { return OfText(text, CameraFromJson); }

}  // namespace mtdb
