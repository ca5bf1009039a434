// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/internal/terrain.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "tools/generate/noise.h"

namespace mtdb::internal {
namespace {

constexpr double kExtent = 10;
constexpr double kWavelength = 4.6;
constexpr float kGain = 0.5f;
constexpr double kFinestWavelengthCells = 3;
constexpr size_t kBlock = 65536;

// The plane turned by an angle of a 3-4-5 triangle and shrunk by half: the next octave's lattice.
void NextOctave(float* x, float* y) {
  const float u = 1.6f * *x + 1.2f * *y;
  *y = 1.6f * *y - 1.2f * *x;
  *x = u;
}

class Grid {
 public:
  Grid(uint64_t triangles, uint64_t seed) : seed_(seed) {
    const double cells = static_cast<double>(triangles) / 2;
    columns_ = std::max<uint64_t>(1, static_cast<uint64_t>(std::sqrt(cells)));
    rows_ = std::max<uint64_t>(
        1, static_cast<uint64_t>(std::round(cells / static_cast<double>(columns_))));
  }
  uint64_t vertex_count() const { return (columns_ + 1) * (rows_ + 1); }
  uint64_t triangle_count() const { return columns_ * rows_ * 2; }
  uint64_t columns() const { return columns_; }
  uint64_t rows() const { return rows_; }
  uint64_t VertexAt(uint64_t column, uint64_t row) const { return row * (columns_ + 1) + column; }
  Vec3d PositionAt(uint64_t column, uint64_t row) const {
    const double step = kExtent / static_cast<double>(columns_);
    const double x = kExtent * static_cast<double>(column) / static_cast<double>(columns_);
    const double y = kExtent * static_cast<double>(row) / static_cast<double>(rows_);
    const double z = TerrainHeight(seed_, x, y, kFinestWavelengthCells * step);
    return {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
  }

 private:
  uint64_t seed_;
  uint64_t columns_ = 0, rows_ = 0;
};

}  // namespace

double TerrainHeight(uint64_t seed, double x, double y, double finest_wavelength) {
  auto u = static_cast<float>(x / kWavelength);
  auto v = static_cast<float>(y / kWavelength);
  // Bend the plane a little, so that ridges wander.
  const NoiseSample2 bend_u = GradientNoise2(u * 1.3f, v * 1.3f, StreamSeed(seed, 2001));
  const NoiseSample2 bend_v = GradientNoise2(u * 1.3f, v * 1.3f, StreamSeed(seed, 2002));
  u += 0.22f * bend_u.value;
  v += 0.22f * bend_v.value;
  float height = 0, ridge_weight = 1, amplitude = 1, slope_x = 0, slope_y = 0;
  double finest_ratio = kWavelength / finest_wavelength;
  for (uint64_t k = 0; k < 32 && finest_ratio > 1; ++k, finest_ratio *= 0.5) {
    const uint32_t octave_seed = StreamSeed(seed, k);
    const float offset = 16 * UnitFloat(StreamSeed(seed, 1000 + k));
    const NoiseSample2 n = GradientNoise2(u + offset, v - offset, octave_seed);
    // The finest octave fades in.
    const auto share = static_cast<float>(std::min(1.0, finest_ratio - 1));
    slope_x += n.dx * share * 0.55f;
    slope_y += n.dy * share * 0.55f;
    const float damping = 1 / (1 + slope_x * slope_x + slope_y * slope_y);
    const float ridge = 1 - std::min(1.0f, 1.6f * std::abs(n.value));
    const float ridged = ridge * ridge * ridge_weight;
    height += share * amplitude * (0.85f * n.value * damping + 0.36f * (ridged - 0.35f));
    ridge_weight = std::clamp(1.7f * ridged, 0.12f, 1.0f);
    amplitude *= kGain;
    NextOctave(&u, &v);
  }
  return 1.25 * height;
}

Status SendTerrain(uint64_t triangles, uint64_t seed, MeshSink& sink) {
  const Grid grid(triangles, seed);
  MeshHeader header;
  header.vertex_count = grid.vertex_count();
  header.triangle_count = grid.triangle_count();
  MTDB_RETURN_IF_ERROR(sink.Begin(header));
  std::vector<Vec3d> vertices;
  std::vector<TriangleVertices> faces;
  std::vector<double> heights(grid.columns() + 1), heights_before(grid.columns() + 1);
  for (uint64_t row = 0; row <= grid.rows(); ++row) {
    std::swap(heights, heights_before);
    for (uint64_t column = 0; column <= grid.columns(); ++column) {
      vertices.push_back(grid.PositionAt(column, row));
      heights[column] = vertices.back().z;
      if (vertices.size() == kBlock) {
        MTDB_RETURN_IF_ERROR(sink.AddVertices(vertices, {}));
        vertices.clear();
      }
    }
    if (row == 0) continue;
    if (!vertices.empty()) MTDB_RETURN_IF_ERROR(sink.AddVertices(vertices, {}));
    vertices.clear();
    for (uint64_t column = 0; column < grid.columns(); ++column) {
      const uint64_t a = grid.VertexAt(column, row - 1), b = a + 1;
      const uint64_t d = grid.VertexAt(column, row), c = d + 1;
      // The flatter diagonal.
      if (std::abs(heights_before[column] - heights[column + 1]) <=
          std::abs(heights_before[column + 1] - heights[column])) {
        faces.push_back({a, b, c});
        faces.push_back({a, c, d});
      } else {
        faces.push_back({a, b, d});
        faces.push_back({b, c, d});
      }
      if (faces.size() + 2 > kBlock || column + 1 == grid.columns()) {
        MTDB_RETURN_IF_ERROR(sink.AddTriangles(faces));
        faces.clear();
      }
    }
  }
  return sink.End();
}

}  // namespace mtdb::internal
