// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/query_report.h"

#include <algorithm>
#include <cstdio>

#include "store/database.h"
#include "tools/cli/grouped.h"
#include "tools/cli/machine.h"
#include "tools/client/shortfall_json.h"
#include "tools/request/mesh_output.h"
#include "tools/request/report_json.h"
#include "tools/request/root_reason.h"

namespace mtdb {

namespace {

constexpr uint64_t kLeastCache = uint64_t{64} << 20;

// What could not be given as asked, besides a shortfall: lines to print, and the fields of JSON.
struct Remarks {
  bool region_missed = false;  // nothing of the surface is in the region
  Json unmet_limit;            // null: the limits were kept
  std::string text;
};

Remarks RemarksOn(const Json& query, const ObjectRecord& record, const ExtractStats& stats) {
  Remarks r;
  char line[512];
  if (query.contains("region") && stats.active_triangles == 0) {
    r.region_missed = true;
    const Box3d& b = record.bounds;
    std::snprintf(line, sizeof(line),
                  "  WARNING: nothing of the surface is in the region, so %s; the surface lies "
                  "within %.9g %.9g %.9g to %.9g %.9g %.9g\n",
                  stats.triangles == 0 ? "the mesh is empty" : "the mesh is as coarse as it goes",
                  b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z);
    r.text += line;
  }
  const uint64_t* const limit = query["max_triangles"].whole_number();
  if (limit != nullptr && record.root_triangles > *limit) {
    const uint64_t most = *limit;
    const std::string why = RootReasonText(record);
    r.unmet_limit = {{"max_triangles", most}, {"least", record.root_triangles}, {"reason", why}};
    std::snprintf(line, sizeof(line),
                  "  WARNING: the limit of %s triangles cannot be kept: the coarsest mesh has "
                  "%s; %s\n",
                  Grouped(most).c_str(), Grouped(record.root_triangles).c_str(), why.c_str());
    r.text += line;
  }
  return r;
}

Json ReportJson(const QueryArguments& arguments, const QueryReport& report,
                const Remarks& remarks) {
  const ExtractStats& stats = report.stats;
  const ObjectRecord& record = report.record;
  Json json = {{"object", record.name},
               {"output", arguments.output},
               {"triangles", stats.triangles},
               {"vertices", stats.vertices},
               {"active_triangles", stats.active_triangles},
               {"error_bound", stats.error_bound},
               {"error_bound_outside",
                stats.error_bound_outside ? Json(*stats.error_bound_outside) : Json()},
               {"shortfall", ShortfallJson(stats.shortfall)},
               {"region_missed", remarks.region_missed},
               {"unmet_limit", remarks.unmet_limit},
               {"limit", LimitName(stats.limit)},
               {"nodes_visited", stats.nodes_visited},
               {"nodes_applied", stats.nodes_applied},
               {"nodes_forced", stats.nodes_forced},
               {"clusters_read", stats.clusters_read},
               {"clusters_cached", stats.clusters_cached},
               {"clusters_used", stats.clusters_used},
               {"clusters_total", stats.clusters_total},
               {"bytes_read", stats.bytes_read},
               {"seconds",
                {{"open", report.open_seconds},
                 {"select", stats.seconds.select},
                 {"load", stats.seconds.load},
                 {"read", stats.seconds.read},
                 {"decode", stats.seconds.decode},
                 {"emit", std::max(0.0, stats.seconds.emit - report.write_seconds)},
                 {"write", report.write_seconds},
                 {"total", report.total_seconds}}}};
  if (report.file) json.Update(MeshFileJson(*report.file));
  if (!report.picture.is_null()) json["picture"] = report.picture;
  return json;
}

}  // namespace

Result<std::shared_ptr<Surface>> OpenSurface(const QueryArguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source,
                        database->OpenObject(arguments.name));
  SurfaceOptions options;
  options.cache_bytes = arguments.cache_bytes.value_or(std::max(MachineMemory() / 4, kLeastCache));
  if (arguments.implicit) options.form = RuntimeForm::kImplicit;
  return Surface::Open(std::move(source), options);
}

bool TellsShortfall(const Json& query, const std::string& limit) {
  const bool asks = query.contains("threshold") && query["threshold"] != "full";
  return asks || limit == LimitName(QueryLimit::kThreshold);
}

void PrintQueryReport(const QueryArguments& arguments, const QueryReport& report) {
  const ExtractStats& stats = report.stats;
  const ObjectRecord& record = report.record;
  if (arguments.quiet) return;
  // Beside a mesh on standard output.
  std::FILE* const to = arguments.output == "-" ? stderr : stdout;
  const Remarks remarks = RemarksOn(report.query, record, stats);
  if (arguments.json) {
    PrintAnswer(report.picture.is_null() ? "extract" : "render",
                ReportJson(arguments, report, remarks), to);
    return;
  }
  std::fprintf(to, "%s: %s, %s, error at most %.6g (%.3g of the diagonal)\n",
               arguments.output.c_str(), Counted(stats.triangles, "triangle", "triangles").c_str(),
               Counted(stats.vertices, "vertex", "vertices").c_str(), stats.error_bound,
               record.diagonal() > 0 ? stats.error_bound / record.diagonal() : 0.0);
  if (stats.error_bound_outside) {
    std::fprintf(to, "  that holds in the region; outside of it the error is at most %.6g\n",
                 *stats.error_bound_outside);
  }
  if (TellsShortfall(report.query, LimitName(stats.limit))) {
    std::fputs(ShortfallText(stats.shortfall, LimitName(stats.limit)).c_str(), to);
  }
  std::fputs((remarks.text + report.remarks).c_str(), to);
  if (report.file) std::fputs(MeshFileText(*report.file).c_str(), to);
  std::fprintf(to, "  read %s of %s clusters of the store (%s) in %.3g s\n",
               Grouped(stats.clusters_read).c_str(), Grouped(stats.clusters_total).c_str(),
               SizeText(stats.bytes_read).c_str(), report.total_seconds);
  if (!arguments.verbose) return;
  std::fprintf(to, "  %s triangles are in the region or within their error of it; %s\n",
               Grouped(stats.active_triangles).c_str(), LimitText(stats.limit));
  std::fprintf(
      to,
      "  looked at %s vertices that could be inserted, inserted %s, of which %s only because "
      "others need them\n",
      Grouped(stats.nodes_visited).c_str(), Grouped(stats.nodes_applied).c_str(),
      Grouped(stats.nodes_forced).c_str());
  std::fprintf(to, "  select %.1f ms, load %.1f ms, emit %.1f ms, write %.1f ms; %.1f ms in all\n",
               1e3 * stats.seconds.select, 1e3 * stats.seconds.load,
               1e3 * std::max(0.0, stats.seconds.emit - report.write_seconds),
               1e3 * report.write_seconds, 1e3 * report.total_seconds);
}

}  // namespace mtdb
