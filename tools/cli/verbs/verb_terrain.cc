// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "query/heights.h"
#include "store/database.h"
#include "tools/cli/grouped.h"
#include "tools/cli/options.h"
#include "tools/cli/raster_output.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/probe_arguments.h"
#include "tools/request/read_file.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

using Place = std::array<double, 2>;

// `arguments` of any verb that reads.
template <typename Arguments>
Result<std::shared_ptr<Surface>> OpenTerrain(const Arguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source,
                        database->OpenObject(arguments.name));
  return Surface::Open(std::move(source));
}

Json HeightJson(const std::optional<double>& height) { return height ? Json(*height) : Json(); }

// "X,Y" or "X Y" a line; empty lines are skipped.
Result<std::vector<Place>> ReadPlaces(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(std::string text, ReadFile(path));
  std::istringstream in(std::move(text));
  std::vector<Place> places;
  size_t number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    std::string list;
    for (const char c : line) {
      const bool separates = c == ',' || c == ' ' || c == '\t' || c == ';' || c == '\r';
      if (!separates) {
        list += c;
      } else if (!list.empty() && list.back() != ',') {
        list += ',';
      }
    }
    while (!list.empty() && list.back() == ',') list.pop_back();
    if (list.empty()) continue;
    const auto numbers = ParseNumbers(list, 2, "X,Y");
    if (!numbers.ok()) {
      return BadInput((path == "-" ? "standard input" : path) + ": line " + std::to_string(number) +
                      ": " + numbers.status().message());
    }
    places.push_back({(*numbers)[0], (*numbers)[1]});
  }
  return places;
}

struct ProfileArguments {
  std::string store;
  OpenOptions open;
  std::string name;
  std::vector<std::array<double, 2>> line;
  std::optional<AskedError> error;
  bool json = false;
};
Result<std::vector<Place>> ParseLine(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> numbers, ParseList(text, "X0,Y0,X1,Y1,..."));
  if (numbers.size() < 4 || numbers.size() % 2 != 0) {
    return Unexpected(text, "two corners or more, X0,Y0,X1,Y1,...");
  }
  std::vector<Place> corners;
  for (size_t i = 0; i < numbers.size(); i += 2) corners.push_back({numbers[i], numbers[i + 1]});
  return corners;
}

Status FindAndPrint(const ProfileArguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenTerrain(arguments));
  HeightOptions options;
  options.error_model = ErrorModelOf(arguments.error, surface->record().diagonal());
  MTDB_ASSIGN_OR_RETURN(const Profile profile, FindProfile(*surface, arguments.line, options));
  const ObjectRecord& record = surface->record();
  if (arguments.json) {
    Json points = Json::Array();
    for (const ProfilePoint& p : profile.points) {
      points.push_back(
          {{"distance", p.distance}, {"x", p.x}, {"y", p.y}, {"height", HeightJson(p.height)}});
    }
    PrintAnswer("profile", {{"object", record.name},
                            {"points", points},
                            {"error_bound", profile.cost.error_bound},
                            {"clusters_read", profile.cost.clusters_read},
                            {"clusters_total", record.clusters},
                            {"bytes_read", profile.cost.bytes_read}});
    return Status::Ok();
  }
  std::printf("distance,x,y,height\n");
  for (const ProfilePoint& p : profile.points) {
    std::printf("%.12g,%.12g,%.12g,", p.distance, p.x, p.y);
    if (p.height) std::printf("%.9g", *p.height);
    std::printf("\n");
  }
  return Status::Ok();
}

RunVerb AddProfile(VerbOptions* verb) {
  const auto a = std::make_shared<ProfileArguments>();
  verb->Add("STORE", a->store, "the store file").Required();
  AddName(verb, &a->name);
  AddParsed(verb, "--line", "X0,Y0,X1,Y1,...", &a->line, ParseLine,
            "the line's corners, in the terrain's coordinates")
      .Required();
  AddParsed(verb, "--error", "E", &a->error, ParseError,
            "no height off by more than E, or E% of the diagonal (default: full resolution)");
  AddJson(verb, &a->json);
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation&) { return FindAndPrint(*a); };
}

}  // namespace

Status ProbeHeights(const ProbeArguments& arguments) {
  std::vector<Place> places = arguments.heights;
  if (!arguments.heights_file.empty()) {
    MTDB_ASSIGN_OR_RETURN(places, ReadPlaces(arguments.heights_file));
  }
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenTerrain(arguments));
  HeightOptions options;
  options.error_model = ErrorModelOf(arguments.error, surface->record().diagonal());
  HeightCost cost;
  Json list = Json::Array();
  MTDB_ASSIGN_OR_RETURN(const std::vector<HeightAnswer> answers,
                        FindHeights(*surface, places, options, &cost));
  for (size_t i = 0; i < places.size(); ++i) {
    const Place& p = places[i];
    const HeightAnswer& answer = answers[i];
    if (arguments.json) {
      list.push_back({{"x", p[0]},
                      {"y", p[1]},
                      {"height", HeightJson(answer.height)},
                      {"error_bound", answer.cost.error_bound}});
    } else if (answer.height) {
      std::printf("%.12g %.12g %.9g\n", p[0], p[1], *answer.height);
    } else {
      std::printf("%.12g %.12g none\n", p[0], p[1]);
    }
  }
  const ObjectRecord& record = surface->record();
  if (arguments.json) {
    PrintAnswer("heights", {{"object", record.name},
                            {"heights", list},
                            {"error_bound", cost.error_bound},
                            {"clusters_read", cost.clusters_read},
                            {"clusters_total", record.clusters},
                            {"bytes_read", cost.bytes_read}});
  } else {
    std::fprintf(stderr, "  %zu heights, error at most %.6g; read %s of %u clusters, %.1f KB\n",
                 places.size(), cost.error_bound, Grouped(cost.clusters_read).c_str(),
                 record.clusters, static_cast<double>(cost.bytes_read) / 1e3);
  }
  return Status::Ok();
}

Status ExtractRaster(const QueryArguments& arguments) {
  const QueryOptions& query = arguments.query;
  const bool others = !query.regions.empty() || query.frustum || query.outside || query.clip ||
                      query.pixels || query.error_outside || !query.errors_at.empty() ||
                      query.triangles || query.max_bytes || query.max_milliseconds ||
                      query.normals || !query.file.empty() || query.has_camera();
  if (others || arguments.print_query) {
    return InvalidArgument(arguments.output +
                           ": a raster takes --error, --spacing and --window, and no other option "
                           "that says what is asked for");
  }
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenTerrain(arguments));
  RasterOutputOptions options;
  options.spacing = arguments.spacing;
  options.window = arguments.window;
  options.heights.error_model = ErrorModelOf(query.error, surface->record().diagonal());
  MTDB_ASSIGN_OR_RETURN(const RasterOutputReport report,
                        WriteRaster(*surface, arguments.output, options));
  const double bound = report.cost.error_bound + report.rounding;
  if (arguments.json) {
    PrintAnswer("raster_file", {{"object", surface->record().name},
                                {"output", arguments.output},
                                {"columns", report.columns},
                                {"rows", report.rows},
                                {"holes", report.holes},
                                {"error_bound", bound}});
    return Status::Ok();
  }
  std::printf(
      "%s: %u x %u samples, %s of them holes; at the samples no height is off by more "
      "than %.6g\n",
      arguments.output.c_str(), report.columns, report.rows, Grouped(report.holes).c_str(), bound);
  return Status::Ok();
}

const Verb kProfileVerb{"profile", "write the heights of a terrain along a line, as CSV",
                        "Example: mtdb profile alps.mtdb --line 7.1,46.0,7.9,46.4 --error 5",
                        AddProfile};

}  // namespace mtdb
