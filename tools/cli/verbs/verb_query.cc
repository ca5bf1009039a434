// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cstdio>
#include <unistd.h>
#include <utility>

#include "codecs/mesh_file/mesh_file.h"
#include "query/query_from_json.h"
#include "query/surface.h"
#include "tools/cli/options.h"
#include "tools/cli/query_report.h"
#include "tools/cli/raster_output.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/drape.h"
#include "tools/request/mesh_output.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

using Clock = std::chrono::steady_clock;
double SecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// Passes a mesh on to a writer and takes the time that the writer needs.
class TimedSink final : public MeshSink {
 public:
  explicit TimedSink(MeshSink& sink) : sink_(sink) {}
  Status Begin(const MeshHeader& header) override {
    return Timed([&] { return sink_.Begin(header); });
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    return Timed([&] { return sink_.AddVertices(positions, rows); });
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    return Timed([&] { return sink_.AddTriangles(triangles); });
  }
  Status AddCorners(std::span<const TextureCorner> corners) override {
    return Timed([&] { return sink_.AddCorners(corners); });
  }
  Status End() override {
    return Timed([&] { return sink_.End(); });
  }
  double LargestRounding(const MeshHeader& header) const override {
    return sink_.LargestRounding(header);
  }
  double rounding() const override { return sink_.rounding(); }
  double seconds() const { return seconds_; }

 private:
  template <typename Call>
  Status Timed(Call&& call) {
    const Clock::time_point begin = Clock::now();
    Status status = call();
    seconds_ += SecondsSince(begin);
    return status;
  }
  MeshSink& sink_;
  double seconds_ = 0;
};

Status Extract(const QueryArguments& arguments) {
  const Clock::time_point begin = Clock::now();
  if (IsRasterOutput(arguments.output)) return ExtractRaster(arguments);
  if (arguments.spacing || arguments.window) {
    return InvalidArgument(
        "--spacing, --window: are for rasters, whose names end in .tif, .asc or .hgt; --box and "
        "--clip give a part of a mesh");
  }
  MTDB_ASSIGN_OR_RETURN(const Json json, QueryOf(arguments.query, arguments.size));
  if (arguments.print_query) {
    PrintJson(json);
    return Status::Ok();
  }
  const bool standard = arguments.output == "-";
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenSurface(arguments));
  MeshWriteOptions write = MeshOptionsOf(surface->record(), json["normals"] == true);
  write.double_positions = arguments.double_positions;
  if (standard) write.descriptor = STDOUT_FILENO;
  const auto open = [&]() {
    return CreateMeshFileWriter(
        standard ? "standard output." + arguments.output_format : arguments.output, write);
  };
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<MeshFileWriter> writer, open());
  if (!arguments.drape.empty()) {
    if (standard) return InvalidArgument("--drape: is for files, not for standard output");
    MTDB_ASSIGN_OR_RETURN(MeshTexture texture, ReadDrape(arguments.drape, surface->record()));
    MTDB_ASSIGN_OR_RETURN(writer,
                          CreateDrapedMeshFileWriter(arguments.output, std::move(texture), write));
  }
  MTDB_ASSIGN_OR_RETURN(const Query query, QueryFromJson(json, surface->record()));
  const double open_seconds = SecondsSince(begin);
  TimedSink sink(*writer);
  MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, surface->Extract(query, sink));
  QueryReport report{json, surface->record(), stats};
  report.file = writer->report();
  report.open_seconds = open_seconds;
  report.write_seconds = sink.seconds();
  report.total_seconds = SecondsSince(begin);
  PrintQueryReport(arguments, report);
  return Status::Ok();
}

RunVerb AddExtract(VerbOptions* verb) {
  const auto a = std::make_shared<QueryArguments>();
  AddStore(verb, &a->store);
  AddOutput(verb, &a->output, true, true);
  verb->Add("--format", a->output_format,
            "the format of standard output: ply, obj, stl, off or drc")
      .Form("FORMAT")
      .Check(
          [](const std::string& text) { return FindWrittenMeshFormat(text).status().message(); });
  AddQueryOptions(verb, a.get(), false);
  verb->Add("--drape", a->drape,
            "to .glb: with this image over it (a PNG or JPEG with a world file, a GeoTIFF)")
      .Form("FILE");
  AddParsed(verb, "--spacing", "D[,DY]", &a->spacing, ParseSpacing,
            "of a terrain to .tif (with GDAL), .asc or .hgt: samples so far apart (default: the "
            "raster's own)");
  AddParsed(verb, "--window", "X0,Y0,X1,Y1", &a->window, ParseWindow,
            "of a terrain to a raster: the samples of this part");
  AddCache(verb, &a->cache_bytes, kQuarterOfMemory);
  AddImplicit(verb, &a->implicit);
  AddMeshOptions(verb, a.get());
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation& invocation) {
    a->quiet = invocation.quiet;
    return Extract(*a);
  };
}

}  // namespace

const Verb kExtractVerb{
    "extract", "write the mesh of a region at an accuracy",
    "Examples: mtdb extract scans.mtdb head.ply --error 0.5 --sphere 0,0,180,60 --clip\n"
    "          mtdb extract scans.mtdb view.ply --pixels 1 --frustum --eye 0,-900,200 "
    "--target 0,0,100\n"
    "More: docs/query.md",
    AddExtract};

}  // namespace mtdb
