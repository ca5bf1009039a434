// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cstdio>

#include "query/probe.h"
#include "store/database.h"
#include "tools/cli/grouped.h"
#include "tools/cli/verbs.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

void PrintProbe(const ProbeArguments& arguments, const ObjectRecord& record,
                const ProbeAnswer& answer, double seconds) {
  const char* const measure = arguments.ray ? "parameter" : "distance";
  if (arguments.json) {
    Json json = ProbeJson(record, answer, arguments.ray.has_value());
    json["seconds"] = {{"total", seconds}};
    PrintAnswer("probe", json);
    return;
  }
  if (answer.hit) {
    const ProbeHit& hit = *answer.hit;
    std::printf("%.9g %.9g %.9g: %s %.9g, from %s, error at most %.6g\n", hit.point.x, hit.point.y,
                hit.point.z, measure, hit.distance, hit.front ? "outside" : "inside",
                answer.error_bound);
    if (answer.excess > 0) {
      std::printf(
          "  NOT MET: %.6g above the error that was asked for; positions were rounded by "
          "more when the object was ingested; ingest it with more --bits, or --lossless\n",
          answer.excess);
    }
  } else {
    std::printf("%s\n", arguments.ray ? "the ray does not hit the surface"
                                      : "the surface is farther away than that");
  }
  std::printf("  read %s of %u clusters, %.1f KB; %.1f ms in all\n",
              Grouped(answer.clusters_read).c_str(), record.clusters,
              static_cast<double>(answer.bytes_read) / 1e3, 1e3 * seconds);
}

}  // namespace

Status Probe(const ProbeArguments& arguments) {
  if (!arguments.heights.empty() || !arguments.heights_file.empty()) return ProbeHeights(arguments);
  const auto begin = std::chrono::steady_clock::now();
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source,
                        database->OpenObject(arguments.name));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, Surface::Open(std::move(source)));
  ProbeOptions options;
  if (arguments.error) options.error_model = *arguments.error;
  if (arguments.limit) options.limit = *arguments.limit;
  Result<ProbeAnswer> answer =
      arguments.ray ? CastRay(*surface, arguments.ray->origin, arguments.ray->direction, options)
                    : FindClosestPoint(*surface, *arguments.point, options);
  if (!answer) return answer.status();
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  PrintProbe(arguments, surface->record(), *answer, seconds.count());
  return Status::Ok();
}

}  // namespace mtdb
