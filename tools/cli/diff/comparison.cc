// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/diff/comparison.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <vector>

#include "builder/build.h"
#include "store/database.h"
#include "tools/cli/diff/place_files.h"
#include "tools/cli/grouped.h"
#include "tools/request/arguments.h"
#include "tools/request/report_json.h"

namespace mtdb {
namespace {

constexpr int kExceedsStatus = 3, kUndecidedStatus = 4;
constexpr size_t kPlacesTold = 10;

Result<CompareOptions> OptionsOf(const DiffArguments& arguments, const ObjectRecord& record) {
  CompareRequest request = arguments.request;
  MTDB_ASSIGN_OR_RETURN(Json query, QueryOf(arguments.region, {}));
  request.region = query.Take("region");
  MTDB_ASSIGN_OR_RETURN(CompareOptions options, CompareOptionsOf(request, record));
  options.threads = arguments.threads;
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
    std::printf("    and %s more places; --verbose prints all, --csv and --geojson write them\n",
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
  if (arguments.request.tolerance) {
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

// All but the map.
Status WriteFiles(const DiffFiles& files, const ObjectRecord& a, const Comparison& found,
                  std::string* note) {
  if (!files.csv.empty()) MTDB_RETURN_IF_ERROR(WritePlacesCsv(files.csv, found));
  if (!files.places_query.empty()) {
    MTDB_RETURN_IF_ERROR(WritePlacesQuery(files.places_query, found));
  }
  if (files.geojson.empty()) return Status::Ok();
  return WritePlacesGeoJson(files.geojson, a.georeference, found, note);
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

}  // namespace

int DiffStatus(bool has_tolerance, CompareVerdict verdict) {
  if (!has_tolerance || verdict == CompareVerdict::kWithin) return 0;
  return verdict == CompareVerdict::kExceeds ? kExceedsStatus : kUndecidedStatus;
}

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
  std::string note;
  MTDB_RETURN_IF_ERROR(WriteFiles(arguments.files, a->record(), found, &note));
  if (!arguments.files.into.empty()) MTDB_RETURN_IF_ERROR(WriteMap(arguments, *a, *b, options));
  if (arguments.json) {
    Json json = ComparisonJson(a->record(), b->record(), found);
    if (!arguments.files.into.empty()) json["into"] = arguments.files.into[0];
    if (!note.empty()) json["notes"] = Json::Array{note};
    json["seconds"] = {{"total", seconds.count()}};
    PrintAnswer("diff", json);
  } else {
    PrintComparison(arguments, found, seconds.count());
    if (!note.empty()) std::printf("  %s\n", note.c_str());
  }
  invocation.exit_status = DiffStatus(arguments.request.tolerance.has_value(), found.verdict);
  return Status::Ok();
}

}  // namespace mtdb
