// SPDX-License-Identifier: Apache-2.0
#include "codecs/raster_file/raster_mosaic.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "store/base/coordinate_limit.h"

namespace mtdb {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kMostOff = 1e-3;  // of a cell, that a file's samples may lie off the grid
constexpr double kMostCells = 1 << 30;
// The least size of a cell beside its coordinates: ten times what questions about places leave to
// rounding.
constexpr double kLeastCell = 1e-11;

// Where the first sample lies.
std::array<double, 2> FirstSample(const RasterFrame& f) {
  const auto& g = f.geotransform;
  const double half = f.transform_of_samples ? 0 : 0.5;
  return {g[0] + half * (g[1] + g[2]), g[3] + half * (g[4] + g[5])};
}

// Why samples of the frame have no places of their own; empty: they have.
std::string Misplaced(const RasterFrame& f) {
  const auto& g = f.geotransform;
  const double area = std::abs(g[1] * g[5] - g[2] * g[4]);
  if (!(area > 0) || !std::isfinite(area)) {
    return "geotransform: columns and rows run in one direction";
  }
  const double cell = area / std::max(std::hypot(g[1], g[4]), std::hypot(g[2], g[5]));
  const double farthest =
      std::max(std::abs(g[0]) + std::abs(g[1]) * f.columns + std::abs(g[2]) * f.rows,
               std::abs(g[3]) + std::abs(g[4]) * f.columns + std::abs(g[5]) * f.rows);
  if (!(cell > kLeastCell * farthest)) {
    return "geotransform: its samples lie closer together than their coordinates can tell apart";
  }
  return "";
}

// Why two rasters cannot be one; empty: they can.
std::string Mismatch(const RasterInfo& a, const RasterInfo& b) {
  const auto& g = a.frame.geotransform;
  const auto& h = b.frame.geotransform;
  const double cells = std::max({a.frame.columns, a.frame.rows, b.frame.columns, b.frame.rows});
  const double size = std::sqrt(std::abs(g[1] * g[5] - g[2] * g[4]));
  for (const size_t i : {1, 2, 4, 5}) {
    if (std::abs(g[i] - h[i]) * cells > kMostOff * size) return "the spacing of samples differs";
  }
  if (a.crs != b.crs) return "their coordinate systems differ";
  if (a.frame.height_units != b.frame.height_units) return "the units of their heights differ";
  if (a.frame.vertical_datum != b.frame.vertical_datum) return "their vertical datums differ";
  return "";
}

// Its corners are coordinates of a mesh.
Status CheckCorners(const RasterReader& file) {
  const RasterFrame& f = file.info().frame;
  const auto& g = f.geotransform;
  for (const double column : {0.0, static_cast<double>(f.columns)}) {
    for (const double row : {0.0, static_cast<double>(f.rows)}) {
      const double x = g[0] + g[1] * column + g[2] * row;
      const double y = g[3] + g[4] * column + g[5] * row;
      if (IsCoordinate(x) && IsCoordinate(y)) continue;
      return BadInput(file.path() +
                      ": geotransform: a corner lies beyond 1e30; expected coordinates from -1e30 "
                      "to 1e30");
    }
  }
  return Status::Ok();
}

}  // namespace

Result<RasterMosaic> RasterMosaic::Join(std::vector<std::unique_ptr<RasterReader>> files) {
  for (const auto& file : files) MTDB_RETURN_IF_ERROR(CheckCorners(*file));
  RasterMosaic joined;
  joined.info_ = files.at(0)->info();
  RasterInfo& info = joined.info_;
  const auto& g = info.frame.geotransform;
  const double determinant = g[1] * g[5] - g[2] * g[4];
  for (const auto& file : files) {
    const std::string why = Misplaced(file->info().frame);
    if (!why.empty()) return BadInput(file->path() + ": " + why);
  }
  const auto origin = FirstSample(info.frame);
  std::vector<std::array<double, 2>> places;
  double left = 0, top = 0, right = 0, bottom = 0;
  for (const auto& file : files) {
    const RasterInfo& own = file->info();
    if (file != files[0]) info.notes.insert(info.notes.end(), own.notes.begin(), own.notes.end());
    std::string why = Mismatch(info, own);
    const auto first = FirstSample(own.frame);
    const double x = first[0] - origin[0], y = first[1] - origin[1];
    const double column = (x * g[5] - y * g[2]) / determinant;
    const double row = (y * g[1] - x * g[4]) / determinant;
    const bool off = std::abs(column - std::round(column)) > kMostOff ||
                     std::abs(row - std::round(row)) > kMostOff;
    if (why.empty() && off) why = "its samples lie between those of the other";
    if (!why.empty()) {
      return BadInput(file->path() + ": cannot be joined with " + files[0]->path() + ": " + why);
    }
    places.push_back({std::round(column), std::round(row)});
    left = std::min(left, places.back()[0]);
    top = std::min(top, places.back()[1]);
    right = std::max(right, places.back()[0] + own.frame.columns);
    bottom = std::max(bottom, places.back()[1] + own.frame.rows);
    info.height_step = std::min(own.height_step, info.height_step);
    // What is a hole in one file may be a height in another.
    if (own.frame.nodata != info.frame.nodata) info.frame.nodata.reset();
    if (own.frame.sample_type != info.frame.sample_type) info.frame.sample_type = "float64";
  }
  if (right - left > kMostCells || bottom - top > kMostCells) {
    return BadInput(files[0]->path() + ": more than 2^30 columns or rows");
  }
  info.frame.columns = static_cast<uint32_t>(right - left);
  info.frame.rows = static_cast<uint32_t>(bottom - top);
  for (size_t i = 0; i < files.size(); ++i) {
    // The files that begin farthest say where, so that their own numbers are kept.
    const auto& own = files[i]->info().frame.geotransform;
    if (g[2] == 0 && g[4] == 0) {
      if (places[i][0] == left) info.frame.geotransform[0] = own[0];
      if (places[i][1] == top) info.frame.geotransform[3] = own[3];
    }
    joined.parts_.push_back({std::move(files[i]), static_cast<uint32_t>(places[i][0] - left),
                             static_cast<uint32_t>(places[i][1] - top)});
  }
  if (g[2] != 0 || g[4] != 0) {
    info.frame.geotransform[0] += left * g[1] + top * g[2];
    info.frame.geotransform[3] += left * g[4] + top * g[5];
  }
  return joined;
}

Status RasterMosaic::ReadRow(uint32_t row, std::span<double> heights) {
  if (row == 0) disagreement_ = {};
  std::fill(heights.begin(), heights.end(), kNone);
  for (const Part& part : parts_) {
    const RasterFrame& f = part.file->info().frame;
    if (row < part.row || row - part.row >= f.rows) continue;
    row_.resize(f.columns);
    MTDB_RETURN_IF_ERROR(part.file->ReadRow(row - part.row, row_));
    for (uint32_t c = 0; c < f.columns; ++c) {
      if (std::isnan(row_[c])) continue;
      double& height = heights[part.column + c];
      if (std::isnan(height)) {
        height = row_[c];
        continue;
      }
      ++disagreement_.overlapping;
      const double off = std::abs(height - row_[c]);
      if (off == 0) continue;
      ++disagreement_.samples;
      disagreement_.largest = std::max(disagreement_.largest, off);
    }
  }
  return Status::Ok();
}

namespace {

constexpr uint32_t kNoSample = std::numeric_limits<uint32_t>::max();
constexpr size_t kBlock = size_t{1} << 15;

// Collects vertices and triangles into blocks.
class RasterMesh {
 public:
  RasterMesh(RasterMosaic& raster, const RasterMeshOptions& options, MeshSink& sink,
             RasterMeshReport* report)
      : raster_(raster), options_(options), sink_(sink), report_(*report) {}

  Status Send() {
    const RasterFrame& f = raster_.info().frame;
    MeshHeader header;
    header.double_positions = true;  // steps of heights may have more digits than float32
    MTDB_RETURN_IF_ERROR(sink_.Begin(header));
    std::vector<double> heights(f.columns);
    std::vector<uint32_t> above(f.columns, kNoSample);
    std::vector<uint32_t> below(f.columns, kNoSample);
    const auto read = [this](uint32_t row, std::span<double> into) {
      return raster_.ReadRow(row, into);
    };
    std::optional<HoleFiller> filler;
    if (options_.fill != 0) {
      filler.emplace(HoleFillOptions{f.columns, f.rows, options_.fill, options_.height_step,
                                     options_.height_origin},
                     read);
    }
    for (uint32_t row = 0; row < f.rows; ++row) {
      MTDB_RETURN_IF_ERROR(filler ? filler->Next(heights) : read(row, heights));
      std::swap(above, below);
      for (uint32_t c = 0; c < f.columns; ++c) {
        MTDB_RETURN_IF_ERROR(AddSample(c, row, heights[c], &below[c]));
      }
      if (row > 0) {
        // By the second number of the lattice, which may count against the rows.
        const bool flipped = f.is_flipped();
        MTDB_RETURN_IF_ERROR(AddCells(flipped ? below : above, flipped ? above : below));
      }
    }
    MTDB_RETURN_IF_ERROR(Flush());
    if (filler) {
      report_.filled = filler->report();
      report_.samples -= report_.filled.samples;
    }
    if (triangles_sent_ == 0) {
      return BadInput("the raster has no three heights beside each other, so no surface: " +
                      std::to_string(report_.samples) + " of " + std::to_string(f.columns) + " x " +
                      std::to_string(f.rows) + " samples have a height");
    }
    return sink_.End();
  }

 private:
  Status AddSample(uint32_t column, uint32_t row, double height, uint32_t* number) {
    *number = kNoSample;
    if (std::isnan(height)) {
      ++report_.holes;
      return Status::Ok();
    }
    if (report_.samples == kNoSample) {
      return BadInput("the raster has 2^32 samples or more; ingest it in parts");
    }
    *number = static_cast<uint32_t>(report_.samples++);
    const double steps = std::floor((height - options_.height_origin) / options_.height_step + 0.5);
    if (!(std::abs(steps) < kMostCells)) {
      return BadInput(
          "column " + std::to_string(column) + ", row " + std::to_string(row) + ": the height " +
          std::to_string(height) +
          " is 2^30 steps or more from the origin; if it stands for a hole, say so in the "
          "file (nodata), else choose a larger step of heights");
    }
    report_.rounding = std::max(
        report_.rounding, std::abs(options_.height_origin + options_.height_step * steps - height));
    positions_.push_back({static_cast<double>(column),
                          static_cast<double>(raster_.info().frame.LatticeRow(row)), steps});
    return positions_.size() < kBlock ? Status::Ok() : Flush();
  }

  // Between two rows, `low` with the smaller lattice number. A cell's diagonal runs from its lower
  // right to its upper left sample.
  Status AddCells(const std::vector<uint32_t>& low, const std::vector<uint32_t>& high) {
    for (size_t c = 0; c + 1 < low.size(); ++c) {
      const uint32_t a = low[c], b = low[c + 1], d = high[c], e = high[c + 1];
      const auto add = [&](uint32_t u, uint32_t v, uint32_t w) { triangles_.push_back({u, v, w}); };
      const int there = (a != kNoSample) + (b != kNoSample) + (d != kNoSample) + (e != kNoSample);
      if (there == 4) {
        add(a, b, d);
        add(b, e, d);
      } else if (there == 3) {
        if (a == kNoSample) add(b, e, d);
        if (b == kNoSample) add(a, e, d);
        if (d == kNoSample) add(a, b, e);
        if (e == kNoSample) add(a, b, d);
      }
      if (triangles_.size() >= kBlock) MTDB_RETURN_IF_ERROR(Flush());
    }
    return Status::Ok();
  }

  Status Flush() {
    if (!positions_.empty()) MTDB_RETURN_IF_ERROR(sink_.AddVertices(positions_, {}));
    if (!triangles_.empty()) MTDB_RETURN_IF_ERROR(sink_.AddTriangles(triangles_));
    triangles_sent_ += triangles_.size();
    positions_.clear();
    triangles_.clear();
    return Status::Ok();
  }

  RasterMosaic& raster_;
  const RasterMeshOptions& options_;
  MeshSink& sink_;
  RasterMeshReport& report_;
  std::vector<Vec3d> positions_;
  std::vector<TriangleVertices> triangles_;
  uint64_t triangles_sent_ = 0;
};

}  // namespace

Status SendRaster(RasterMosaic& raster, const RasterMeshOptions& options, MeshSink& sink,
                  RasterMeshReport* report) {
  *report = {};
  return RasterMesh(raster, options, sink, report).Send();
}

}  // namespace mtdb
