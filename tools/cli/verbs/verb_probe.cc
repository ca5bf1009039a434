// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cstdio>

#include "query/probe.h"
#include "store/database.h"
#include "tools/cli/grouped.h"
#include "tools/cli/options.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/probe_arguments.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

void PrintProbe(const ProbeArguments& arguments, const ObjectRecord& record,
                const ProbeAnswer& answer, double seconds) {
  if (arguments.json) {
    Json json = ProbeJson(record, answer, arguments.ray.has_value());
    json["seconds"] = {{"total", seconds}};
    PrintAnswer("probe", json);
    return;
  }
  if (answer.hit) {
    const ProbeHit& hit = *answer.hit;
    std::printf("%.9g %.9g %.9g: distance %.9g, from %s, error at most %.6g\n", hit.point.x,
                hit.point.y, hit.point.z, hit.distance, hit.front ? "outside" : "inside",
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

Status Probe(const ProbeArguments& arguments) {
  if (!arguments.heights.empty() || !arguments.heights_file.empty()) return ProbeHeights(arguments);
  const auto begin = std::chrono::steady_clock::now();
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source,
                        database->OpenObject(arguments.name));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, Surface::Open(std::move(source)));
  ProbeOptions options;
  options.error_model = ErrorModelOf(arguments.error, surface->record().diagonal());
  if (arguments.limit) options.limit = *arguments.limit;
  Result<ProbeAnswer> answer =
      arguments.ray ? CastRay(*surface, arguments.ray->origin, arguments.ray->direction, options)
                    : FindClosestPoint(*surface, *arguments.point, options);
  if (!answer) return answer.status();
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  PrintProbe(arguments, surface->record(), *answer, seconds.count());
  return Status::Ok();
}

RunVerb AddProbe(VerbOptions* verb) {
  const auto a = std::make_shared<ProbeArguments>();
  verb->Add("STORE", a->store, "the store file").Required();
  AddName(verb, &a->name);
  const VerbOption point = AddParsed(verb, "--point", "X,Y,Z", &a->point, ParsePoint,
                                     "find the closest point of the surface to this one");
  AddParsed(verb, "--ray", "X,Y,Z,DX,DY,DZ", &a->ray, ParseRay,
            "find where this ray, of origin and direction, first meets the surface")
      .Excludes(point);
  AddParsedList(verb, "--height", "X,Y", &a->heights, ParsePlace,
                "of a terrain: the height there; may be repeated")
      .Excludes("--point")
      .Excludes("--ray");
  verb->Add("--heights", a->heights_file,
            "of a terrain: the heights at the places of a file, X,Y a line, or of - for "
            "standard input")
      .Form("FILE")
      .Excludes("--point")
      .Excludes("--ray")
      .Excludes("--height");
  AddParsed(verb, "--error", "E", &a->error, ParseError,
            "on a surface within E of the input, in model units, or E% of the diagonal (default: "
            "full resolution)");
  AddParsed(verb, "--limit", "D", &a->limit, ParseNonNegative,
            "look no farther: a distance, or for rays a multiple of the direction");
  AddJson(verb, &a->json);
  verb->CheckAll([a]() -> Status {
    if (!a->point && !a->ray && a->heights.empty() && a->heights_file.empty()) {
      return InvalidArgument("probe: give --point, --ray, --height or --heights");
    }
    return Status::Ok();
  });
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation&) { return Probe(*a); };
}

}  // namespace

const Verb kProbeVerb{"probe", "find the closest point of a surface, or the first hit of a ray",
                      "Example: mtdb probe scans.mtdb --ray 0,0,500,0,0,-1 --error 0.5", AddProbe};

}  // namespace mtdb
