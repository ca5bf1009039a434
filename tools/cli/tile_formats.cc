// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/tile_formats.h"

#include <algorithm>
#include <set>
#include <string_view>
#include <utility>

#include "tools/tiles/places/tile_placement.h"
#include "tools/tiles/quantized/quantized_mesh.h"

namespace mtdb {

namespace {

// An option that was given, and the kinds of tiles that it is for.
struct GivenOption {
  const char* name;
  bool given;
  std::vector<std::string_view> formats;
};

Status Unclear(const std::string& text) {
  return InvalidArgument("--ids: expected all, or ID=NAME,ID=NAME with whole numbers, found '" +
                         text + "'");
}

Result<std::vector<NeuroglancerSegment>> NamedSegments(const std::string& list,
                                                       const Database& database) {
  std::vector<NeuroglancerSegment> segments;
  for (size_t begin = 0; begin <= list.size();) {
    const size_t comma = std::min(list.find(',', begin), list.size());
    const std::string part = list.substr(begin, comma - begin);
    const size_t equals = part.find('=');
    const auto id = SegmentIdIn(std::string_view(part).substr(0, equals));
    if (equals == std::string::npos || !id) return Unclear(part);
    MTDB_ASSIGN_OR_RETURN(ObjectRecord record, database.Find(part.substr(equals + 1)));
    segments.push_back({*id, std::move(record)});
    begin = comma + 1;
  }
  return segments;
}

std::vector<NeuroglancerSegment> NumberedSegments(std::vector<ObjectRecord> records) {
  std::sort(records.begin(), records.end(),
            [](const ObjectRecord& a, const ObjectRecord& b) { return a.name < b.name; });
  std::set<uint64_t> taken;
  for (const ObjectRecord& record : records) {
    if (const auto number = SegmentIdIn(record.name)) taken.insert(*number);
  }
  std::vector<NeuroglancerSegment> segments;
  uint64_t next = 1;
  for (ObjectRecord& record : records) {
    std::optional<uint64_t> id = SegmentIdIn(record.name);
    if (!id) {
      while (taken.contains(next)) ++next;
      id = next++;
    }
    segments.push_back({*id, std::move(record)});
  }
  return segments;
}

}  // namespace

Status CheckTileArguments(const TileArguments& a) {
  const std::vector<GivenOption> options{
      {"--at", a.at.has_value(), {"3dtiles"}},
      {"--pixels", a.pixels.has_value(), {"3dtiles", "neuroglancer"}},
      {"--tile-triangles", a.tile_triangles.has_value(), {"3dtiles", "neuroglancer"}},
      {"--mercator", a.mercator, {"quantized-mesh"}},
      {"--max-level", a.max_level.has_value(), {"quantized-mesh", "terrain-rgb"}},
      {"--encoding", a.encoding.has_value(), {"terrain-rgb"}},
      {"--tile-pixels", a.tile_pixels.has_value(), {"terrain-rgb"}},
      {"--ids", a.ids.has_value(), {"neuroglancer"}},
      {"--resolution", a.resolution.has_value(), {"neuroglancer"}},
      {"--bits", a.bits.has_value(), {"neuroglancer"}},
      {"--sharded", a.sharded, {"neuroglancer"}},
      {".3tz", a.output.ends_with(".3tz"), {"3dtiles"}},
      {".pmtiles", a.output.ends_with(".pmtiles"), {"terrain-rgb"}}};
  for (const GivenOption& option : options) {
    const auto& formats = option.formats;
    if (!option.given || std::find(formats.begin(), formats.end(), a.format) != formats.end()) {
      continue;
    }
    std::string list(formats[0]);
    for (size_t i = 1; i < formats.size(); ++i) list += " and " + std::string(formats[i]);
    return InvalidArgument(std::string(option.name) + ": is for --as " + list + ", not for " +
                           a.format);
  }
  if (a.ids && !a.name.empty()) {
    return InvalidArgument("--ids: names objects itself; leave --name out");
  }
  return Status::Ok();
}

Result<std::vector<NeuroglancerSegment>> SegmentsOf(const TileArguments& arguments,
                                                    const Database& database) {
  std::vector<NeuroglancerSegment> segments;
  if (!arguments.ids) {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<ClusterSource> source,
                          database.OpenObject(arguments.name));
    segments = NumberedSegments({source->record()});
  } else if (*arguments.ids == "all") {
    MTDB_ASSIGN_OR_RETURN(std::vector<ObjectRecord> records, database.List());
    if (records.empty()) return NotFound(arguments.store + ": has no objects");
    segments = NumberedSegments(std::move(records));
  } else {
    MTDB_ASSIGN_OR_RETURN(segments, NamedSegments(*arguments.ids, database));
  }
  std::sort(segments.begin(), segments.end(),
            [](const NeuroglancerSegment& a, const NeuroglancerSegment& b) { return a.id < b.id; });
  for (size_t i = 1; i < segments.size(); ++i) {
    if (segments[i - 1].id != segments[i].id) continue;
    return InvalidArgument("--ids: two objects have the id " + std::to_string(segments[i].id));
  }
  return segments;
}

Json TileNotesOf(const TileArguments& arguments, const ObjectRecord& record) {
  Json notes(Json::Array{});
  if (arguments.format == "terrain-rgb") return notes;
  if (arguments.format == "neuroglancer") {
    if (!arguments.resolution && record.units.empty()) {
      notes.push_back(
          "nobody said what the object's lengths are in, and they are taken for nanometres; "
          "--resolution or ingest --units says it");
    }
  } else if (arguments.format == "quantized-mesh" || IsInDegrees(record)) {
    if (const std::string warning = HeightWarning(record); !warning.empty()) {
      notes.push_back(warning);
    }
  } else if (arguments.at && record.units.empty() && !record.raster) {
    notes.push_back(
        "nobody said what the object's lengths are in, and they are taken for metres; "
        "ingest --units says it");
  }
  return notes;
}

}  // namespace mtdb
