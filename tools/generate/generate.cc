// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/generate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "codecs/mesh_file/mesh_file.h"
#include "tools/generate/internal/ply_stream.h"
#include "tools/generate/internal/sheets.h"
#include "tools/generate/internal/surface_walker.h"
#include "tools/generate/internal/terrain.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint64_t kMinTriangles = 100;
constexpr uint64_t kMaxTriangles = 20'000'000'000;

struct Shape {
  std::string_view name;
  Status (*generate)(const GenerateOptions& options, MeshSink& sink);
  uint64_t most;  // triangles of a PLY file, for half as many vertices and 32-bit indices
};
constexpr std::array<Shape, 3> kShapes = {Shape{"sculpture", GenerateSculpture, 8'300'000'000},
                                          Shape{"terrain", GenerateTerrain, 8'500'000'000},
                                          Shape{"sheets", GenerateSheets, 8'300'000'000}};

// Trials of larger meshes count a sample of so many triangles, and one in 16 of the rest.
constexpr double kTrialTriangles = 600'000;
// Triangles times the square of the cell size, about.
constexpr double kUsualArea = 40;
constexpr double kGoodEnough = 0.008;
constexpr int kMaxTrials = 8;

Status CheckCount(const GenerateOptions& options) {
  if (options.triangles >= kMinTriangles && options.triangles <= kMaxTriangles) {
    return Status::Ok();
  }
  return InvalidArgument("cannot generate " + std::to_string(options.triangles) +
                         " triangles; ask for 100 to 20000000000");
}

// Counts what passes.
class CountingSink final : public MeshSink {
 public:
  CountingSink(MeshSink& sink, GenerateReport* report) : sink_(sink), report_(report) {}
  Status Begin(const MeshHeader& header) override { return sink_.Begin(header); }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    report_->vertices += positions.size();
    return sink_.AddVertices(positions, rows);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    report_->triangles += triangles.size();
    return sink_.AddTriangles(triangles);
  }
  Status End() override { return sink_.End(); }

 private:
  MeshSink& sink_;
  GenerateReport* report_;
};

// Drops the low half of the mantissa, which may depend on the machine's mathematical library.
double Round(double x) {
  int exponent = 0;
  const double mantissa = std::frexp(x, &exponent);
  return std::ldexp(std::round(mantissa * (1 << 20)), exponent - 20);
}

// The cell size that gives about `wanted` triangles, found by trials.
double FitCellSize(uint64_t seed, double wanted) {
  const auto sampling = static_cast<uint32_t>(wanted / (kTrialTriangles + wanted / 16)) + 1;
  double best = 0, least_off = 0;
  double cell_size = Round(std::sqrt(kUsualArea / wanted));
  for (int i = 0; i < kMaxTrials; ++i) {
    // The first guess is so rough that a rough count of it will do.
    const bool rough = i == 0 && wanted > kTrialTriangles / 4;
    SurfaceWalker walker(seed, cell_size, nullptr);
    const double count = walker.EstimateTriangles(rough ? 5 * sampling : sampling);
    const double off = std::abs(count - wanted);
    if (!rough && (best == 0 || off < least_off)) {
      best = cell_size;
      least_off = off;
      if (least_off < kGoodEnough * wanted) break;
    }
    cell_size = Round(cell_size * std::sqrt(count / wanted));
  }
  return best;
}

}  // namespace

Status GenerateSculpture(const GenerateOptions& options, MeshSink& sink) {
  MTDB_RETURN_IF_ERROR(CheckCount(options));
  const double cell_size = FitCellSize(options.seed, static_cast<double>(options.triangles));
  MTDB_RETURN_IF_ERROR(sink.Begin(MeshHeader{}));
  const auto walker = std::make_unique<SurfaceWalker>(options.seed, cell_size, &sink);
  MTDB_RETURN_IF_ERROR(walker->Walk());
  return sink.End();
}

Status GenerateTerrain(const GenerateOptions& options, MeshSink& sink) {
  MTDB_RETURN_IF_ERROR(CheckCount(options));
  return SendTerrain(options.triangles, options.seed, sink);
}

Status GenerateSheets(const GenerateOptions& options, MeshSink& sink) {
  MTDB_RETURN_IF_ERROR(CheckCount(options));
  return SendSheets(options.triangles, options.seed, sink);
}

Status GenerateFile(std::string_view shape, const GenerateOptions& options,
                    const std::string& output_path, GenerateReport* report) {
  GenerateReport unused;
  const auto* const made = std::find_if(kShapes.begin(), kShapes.end(),
                                        [&](const Shape& each) { return each.name == shape; });
  if (made == kShapes.end()) {
    return InvalidArgument("no shape \"" + std::string(shape) +
                           "\"; choose sculpture, terrain or sheets");
  }
  MTDB_RETURN_IF_ERROR(CheckCount(options));
  if (options.triangles > made->most) {
    return InvalidArgument(output_path + ": 32-bit PLY indices end at some " +
                           std::to_string(made->most) + " triangles; ask for fewer than " +
                           std::to_string(options.triangles));
  }
  const auto generate = [&](MeshSink& sink) {
    CountingSink counting(sink, report == nullptr ? &unused : report);
    return made->generate(options, counting);
  };
  MTDB_ASSIGN_OR_RETURN(const MeshFormat format, WrittenMeshFormatOf(output_path));
  if (format.name == "PLY") {
    PlyStreamWriter writer(output_path);
    return generate(writer);
  }
  // The others want to know the counts first.
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MTDB_RETURN_IF_ERROR(generate(sink));
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<MeshFileWriter> writer,
                        CreateMeshFileWriter(output_path));
  return SendMesh(mesh, *writer);
}

}  // namespace mtdb
