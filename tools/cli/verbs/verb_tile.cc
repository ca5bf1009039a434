// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "query/surface.h"
#include "store/database.h"
#include "tools/cli/grouped.h"
#include "tools/cli/machine.h"
#include "tools/cli/options.h"
#include "tools/cli/progress.h"
#include "tools/cli/verbs.h"
#include "tools/request/report_json.h"
#include "tools/tiles/geodesy.h"
#include "tools/tiles/quantized_mesh.h"
#include "tools/tiles/three_d_tiles.h"
#include "tools/tiles/tile_placement.h"
#include "tools/tiles/tile_set.h"

namespace mtdb {

namespace {

constexpr uint64_t kLeastMemory = uint64_t{256} << 20;

struct TileArguments {
  std::string store;
  OpenOptions open;
  std::string output;  // a folder
  std::string name;
  std::string format = "3dtiles";
  std::optional<GlobePlace> at;            // 3dtiles
  std::optional<double> pixels;            // 3dtiles
  std::optional<uint64_t> tile_triangles;  // 3dtiles
  bool mercator = false;                   // quantized-mesh
  std::optional<uint32_t> max_level;       // quantized-mesh
  std::optional<uint64_t> memory_bytes;    // none: a quarter of the machine's
  unsigned threads = 0;                    // 0: one per core
  std::string tmp;                         // folder of temporary files; empty: the output
  bool force = false, quiet = false, json = false;
};

Result<GlobePlace> ParseGlobePlace(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 3, "LON,LAT,HEIGHT"));
  if (std::abs(n[0]) > 360 || std::abs(n[1]) > 90) {
    return Unexpected(text, "LON,LAT,HEIGHT in degrees and metres, LAT from -90 to 90");
  }
  return GlobePlace{n[0], n[1], n[2]};
}

Result<uint64_t> ParseTileTriangles(const std::string& text) {
  const auto count = ParseCount(text);
  if (!count.ok() || (*count >= 100 && *count <= 10'000'000)) return count;
  return Unexpected(text, "a number from 100 to 10000000");
}

// `*identity`: what the tiles follow from, beside the object.
Result<std::unique_ptr<TileFormat>> FormatOf(const TileArguments& arguments,
                                             const ObjectRecord& record, Json* identity) {
  if (arguments.format == "quantized-mesh") {
    if (arguments.at || arguments.pixels || arguments.tile_triangles) {
      return InvalidArgument(
          "--at, --pixels, --tile-triangles: are for 3dtiles; quantized-mesh has places and "
          "levels of its own");
    }
    *identity = {{"mercator", arguments.mercator},
                 {"max_level", arguments.max_level ? Json(*arguments.max_level) : Json()}};
    return MakeQuantizedMesh(record, {arguments.mercator, arguments.max_level});
  }
  if (arguments.mercator || arguments.max_level) {
    return InvalidArgument("--mercator, --max-level: are for --as quantized-mesh");
  }
  ThreeDTilesOptions options;
  options.at = arguments.at;
  options.pixels = arguments.pixels.value_or(options.pixels);
  options.tile_triangles = arguments.tile_triangles.value_or(options.tile_triangles);
  *identity = {{"pixels", options.pixels}, {"tile_triangles", options.tile_triangles}};
  if (const auto& at = options.at) {
    (*identity)["at"] = {at->longitude, at->latitude, at->height};
  }
  return MakeThreeDTiles(record, options);
}

Json NotesOf(const TileArguments& arguments, const ObjectRecord& record) {
  Json notes(Json::Array{});
  if (arguments.format == "quantized-mesh" || IsInDegrees(record)) {
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

void PrintTileReport(const TileArguments& arguments, const ObjectRecord& record,
                     const TileSetReport& report, double seconds) {
  const Json notes = NotesOf(arguments, record);
  TileLevel sum;
  Json levels(Json::Array{});
  for (const TileLevel& level : report.levels) {
    sum.tiles += level.tiles;
    sum.written_triangles += level.written_triangles;
    sum.bytes += level.bytes;
    levels.push_back({{"error_bound", level.error_bound},
                      {"triangles", level.triangles},
                      {"tiles", level.tiles},
                      {"written_triangles", level.written_triangles},
                      {"bytes", level.bytes}});
  }
  if (arguments.json) {
    PrintAnswer("tile", {{"object", record.name},
                         {"digest", record.digest_hex()},
                         {"output", arguments.output},
                         {"format", arguments.format},
                         {"levels", std::move(levels)},
                         {"levels_found", report.levels_found},
                         {"tiles", sum.tiles},
                         {"triangles", sum.written_triangles},
                         {"bytes", sum.bytes + report.file_bytes},
                         {"notes", notes},
                         {"seconds", seconds}});
    return;
  }
  std::printf("%s: %s tiles of %s in %zu levels, %s triangles, %s, in %.3g s\n",
              arguments.output.c_str(), Grouped(sum.tiles).c_str(), record.name.c_str(),
              report.levels.size(), Grouped(sum.written_triangles).c_str(),
              SizeText(sum.bytes + report.file_bytes).c_str(), seconds);
  for (size_t i = 0; i < report.levels.size(); ++i) {
    const TileLevel& level = report.levels[i];
    std::printf("  level %zu: %s tiles, %s triangles, error at most %.6g\n", i,
                Grouped(level.tiles).c_str(), Grouped(level.triangles).c_str(), level.error_bound);
  }
  for (const Json& note : notes.elements()) {
    std::printf("  WARNING: %s\n", note.string()->c_str());
  }
}

Status Tile(const TileArguments& arguments) {
  const auto begin = std::chrono::steady_clock::now();
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source,
                        database->OpenObject(arguments.name));
  const uint64_t memory =
      arguments.memory_bytes.value_or(std::max(MachineMemory() / 4, kLeastMemory));
  SurfaceOptions surface_options;
  surface_options.cache_bytes = memory / 2;
  surface_options.threads = arguments.threads;
  surface_options.tmp_directory = arguments.tmp;
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface,
                        Surface::Open(std::move(source), surface_options));
  const ObjectRecord& record = surface->record();
  TileSetOptions options;
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<TileFormat> format,
                        FormatOf(arguments, record, &options.identity));
  ProgressLine line(arguments.quiet || arguments.json);
  options.memory_bytes = memory / 4;
  options.threads = arguments.threads != 0 ? arguments.threads
                                           : std::max(std::thread::hardware_concurrency(), 1u);
  options.tmp_directory = arguments.tmp.empty() ? arguments.output : arguments.tmp;
  options.force = arguments.force;
  options.progress = [&](double part, const std::string& what) {
    line.Update(part, what);
    return Status::Ok();
  };
  MTDB_ASSIGN_OR_RETURN(const TileSetReport report,
                        WriteTileSet(*surface, arguments.output, *format, options));
  line.Finish();
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  PrintTileReport(arguments, record, report, seconds.count());
  return Status::Ok();
}

RunVerb AddTile(VerbOptions* verb) {
  const auto a = std::make_shared<TileArguments>();
  verb->Add("STORE", a->store, "the store file, or a packed file or its URL").Required();
  IsWritten(verb->Add("FOLDER", a->output,
                      "the folder of the tiles; made if it is not there, gone on with where "
                      "it has some of the same"))
      .Required();
  AddName(verb, &a->name);
  verb->Add("--as", a->format, "3dtiles: 3D Tiles 1.1; quantized-mesh: of a terrain in degrees")
      .Form("FORMAT")
      .OneOf({"3dtiles", "quantized-mesh"});
  AddParsed(verb, "--at", "LON,LAT,HEIGHT", &a->at, ParseGlobePlace,
            "3dtiles: put the middle of the object's floor there: degrees, and metres above the "
            "ellipsoid");
  AddParsed(
      verb, "--pixels", "P", &a->pixels, ParsePositive,
      "3dtiles: make clients refine where the true bound covers P pixels; 16 tells it as it is, "
      "since they have 16 set (default: 2)");
  AddParsed(verb, "--tile-triangles", "N", &a->tile_triangles, ParseTileTriangles,
            "3dtiles: about N triangles a tile (default: 50000)");
  verb->AddFlag("--mercator", a->mercator, "quantized-mesh: tiles of Web Mercator, not of degrees");
  verb->Add("--max-level", a->max_level,
            "quantized-mesh: levels 0 to N (default: as fine as the raster)")
      .Form("N")
      .Between(0, 22);
  verb->Add("--threads", a->threads, "use N threads (default: one per core)")
      .Form("N")
      .Between(1, 1024);
  AddParsed(verb, "--memory", "SIZE", &a->memory_bytes, ParseMemory,
            "use at most so much memory, the rest goes to temporary files, e.g. 1G; at least 256M "
            "(default: a quarter of the machine's)");
  verb->Add("--tmp", a->tmp, "folder of temporary files (default: FOLDER)").Form("DIR");
  verb->AddFlag("--replace", a->force, "replace tiles of another object, version or accuracy");
  AddJson(verb, &a->json);
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation& invocation) {
    a->quiet = invocation.quiet;
    return Tile(*a);
  };
}

}  // namespace

const Verb kTileVerb{"tile", "write tiles for Cesium, QGIS, three.js and others",
                     "Examples: mtdb tile scans.mtdb www/statue --at 11.57,48.14,520\n"
                     "          mtdb tile alps.mtdb www/alps --as quantized-mesh\n"
                     "More: docs/tiles.md",
                     AddTile};

}  // namespace mtdb
