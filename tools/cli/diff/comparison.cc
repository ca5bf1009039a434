// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/diff/comparison.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <vector>

#include "builder/build.h"
#include "query/query_from_json.h"
#include "store/database.h"
#include "tools/cli/grouped.h"
#include "tools/request/arguments.h"
#include "tools/request/report_json.h"

namespace mtdb {
namespace {

constexpr int kExceedsStatus = 3, kUndecidedStatus = 4;
constexpr size_t kPlacesTold = 10;
constexpr size_t kPlacesOfQuery = 2000;  // of each object; a query has at most 4096 regions

Result<CompareOptions> OptionsOf(const DiffArguments& arguments, const ObjectRecord& record) {
  CompareOptions options;
  const auto length = [&](const std::optional<AskedError>& asked) -> std::optional<double> {
    if (!asked) return std::nullopt;
    return ErrorModelOf(asked, record.diagonal());
  };
  options.tolerance = length(arguments.tolerance);
  options.width = length(arguments.width);
  options.reach = length(arguments.reach);
  options.max_milliseconds = arguments.max_milliseconds;
  options.transform = arguments.transform;
  options.a_asks = arguments.asks != "b";
  options.b_asks = arguments.asks != "a";
  options.as_stored = arguments.as_stored;
  options.threads = arguments.threads;
  MTDB_ASSIGN_OR_RETURN(const Json json, QueryOf(arguments.region, {}));
  MTDB_ASSIGN_OR_RETURN(const Query query, QueryFromJson(json, record));
  options.region = query.region;
  return options;
}

std::string PointText(Vec3d p) {
  char text[100];
  std::snprintf(text, sizeof(text), "%.9g %.9g %.9g", p.x, p.y, p.z);
  return text;
}

std::string IntervalText(const DistanceInterval& interval) {
  char text[100];
  std::snprintf(text, sizeof(text), "%.6g to %.6g", interval.low, interval.high);
  return text;
}

void PrintSide(const DiffArguments& arguments, const char* whose, const OneSidedDistance& side) {
  std::printf("  %s: the farthest point is %s away", whose, IntervalText(side.distance).c_str());
  if (side.point) std::printf(", at %s", PointText(*side.point).c_str());
  std::printf("\n");
  const size_t told = arguments.verbose ? side.places.size() : kPlacesTold;
  for (size_t i = 0; i < std::min(told, side.places.size()); ++i) {
    const ComparePlace& place = side.places[i];
    std::printf("    %s at %s: %s, in %s to %s\n",
                place.missing                               ? "missing"
                : place.verdict == CompareVerdict::kExceeds ? "exceeds"
                                                            : "undecided",
                PointText(place.point).c_str(), IntervalText(place.distance).c_str(),
                PointText(place.box.min).c_str(), PointText(place.box.max).c_str());
  }
  if (told < side.places.size()) {
    std::printf("    and %s more places; --verbose prints all, --csv writes them\n",
                Grouped(side.places.size() - told).c_str());
  }
}

const char* WhyUndecided(const Comparison& found) {
  return found.out_of_time ? "the time was over"
                           : "the tolerance is nearer to the distance than rounding at ingest, or "
                             "--width, tells apart";
}

void PrintComparison(const DiffArguments& arguments, const Comparison& found, double seconds) {
  if (found.identical) {
    std::printf("identical: both are copies of one object\n");
    return;
  }
  if (arguments.tolerance) {
    std::printf("%s%s%s\n",
                found.verdict == CompareVerdict::kWithin    ? "within the tolerance everywhere"
                : found.verdict == CompareVerdict::kExceeds ? "exceeds the tolerance"
                                                            : "undecided: ",
                found.verdict == CompareVerdict::kUndecided ? WhyUndecided(found) : "",
                found.verdict != CompareVerdict::kUndecided && found.out_of_time
                    ? "; the time was over before all places were decided"
                    : "");
  }
  std::printf("  distance: %s\n", IntervalText(found.distance).c_str());
  if (found.a_to_b) PrintSide(arguments, "of A from B", *found.a_to_b);
  if (found.b_to_a) PrintSide(arguments, "of B from A", *found.b_to_a);
  std::printf("  asked %s triangles; read %s of %s clusters, %.1f KB; %.1f ms in all\n",
              Grouped(found.triangles).c_str(), Grouped(found.clusters_read).c_str(),
              Grouped(found.clusters_total).c_str(), static_cast<double>(found.bytes_read) / 1e3,
              1e3 * seconds);
}

Status WritePlaces(const std::string& path, const Comparison& found) {
  std::FILE* const file = std::fopen(path.c_str(), "w");
  if (file == nullptr) return IoError(path + ": cannot be written");
  std::fprintf(file, "of,verdict,missing,low,high,x,y,z,min_x,min_y,min_z,max_x,max_y,max_z\n");
  const auto write = [&](const char* of, const std::optional<OneSidedDistance>& side) {
    if (!side) return;
    for (const ComparePlace& p : side->places) {
      std::fprintf(file,
                   "%s,%s,%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n",
                   of, VerdictName(p.verdict), p.missing ? 1 : 0, p.distance.low, p.distance.high,
                   p.point.x, p.point.y, p.point.z, p.box.min.x, p.box.min.y, p.box.min.z,
                   p.box.max.x, p.box.max.y, p.box.max.z);
    }
  };
  write("a", found.a_to_b);
  write("b", found.b_to_a);
  const bool written = std::ferror(file) == 0;
  return std::fclose(file) == 0 && written ? Status::Ok() : IoError(path + ": cannot be written");
}

// A query for what lies in the boxes of the places, as extract --query takes it, the farthest
// first. Without places there is no region, and nothing is written.
Status WriteQuery(const std::string& path, const Comparison& found) {
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
  std::FILE* const file = std::fopen(path.c_str(), "w");
  if (file == nullptr) return IoError(path + ": cannot be written");
  PrintJson({{"region", {{"union", std::move(boxes)}}}, {"threshold", "full"}, {"clip", true}},
            file);
  const bool written = std::ferror(file) == 0;
  return std::fclose(file) == 0 && written ? Status::Ok() : IoError(path + ": cannot be written");
}

// Each vertex of A with the interval of its distance, as an object of its own.
Status WriteMap(const DiffArguments& arguments, const Surface& a, const Surface& b,
                const CompareOptions& options) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.files.into[0], {.writable = true}));
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ObjectWriter> writer,
                        database->Create(arguments.files.into[1], false));
  const auto produce = [&](MeshSink& sink) { return MapDistances(a, b, options, sink); };
  BuildOptions build;
  build.threads = arguments.threads;
  build.keep_apart = true;
  return BuildObject(produce, build, *writer).status();
}

int ExitStatusOf(const DiffArguments& arguments, const Comparison& found) {
  if (!arguments.tolerance || found.verdict == CompareVerdict::kWithin) return 0;
  return found.verdict == CompareVerdict::kExceeds ? kExceedsStatus : kUndecidedStatus;
}

}  // namespace

Result<Transform> ParseTransform(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> numbers,
                        ParseNumbers(text, 16, "16 numbers, row by row, the last 0,0,0,1"));
  Transform transform{};
  std::ranges::copy(numbers, transform.begin());
  return transform;
}

Status Diff(const DiffArguments& arguments, Invocation& invocation) {
  const auto begin = std::chrono::steady_clock::now();
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> a, OpenSurface(arguments.a));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> b, OpenSurface(arguments.b));
  MTDB_ASSIGN_OR_RETURN(const CompareOptions options, OptionsOf(arguments, a->record()));
  MTDB_ASSIGN_OR_RETURN(const Comparison found, Compare(*a, *b, options));
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  if (!arguments.files.csv.empty()) MTDB_RETURN_IF_ERROR(WritePlaces(arguments.files.csv, found));
  if (!arguments.files.places_query.empty()) {
    MTDB_RETURN_IF_ERROR(WriteQuery(arguments.files.places_query, found));
  }
  if (!arguments.files.into.empty()) MTDB_RETURN_IF_ERROR(WriteMap(arguments, *a, *b, options));
  if (arguments.json) {
    Json json = ComparisonJson(a->record(), b->record(), found);
    if (!arguments.files.into.empty()) json["into"] = arguments.files.into[0];
    json["seconds"] = {{"total", seconds.count()}};
    PrintAnswer("diff", json);
  } else {
    PrintComparison(arguments, found, seconds.count());
  }
  invocation.exit_status = ExitStatusOf(arguments, found);
  return Status::Ok();
}

}  // namespace mtdb
