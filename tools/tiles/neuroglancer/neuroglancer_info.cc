// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/neuroglancer/neuroglancer_info.h"

#include <charconv>
#include <utility>

#include "tools/tiles/places/tile_placement.h"

namespace mtdb {

namespace {

constexpr double kClientPixels = 10;  // what clients have set
constexpr double kFarAway = 8;        // times an object's size
constexpr double kNanometresOfMetre = 1e9;

Vec3d Times(Vec3d a, Vec3d b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }

Vec3d ResolutionOf(const ObjectRecord& record, const NeuroglancerSetOptions& set) {
  const double unit = NanometresOf(record);
  return set.resolution.value_or(Vec3d{unit, unit, unit});
}

}  // namespace

double NanometresOf(const ObjectRecord& record) {
  return record.units.empty() ? 1 : MetresOf(record) * kNanometresOfMetre;
}

std::optional<uint64_t> SegmentIdIn(std::string_view name) {
  uint64_t number = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), number);
  const bool is_plain = error == std::errc() && end == name.data() + name.size() &&
                        (name.size() == 1 || name[0] != '0');
  return is_plain ? std::optional(number) : std::nullopt;
}

Status CheckSegment(const ObjectRecord& record) {
  if (!IsInDegrees(record)) return Status::Ok();
  return InvalidArgument(record.name +
                         ": a terrain in degrees has no place in neuroglancer's space of "
                         "nanometres; --as quantized-mesh or 3dtiles puts it on the globe");
}

Vec3d NeuroglancerMove(const std::vector<NeuroglancerSegment>& segments,
                       const NeuroglancerSetOptions& set) {
  Box3d all;
  for (const NeuroglancerSegment& s : segments) {
    all.Add(Times(s.record.bounds.min, ResolutionOf(s.record, set)));
    all.Add(Times(s.record.bounds.max, ResolutionOf(s.record, set)));
  }
  Vec3d moved;
  if (Length(all.min) <= kFarAway * Diagonal(all)) return moved;
  for (int i = 0; i < 3; ++i) moved[i] = static_cast<double>(static_cast<float>(all.min[i]));
  return moved;
}

NeuroglancerOptions NeuroglancerOptionsOf(const ObjectRecord& record,
                                          const NeuroglancerSetOptions& set, Vec3d moved) {
  NeuroglancerOptions how;
  how.resolution = ResolutionOf(record, set);
  how.moved = moved;
  how.bits = set.bits;
  how.tile_triangles = set.tile_triangles;
  return how;
}

Json NeuroglancerInfo(const NeuroglancerSetOptions& set, Vec3d moved) {
  return {{"@type", "neuroglancer_multilod_draco"},
          {"vertex_quantization_bits", set.bits},
          {"transform", {1, 0, 0, moved.x, 0, 1, 0, moved.y, 0, 0, 1, moved.z}},
          {"lod_scale_multiplier", kClientPixels / set.pixels},
          {"segment_properties", "segment_properties"}};
}

Json NeuroglancerProperties(const std::vector<NeuroglancerSegment>& segments) {
  Json ids(Json::Array{}), names(Json::Array{}), triangles(Json::Array{});
  for (const NeuroglancerSegment& s : segments) {
    ids.push_back(std::to_string(s.id));
    names.push_back(s.record.name);
    triangles.push_back(s.record.triangles);
  }
  Json properties(Json::Array{});
  properties.push_back({{"id", "label"}, {"type", "label"}, {"values", std::move(names)}});
  properties.push_back({{"id", "triangles"},
                        {"type", "number"},
                        {"data_type", "float32"},
                        {"values", std::move(triangles)}});
  return {{"@type", "neuroglancer_segment_properties"},
          {"inline", {{"ids", std::move(ids)}, {"properties", std::move(properties)}}}};
}

}  // namespace mtdb
