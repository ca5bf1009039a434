// SPDX-License-Identifier: Apache-2.0
#include "tools/request/mesh_output.h"

#include <array>
#include <optional>

#include "store/metres_of_unit.h"
#include "tools/client/printable.h"

namespace mtdb {

namespace {

// Of heights, by the units that rasters name; 1 for those that are not known.
double MetresOfHeight(const ObjectRecord& record) {
  const std::string units = record.raster ? record.raster->height_units : "";
  if (units == "ft" || units == "foot" || units == "feet") return 0.3048;
  if (units == "us-ft" || units == "US survey foot" || units == "ftUS") return 1200.0 / 3937;
  return 1;
}

Json PointJson(const std::optional<Vec3d>& p) { return p ? Json(*p) : Json(); }

std::optional<Vec3d> ParsePoint(const Json& json) {
  if (json.size() != 3) return std::nullopt;
  Vec3d p;
  for (int i = 0; i < 3; ++i) {
    const Json& number = json[static_cast<size_t>(i)];
    if (!number.is_number()) return std::nullopt;
    p[i] = number.number();
  }
  return p;
}

}  // namespace

MeshWriteOptions MeshOptionsOf(const ObjectRecord& record, bool normals) {
  MeshWriteOptions options;
  options.off_normals = normals;
  if (!record.raster && record.error_measure == ErrorMeasure::kTwoSidedDistance) return options;
  options.up_frame = MeshWriteOptions::UpFrame{};
  MeshWriteOptions::UpFrame& frame = *options.up_frame;
  const std::array<double, 2> metres = MetresOfUnit(record);
  if (metres == std::array<double, 2>{1, 1}) return options;
  const Box3d& b = record.bounds;
  frame.metres = {metres[0], metres[1], MetresOfHeight(record)};
  frame.metres_from = {(b.min.x + b.max.x) / 2, (b.min.y + b.max.y) / 2, 0};
  return options;
}

Json MeshFileJson(const MeshWriteReport& report) {
  return {{"positions", report.positions},
          {"origin", PointJson(report.origin)},
          {"node_origin", PointJson(report.node_origin)},
          {"not_written", report.not_written},
          {"notes", report.notes}};
}

MeshWriteReport ParseMeshFile(const std::string& text) {
  MeshWriteReport report;
  const Json json = Json::ParseObject(text);
  const auto texts = [&](const char* name, std::vector<std::string>* list) {
    const Json& values = json[name];
    for (size_t i = 0; i < values.size(); ++i) {
      if (const std::string* const value = values[i].string()) list->push_back(*value);
    }
  };
  if (const std::string* const positions = json["positions"].string()) {
    report.positions = *positions;
  }
  report.origin = ParsePoint(json["origin"]);
  report.node_origin = ParsePoint(json["node_origin"]);
  texts("not_written", &report.not_written);
  texts("notes", &report.notes);
  return report;
}

std::string MeshFileText(const MeshWriteReport& report) {
  std::string text;
  // With all digits, to be added.
  const auto point = [](const Vec3d& p) {
    return Json(p.x).Text() + " " + Json(p.y).Text() + " " + Json(p.z).Text();
  };
  if (report.origin) {
    text += "  float32 positions in the file are offsets from " + point(*report.origin) + "\n";
  }
  if (report.node_origin) {
    text += "  float32 positions in the file are offsets from " + point(*report.node_origin) +
            ", which its node holds: readers of glTF add it\n";
  }
  std::string list;
  for (const std::string& attributes : report.not_written) {
    list += (list.empty() ? "" : ", ") + attributes;
  }
  if (!list.empty()) text += "  not written: " + Printable(list) + "\n";
  for (const std::string& note : report.notes) text += "  " + Printable(note) + "\n";
  return text;
}

}  // namespace mtdb
