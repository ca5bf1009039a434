// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/internal/sheets_base.h"

#include <algorithm>
#include <cmath>

#include "tools/generate/noise.h"

namespace mtdb::internal {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kTube = 0.4;  // radius; that of the ring is 1
constexpr int64_t kPatchColumns = 5, kPatchRows = 2;
// Of the room that a patch has, along either axis; and the part of the patch's shorter side that
// its lost corners take.
constexpr double kPatchSide = 0.605, kLostCorner = 0.3;

// Mathematical libraries may differ in the last bits of sines, and these are dropped.
double Steady(double x) { return std::round(x * 0x1p30) * 0x1p-30; }
double Sine(double turns) { return Steady(std::sin(kTurn * turns)); }
double Cosine(double turns) { return Steady(std::cos(kTurn * turns)); }

// Dents of four sizes, one a lane.
double DentAt(Vec3d p, uint64_t seed) {
  constexpr Float4 kFrequency = {1.6f, 2.9f, 5.3f, 9.1f};
  constexpr Float4 kDepth = {0.05f, 0.022f, 0.008f, 0.003f};
  const auto lattice = [&](double x, uint64_t stream) {
    return Splat4(static_cast<float>(x)) * kFrequency +
           16 * UnitFloat(StreamSeed(seed, stream)) * Float4{1, 2, 3, 4};
  };
  const Float4 dents = kDepth * GradientNoise3(lattice(p.x, 3001), lattice(p.y, 3002),
                                               lattice(p.z, 3003), StreamSeed(seed, 3000));
  return static_cast<double>(dents[0]) + static_cast<double>(dents[1]) +
         static_cast<double>(dents[2]) + static_cast<double>(dents[3]);
}

// A patch of two-sided triangles in its room of `width` x `height` cells.
struct Patch {
  Patch(int64_t width, int64_t height)
      : columns(std::llround(kPatchSide * static_cast<double>(width))),
        rows(std::llround(kPatchSide * static_cast<double>(height))),
        first_column((width - columns) / 2),
        first_row((height - rows) / 2),
        lost(static_cast<int64_t>(kLostCorner * static_cast<double>(std::min(columns, rows)))) {}
  // A triangle with corners between the diagonals row - column = low and high has not left it.
  bool HasDiagonals(int64_t low, int64_t high) const {
    return low >= lost - columns && high <= rows - lost;
  }

  int64_t columns, rows, first_column, first_row, lost;
};

}  // namespace

Vec3d SheetsBase::PositionAt(uint64_t column, uint64_t row) const {
  const double s = static_cast<double>(column % columns_) / static_cast<double>(columns_);
  const double t = static_cast<double>(row % rows_) / static_cast<double>(rows_);
  // The grid is bent a little, so that its lines are no circles.
  const double around = s + 0.008 * Sine(3 * t);
  const double bent = t + 0.02 * Sine(2 * s);
  const Vec3d out{Cosine(bent) * Cosine(around), Cosine(bent) * Sine(around), Sine(bent)};
  const Vec3d smooth = Vec3d{Cosine(around), Sine(around), 0} + out * kTube;
  return smooth + out * DentAt(smooth, seed_);
}

Vec3d SheetsBase::NormalAt(uint64_t column, uint64_t row) const {
  const Vec3d along =
      PositionAt(column + 1, row) - PositionAt(column % columns_ + columns_ - 1, row);
  const Vec3d across = PositionAt(column, row + 1) - PositionAt(column, row % rows_ + rows_ - 1);
  const Vec3d normal = Cross(along, across);
  return normal * (1 / Length(normal));
}

std::array<TriangleVertices, 2> SheetsBase::CellAt(uint64_t column, uint64_t row) const {
  const uint64_t a = VertexAt(column, row), b = VertexAt(column + 1, row);
  const uint64_t c = VertexAt(column + 1, row + 1), d = VertexAt(column, row + 1);
  return {TriangleVertices{a, b, c}, TriangleVertices{a, c, d}};
}

std::array<bool, 2> SheetsBase::TwoSidedAt(uint64_t column, uint64_t row) const {
  const auto columns = static_cast<int64_t>(columns_), rows = static_cast<int64_t>(rows_);
  const auto i = static_cast<int64_t>(column % columns_), j = static_cast<int64_t>(row % rows_);
  // Rooms are as equal as whole numbers allow.
  const int64_t room_i = i * kPatchColumns / columns, room_j = j * kPatchRows / rows;
  const auto begin = [](int64_t room, int64_t cells, int64_t rooms) {
    return (room * cells + rooms - 1) / rooms;
  };
  const int64_t left = begin(room_i, columns, kPatchColumns);
  const int64_t bottom = begin(room_j, rows, kPatchRows);
  const Patch patch(begin(room_i + 1, columns, kPatchColumns) - left,
                    begin(room_j + 1, rows, kPatchRows) - bottom);
  const int64_t x = i - left - patch.first_column, y = j - bottom - patch.first_row;
  if (x < 0 || y < 0 || x >= patch.columns || y >= patch.rows) return {false, false};
  return {patch.HasDiagonals(y - x - 1, y - x), patch.HasDiagonals(y - x, y - x + 1)};
}

}  // namespace mtdb::internal
