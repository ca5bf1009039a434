// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/diff/height_report.h"

#include <chrono>
#include <cstdio>
#include <memory>

#include "query/height_change.h"
#include "store/metres_of_unit.h"
#include "tools/cli/grouped.h"
#include "tools/cli/options.h"
#include "tools/request/report_json.h"

namespace mtdb {
namespace {

void PrintInterval(const char* what, const ValueInterval& interval) {
  std::printf("  %s: %.9g to %.9g\n", what, interval.low, interval.high);
}

void PrintChange(const char* what, const LargestChange& change) {
  std::printf("  %s: %.6g to %.6g", what, change.height.low, change.height.high);
  if (change.point) {
    std::printf(", at %.9g %.9g %.9g", change.point->x, change.point->y, change.point->z);
  }
  std::printf("\n");
}

void PrintHeightChange(const DiffArguments& arguments, const ObjectRecord& a,
                       const HeightChange& found, double seconds) {
  if (found.identical) std::printf("identical: both are copies of one object\n");
  if (arguments.request.tolerance) {
    std::printf("%s\n", found.verdict == CompareVerdict::kWithin ? "within the tolerance everywhere"
                        : found.verdict == CompareVerdict::kExceeds ? "exceeds the tolerance"
                        : found.out_of_time                         ? "undecided: the time was over"
                                                                    : "undecided: the tolerance is "
                                                                      "nearer to the change than "
                                                                      "rounding at ingest tells apart");
  }
  PrintChange("B is above A by at most", found.rise);
  PrintChange("B is below A by at most", found.fall);
  PrintInterval("fill, above A and below B", found.fill_volume);
  PrintInterval("cut, below A and above B", found.cut_volume);
  PrintInterval("fill less cut", found.net_volume);
  PrintInterval("area of both", found.area_both);
  PrintInterval("area of A alone", found.area_a);
  PrintInterval("area of B alone", found.area_b);
  if (const std::array<double, 2> metres = MetresOfUnit(a); metres[1] != 1) {
    std::printf("  areas are in square degrees: a degree has %.6g by %.6g metres in the middle\n",
                metres[0], metres[1]);
  }
  std::printf("  looked at %s triangles; read %s of %s clusters, %.1f KB; %.1f ms in all%s\n",
              Grouped(found.triangles).c_str(), Grouped(found.clusters_read).c_str(),
              Grouped(found.clusters_total).c_str(), static_cast<double>(found.bytes_read) / 1e3,
              1e3 * seconds, found.out_of_time ? "; the time was over" : "");
}

}  // namespace

void AddHeights(VerbOptions* verb, DiffArguments* arguments) {
  verb->AddFlag("--heights", arguments->request.heights,
                "of two terrains: how much higher and lower B is, straight up and down, and the "
                "volumes of cut and fill, each known to within --width times the area; % is of A's "
                "range of heights");
  AddParsed(verb, "--window", "X0,Y0,X1,Y1", &arguments->request.window, ParseWindow,
            "with --heights: of this part of the plane");
}

Status CheckHeights(const DiffArguments& a) {
  std::optional<std::string> conflict = ConflictOf(a.request);
  if (a.request.heights) {
    if (!a.region.regions.empty() || a.region.frustum || a.region.outside) conflict = "box";
    if (!a.files.csv.empty()) conflict = "csv";
    if (!a.files.places_query.empty()) conflict = "places-query";
    if (!a.files.geojson.empty()) conflict = "geojson";
    if (!a.files.into.empty()) conflict = "into";
  }
  if (conflict == "max_places") conflict = "max-places";
  if (!conflict) return Status::Ok();
  if (!a.request.heights) return InvalidArgument("--" + *conflict + ": needs --heights");
  if (*conflict == "box") return InvalidArgument("--heights: takes no region, but a --window");
  return InvalidArgument("--" + *conflict + ": does not go with --heights");
}

Status DiffHeights(const DiffArguments& arguments, Invocation& invocation) {
  const auto begin = std::chrono::steady_clock::now();
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> a, OpenSurface(arguments.a));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> b, OpenSurface(arguments.b));
  HeightChangeOptions options = HeightChangeOptionsOf(arguments.request, a->record());
  options.threads = arguments.threads;
  MTDB_ASSIGN_OR_RETURN(const HeightChange found, CompareHeights(*a, *b, options));
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  if (arguments.json) {
    Json json = HeightChangeJson(a->record(), b->record(), found);
    json["seconds"] = {{"total", seconds.count()}};
    PrintAnswer("height_change", json);
  } else {
    PrintHeightChange(arguments, a->record(), found, seconds.count());
  }
  invocation.exit_status = DiffStatus(arguments.request.tolerance.has_value(), found.verdict);
  return Status::Ok();
}

}  // namespace mtdb
