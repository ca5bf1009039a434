// SPDX-License-Identifier: Apache-2.0
// The terrain experiment of De Floriani, Magillo and Puppo (1998).
//
//   terrain_bench [--triangles T | --raster FILE [--crop N]] [--total N] [--inside N] [--frames N]
//                 [--json FILE]
//
// A viewpoint moves over a generated terrain of T triangles, or the N x N samples in the middle of
// a raster (129: 32,768 triangles, as many as then), along a line and looks ahead: the region is a
// wedge in the plane, the threshold grows linearly from 0 with the distance from the viewpoint, and
// outside of the wedge the mesh is as coarse as possible. The slope of the threshold and the angle
// of the wedge are such that on average the mesh has `total` triangles and, as near as that allows,
// `inside` of them meet the wedge.
//
// Per frame, in milliseconds of processor time, one thread, clusters in the cache: a cut from
// scratch (Surface::Select), its mesh (Cut::Emit), and a session's update from the frame before.
//
// Checks after each frame that the session applied as many nodes as Select. Exits with 1 when not.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "bench/internal/cropped_raster.h"
#include "bench/internal/workload.h"
#include "query/region.h"
#include "query/session.h"
#include "query/threshold.h"
#include "tools/gdal/raster_input.h"
#include "tools/generate/generate.h"

namespace mtdb {
namespace {

struct Setting {
  double slope = 0;
  double angle_rad = 0;
};

struct Counts {
  double total = 0;
  double inside = 0;
};

class Bench {
 public:
  Bench(std::shared_ptr<Surface> surface, const TriangleMesh& mesh, int frames)
      : surface_(std::move(surface)) {
    const Box3d& bounds = surface_->record().bounds;
    const Vec3d size = bounds.max - bounds.min;
    for (int f = 0; f < frames; ++f) {  // through the nearer half, looking at the farther one
      const double x = bounds.min.x + 0.5 * size.x;
      const double y = bounds.min.y + size.y * (0.02 + 0.4 * f / frames);
      Vec3d ground = mesh.positions[0];
      const auto off = [&](const Vec3d& p) { return std::hypot(p.x - x, p.y - y); };
      for (const Vec3d& p : mesh.positions) {
        if (off(p) < off(ground)) ground = p;
      }
      path_.push_back({x, y, ground.z});
    }
  }

  const std::vector<Vec3d>& path() const { return path_; }

  Query QueryAt(Vec3d eye, const Setting& setting) const {
    Wedge wedge;
    wedge.apex_x = eye.x;
    wedge.apex_y = eye.y;
    wedge.angle_rad = setting.angle_rad;
    Query query;
    query.region = WedgeRegion(wedge);
    query.threshold = LinearThreshold(eye, 0, setting.slope);
    return query;
  }

  // Means over some frames.
  Counts Count(const Setting& setting) const {
    Counts counts;
    const size_t step = std::max<size_t>(1, path_.size() / 8);
    double n = 0;
    for (size_t f = 0; f < path_.size(); f += step, ++n) {
      Query query = QueryAt(path_[f], setting);
      counts.total += static_cast<double>(surface_->Select(query).value().triangle_count());
      query.clip = true;
      counts.inside += static_cast<double>(surface_->Select(query).value().triangle_count());
    }
    return {counts.total / n, counts.inside / n};
  }

  // The slope at which the mesh has so many triangles at this angle.
  Setting SlopeFor(double angle_rad, double total) const {
    double low = 1e-7;
    double high = 1;
    for (int i = 0; i < 20; ++i) {
      const double slope = std::sqrt(low * high);
      (Count({slope, angle_rad}).total > total ? low : high) = slope;
    }
    return {high, angle_rad};
  }

  Setting Tune(double total, double inside) const {
    Setting best;
    double best_miss = 0;
    for (int degrees = 20; degrees <= 120; degrees += 10) {
      const Setting setting = SlopeFor(std::numbers::pi / 180 * degrees, total);
      const Counts counts = Count(setting);
      const double miss = std::abs(counts.inside - inside) + std::abs(counts.total - total);
      if (best.slope > 0 && miss >= best_miss) continue;
      best = setting;
      best_miss = miss;
    }
    return best;
  }

  // One row. Clears `right` when a session's cut is not that of Select.
  Json Measure(const Setting& setting, bool& right) const {
    const auto session = Session::Open(surface_).value();
    std::vector<UpdateBatch> batches;
    session->Update(QueryAt(path_[0], setting), &batches).value();
    double select = 0;
    double emit = 0;
    double update = 0;
    double triangles = 0;
    double inside = 0;
    double insertions = 0;
    double removals = 0;
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    for (size_t f = 1; f < path_.size(); ++f) {
      Query query = QueryAt(path_[f], setting);
      surface_->Select(query).value();  // its clusters are in the cache from now on
      const double begin = ProcessCpuSeconds();
      Cut cut = surface_->Select(query).value();
      const double selected = ProcessCpuSeconds();
      const Status status = cut.Emit(sink);
      const double emitted = ProcessCpuSeconds();
      MTDB_CHECK(status.ok(), status.message().c_str());
      const SessionUpdate moved = session->Update(query, &batches).value();
      update += ProcessCpuSeconds() - emitted;
      select += selected - begin;
      emit += emitted - selected;
      triangles += static_cast<double>(cut.triangle_count());
      insertions += static_cast<double>(moved.insertions);
      removals += static_cast<double>(moved.removals);
      right = right && session->applied_count() == cut.applied_count();
      query.clip = true;
      inside += static_cast<double>(surface_->Select(query).value().triangle_count());
    }
    const auto n = static_cast<double>(path_.size() - 1);
    return {{"experiment", surface_->record().raster ? "raster" : "terrain"},
            {"object_triangles", surface_->record().triangles},
            {"frames", path_.size()},
            {"wedge_degrees", setting.angle_rad * 180 / std::numbers::pi},
            {"slope", setting.slope},
            {"triangles", triangles / n},
            {"inside", inside / n},
            {"select_ms", 1e3 * select / n},
            {"emit_ms", 1e3 * emit / n},
            {"update_ms", 1e3 * update / n},
            {"insertions", insertions / n},
            {"removals", removals / n}};
  }

 private:
  std::shared_ptr<Surface> surface_;
  std::vector<Vec3d> path_;
};

// The mesh of the raster's middle, and how to build it.
Status ReadMiddle(const std::string& path, uint32_t crop, TriangleMesh& mesh,
                  BuildOptions& options) {
  std::vector<std::unique_ptr<RasterReader>> files(1);
  MTDB_ASSIGN_OR_RETURN(files[0], OpenRaster(path, 64 << 20));
  files[0] = std::make_unique<CroppedRaster>(std::move(files[0]), crop);
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<RasterInput> input,
                        RasterInput::Join(std::move(files), {{}, 0, uint64_t{2} << 30}));
  TriangleMeshSink sink(&mesh);
  MTDB_RETURN_IF_ERROR(input->Read(sink));
  options.terrain = input->terrain();
  return Status::Ok();
}

int Main(int argc, char** argv) {
  uint64_t triangles = 32250;
  double total = 2700;
  double inside = 1700;
  int frames = 60;
  std::string raster;
  uint32_t crop = 129;
  std::string json;
  CLI::App app("The terrain experiment of 1998.");
  app.add_option("--triangles", triangles, "Of the terrain");
  app.add_option("--raster", raster, "Instead of it: heights");
  app.add_option("--crop", crop, "Columns and rows in the raster's middle")
      ->check(CLI::Range(2, 1 << 20));
  app.add_option("--total", total, "Triangles of the mesh");
  app.add_option("--inside", inside, "Those of them in the wedge");
  app.add_option("--frames", frames, "Of the viewpoint's path")->check(CLI::Range(2, 100000));
  app.add_option("--json", json, "Write the row to a file, not to standard output");
  CLI11_PARSE(app, argc, argv);

  TriangleMesh mesh;
  BuildOptions options;
  TriangleMeshSink sink(&mesh);
  const Status status = raster.empty() ? GenerateTerrain({triangles, 1}, sink)
                                       : ReadMiddle(raster, crop, mesh, options);
  MTDB_CHECK(status.ok(), status.message().c_str());
  BenchStore store;
  store.Build("terrain", mesh, options);
  const Bench bench(store.OpenSurface("terrain", {.threads = 1}), mesh, frames);
  bool right = true;
  const Json rows = Json::array({bench.Measure(bench.Tune(total, inside), right)});
  if (!right) std::fprintf(stderr, "the session's cut is not that of Select\n");
  if (json.empty()) {
    std::printf("%s\n", rows.dump(2).c_str());
  } else {
    right = WriteRows(json, rows) && right;
  }
  return right ? 0 : 1;
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
