// SPDX-License-Identifier: Apache-2.0
// consumer_show FOLDER: stores an array of heights as a terrain, packs it, reads the packed file
// over a carrier, draws what is in it, and serves it.
#include <algorithm>
#include <cstdio>
#include <fstream>

#include "builder/build.h"
#include "query/heights.h"
#include "query/surface.h"
#include "store/database.h"
#include "store/packed_file.h"
#include "store/range_reader.h"
#include "tools/gdal/raster_input.h"
#include "tools/render/render.h"
#include "tools/render/view.h"
#include "tools/server/server.h"

namespace {

class Hill final : public mtdb::RasterReader {
 public:
  Hill() {
    path_ = "hill";
    info_.format = "array";
    info_.frame.columns = 12;
    info_.frame.rows = 9;
    info_.frame.geotransform = {0, 1, 0, 0, 0, -1};
    info_.frame.transform_of_samples = true;
    info_.frame.sample_type = "int32";
    info_.height_step = 1;
  }
  mtdb::Status ReadRow(uint32_t row, std::span<double> heights) override {
    for (size_t i = 0; i < heights.size(); ++i) {
      heights[i] = static_cast<double>(std::min<size_t>(i, 12 - i) * std::min(row, 9 - row));
    }
    return mtdb::Status::Ok();
  }
};

mtdb::Status Store(const std::string& path) {
  std::vector<std::unique_ptr<mtdb::RasterReader>> files;
  files.push_back(std::make_unique<Hill>());
  mtdb::BuildOptions build;
  MTDB_ASSIGN_OR_RETURN(
      const auto raster,
      mtdb::RasterInput::Join(std::move(files),
                              {.height_step = {}, .memory_bytes = build.memory_bytes}));
  build.terrain = raster->terrain();
  MTDB_ASSIGN_OR_RETURN(const auto database, mtdb::Database::Open(path, {.writable = true}));
  MTDB_ASSIGN_OR_RETURN(const auto writer, database->Create("hill", false));
  return mtdb::BuildObject([&](mtdb::MeshSink& sink) { return raster->Read(sink); }, build, *writer)
      .status();
}

mtdb::Status Pack(const std::string& store, const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const auto database, mtdb::Database::Open(store));
  MTDB_ASSIGN_OR_RETURN(const auto source, database->OpenObject("hill", true));
  std::ofstream out(path, std::ios::binary);
  return mtdb::PackObjects(std::vector{source},
                           [&](mtdb::ByteSpan bytes) {
                             out.write(reinterpret_cast<const char*>(bytes.data()),
                                       static_cast<std::streamsize>(bytes.size()));
                             return mtdb::Status::Ok();
                           })
      .status();
}

mtdb::Status Run(const std::string& folder) {
  const std::string packed = folder + "/hill.mtdbp";
  MTDB_RETURN_IF_ERROR(Store(folder + "/hill.mtdb"));
  MTDB_RETURN_IF_ERROR(Pack(folder + "/hill.mtdb", packed));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<mtdb::RangeReader> carrier, mtdb::OpenFileRanges(packed));
  MTDB_ASSIGN_OR_RETURN(const auto objects, mtdb::PackedObjects::Open(std::move(carrier)));
  MTDB_ASSIGN_OR_RETURN(const auto source, objects->OpenObject("hill"));
  MTDB_ASSIGN_OR_RETURN(const auto surface, mtdb::Surface::Open(source));
  MTDB_ASSIGN_OR_RETURN(const mtdb::HeightRaster samples,
                        mtdb::RasterSamples(surface->record(), {}, {}));
  mtdb::TriangleMesh mesh;
  mtdb::TriangleMeshSink sink(&mesh);
  MTDB_RETURN_IF_ERROR(surface->Extract({}, sink).status());
  mtdb::RenderOptions style;
  style.width = 60;
  style.height = 40;
  style.view_direction = mtdb::ViewDirection("iso", style.up, mesh.positions);
  mtdb::RenderImage picture;
  MTDB_RETURN_IF_ERROR(mtdb::RenderMesh(mesh, style, &picture));
  mtdb::ServerOptions serving;
  serving.service.store = packed;
  serving.listen.port = 0;
  MTDB_ASSIGN_OR_RETURN(const auto server, mtdb::BackgroundServer::Start(serving));
  std::printf("%s serves %u x %u samples, drawn in %d x %d pixels\n", server->url().c_str(),
              samples.columns, samples.rows, picture.width, picture.height);
  return server->Stop(0);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const mtdb::Status status = Run(argv[1]);
  if (!status.ok()) return std::fprintf(stderr, "%s\n", status.message().c_str()), 1;
  return 0;
}
