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
#include "tools/cli/tile_formats.h"
#include "tools/cli/verbs.h"
#include "tools/request/report_json.h"
#include "tools/tiles/archive/tile_archive.h"
#include "tools/tiles/tile_set.h"

namespace mtdb {

namespace {

constexpr uint64_t kLeastMemory = uint64_t{256} << 20;

void PrintTileReport(const TileArguments& arguments, const ObjectRecord& record,
                     const TileSetReport& report, double seconds) {
  const Json notes = TileNotesOf(arguments, record);
  TileLevel sum;
  Json levels(Json::Array{});
  for (const TileLevel& level : report.levels) {
    sum.tiles += level.tiles;
    sum.written_triangles += level.written_triangles;
    sum.bytes += level.bytes;
    levels.push_back(TileLevelJson(level));
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
              arguments.output.c_str(), Grouped(sum.tiles).c_str(),
              arguments.ids ? "several objects" : record.name.c_str(), report.levels.size(),
              Grouped(sum.written_triangles).c_str(),
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

// What all objects are tiled with.
struct TileRun {
  const TileArguments& arguments;
  const Database& database;
  uint64_t memory = 0;
  TileSetOptions options;

  Result<std::shared_ptr<Surface>> Open(const std::string& name) const {
    MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source, database.OpenObject(name));
    SurfaceOptions surface;
    surface.cache_bytes = memory / 2;
    surface.threads = arguments.threads;
    surface.tmp_directory = arguments.tmp;
    return Surface::Open(std::move(source), surface);
  }
};

// Into the folder, or into one beside the archive, which then becomes it.
Result<TileSetReport> TileObject(TileRun* run, const Surface& surface) {
  const std::string& output = run->arguments.output;
  TileSetOptions& options = run->options;
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<TileFormat> format,
                        MakeTileFormat(run->arguments, surface.record(), &options.identity));
  if (!IsTileArchive(output)) return WriteTileSet(surface, output, *format, options);
  MTDB_RETURN_IF_ERROR(CheckTileArchive(output, options.force));
  const std::string folder = output + kArchiveParts;
  if (run->arguments.tmp.empty()) options.tmp_directory = folder;
  MTDB_ASSIGN_OR_RETURN(TileSetReport report, WriteTileSet(surface, folder, *format, options));
  MTDB_RETURN_IF_ERROR(PackTiles(folder, output));
  return report;
}

Result<TileSetReport> TileSegments(TileRun* run, const std::vector<NeuroglancerSegment>& segments) {
  const auto open = [run](const ObjectRecord& record) { return run->Open(record.name); };
  NeuroglancerSetOptions set = NeuroglancerSetOf(run->arguments);
  set.sharded = run->arguments.sharded;
  return WriteNeuroglancer(segments, open, run->arguments.output, set, run->options);
}

Status Tile(const TileArguments& arguments) {
  const auto begin = std::chrono::steady_clock::now();
  MTDB_RETURN_IF_ERROR(CheckTileArguments(arguments));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  ProgressLine line(arguments.quiet || arguments.json);
  TileRun run{arguments, *database, 0, {}};
  run.memory = arguments.memory_bytes.value_or(std::max(MachineMemory() / 4, kLeastMemory));
  run.options.memory_bytes = run.memory / 4;
  run.options.threads = arguments.threads != 0 ? arguments.threads
                                               : std::max(std::thread::hardware_concurrency(), 1u);
  run.options.tmp_directory = arguments.tmp.empty() ? arguments.output : arguments.tmp;
  run.options.force = arguments.force;
  run.options.progress = [&](double part, const std::string& what) {
    line.Update(part, what);
    return Status::Ok();
  };
  TileSetReport report;
  ObjectRecord record;
  if (arguments.format == "neuroglancer") {
    MTDB_ASSIGN_OR_RETURN(const auto segments, SegmentsOf(arguments, *database));
    record = segments[0].record;
    MTDB_ASSIGN_OR_RETURN(report, TileSegments(&run, segments));
  } else {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, run.Open(arguments.name));
    record = surface->record();
    MTDB_ASSIGN_OR_RETURN(report, TileObject(&run, *surface));
  }
  line.Finish();
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  PrintTileReport(arguments, record, report, seconds.count());
  return Status::Ok();
}

// What single kinds of tiles have.
void AddFormatOptions(VerbOptions* verb, TileArguments* a) {
  AddParsed(verb, "--at", "LON,LAT,HEIGHT", &a->at, ParseGlobePlace,
            "3dtiles: put the middle of the object's floor there: degrees, and metres above the "
            "ellipsoid");
  AddParsed(verb, "--pixels", "P", &a->pixels, ParsePositive,
            "3dtiles, neuroglancer: make clients refine where the true bound covers P pixels; 16, "
            "of neuroglancer 10, tells it as it is, since they have so many set (default: 2)");
  AddParsed(verb, "--tile-triangles", "N", &a->tile_triangles, ParseTileTriangles,
            "3dtiles, neuroglancer: about N triangles a tile (default: 50000)");
  verb->AddFlag("--mercator", a->mercator, "quantized-mesh: tiles of Web Mercator, not of degrees");
  verb->Add("--max-level", a->max_level,
            "quantized-mesh, terrain-rgb: levels 0 to N (default: as fine as the raster)")
      .Form("N")
      .Between(0, int64_t{kMostTileLevel});
  verb->Add("--encoding", a->encoding,
            "terrain-rgb: what colours stand for, terrarium or mapbox (default: terrarium)")
      .Form("NAME")
      .OneOf({"terrarium", "mapbox"});
  verb->Add("--tile-pixels", a->tile_pixels,
            "terrain-rgb: tiles of so many pixels each way, 256 or 512 (default: 256)")
      .Form("N")
      .OneOf({"256", "512"});
  verb->Add("--ids", a->ids,
            "neuroglancer: these objects as segments, ID=NAME,ID=NAME; or all, where a name that "
            "is a number is the id (default: the object, as 1)")
      .Form("LIST");
  AddParsed(verb, "--resolution", "X,Y,Z", &a->resolution, ParseResolution,
            "neuroglancer: what a unit along x, y and z is in nanometres (default: the object's "
            "units)");
  verb->Add("--bits", a->bits,
            "neuroglancer: positions of so many bits a fragment, 10 or 16 (default: 16)")
      .Form("N")
      .OneOf({"10", "16"});
  verb->AddFlag("--sharded", a->sharded,
                "neuroglancer: many objects in a few files, not in two files each");
}

RunVerb AddTile(VerbOptions* verb) {
  const auto a = std::make_shared<TileArguments>();
  verb->Add("STORE", a->store, "the store file, or a packed file or its URL").Required();
  IsWritten(verb->Add("OUTPUT", a->output,
                      "the folder of the tiles; made if it is not there, gone on with where it has "
                      "some of the same; or an archive, .3tz or .pmtiles"))
      .Required();
  AddName(verb, &a->name);
  verb->Add("--as", a->format,
            "3dtiles: 3D Tiles 1.1; quantized-mesh, terrain-rgb: of a terrain in degrees; "
            "neuroglancer: multi-resolution meshes")
      .Form("FORMAT")
      .OneOf({"3dtiles", "quantized-mesh", "terrain-rgb", "neuroglancer"});
  AddFormatOptions(verb, a.get());
  verb->Add("--threads", a->threads, "use N threads (default: one per core)")
      .Form("N")
      .Between(1, 1024);
  AddParsed(verb, "--memory", "SIZE", &a->memory_bytes, ParseMemory,
            "use at most so much memory, the rest goes to temporary files, e.g. 1G; at least 256M "
            "(default: a quarter of the machine's)");
  verb->Add("--tmp", a->tmp, "folder of temporary files (default: OUTPUT)").Form("DIR");
  verb->AddFlag("--replace", a->force, "replace tiles of another object, version or accuracy");
  AddJson(verb, &a->json);
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation& invocation) {
    a->quiet = invocation.quiet;
    return Tile(*a);
  };
}

}  // namespace

const Verb kTileVerb{"tile", "write tiles for Cesium, QGIS, MapLibre, neuroglancer and others",
                     "Examples: mtdb tile scans.mtdb www/statue --at 11.57,48.14,520\n"
                     "          mtdb tile alps.mtdb www/alps --as quantized-mesh\n"
                     "          mtdb tile alps.mtdb www/alps.pmtiles --as terrain-rgb\n"
                     "          mtdb tile cells.mtdb www/cells --as neuroglancer --ids all\n"
                     "More: docs/tiles.md",
                     AddTile};

}  // namespace mtdb
