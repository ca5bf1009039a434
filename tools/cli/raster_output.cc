// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/raster_output.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <memory>
#include <string_view>
#include <vector>

#include "codecs/mesh_file/atomic_file.h"
#include "tools/gdal/gdal_writer.h"

namespace mtdb {

namespace {

constexpr double kNodata = -32768;

std::string SuffixOf(const std::string& path) {
  std::string suffix = std::filesystem::path(path).extension().string();
  for (char& c : suffix) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return suffix;
}

// Takes rows from north to south.
class RowWriter {
 public:
  virtual ~RowWriter() = default;
  virtual Status Add(std::span<const double> heights) = 0;
  virtual Status End() = 0;
  // What the file has for a height.
  virtual double Written(double height) const { return height; }
};

class AsciiRows final : public RowWriter {
 public:
  AsciiRows(std::unique_ptr<AtomicFile> file, double nodata)
      : file_(std::move(file)), nodata_(nodata) {}

  Status Begin(const HeightRaster& r) {
    char text[400];
    const double south = r.y0 + (r.rows - 1) * r.dy;
    std::snprintf(text, sizeof(text), "ncols %u\nnrows %u\nxllcenter %.17g\nyllcenter %.17g\n",
                  r.columns, r.rows, r.x0, south);
    MTDB_RETURN_IF_ERROR(file_->Append(text));
    if (r.dx == -r.dy) {
      std::snprintf(text, sizeof(text), "cellsize %.17g\nNODATA_value %.12g\n", r.dx, nodata_);
    } else {
      std::snprintf(text, sizeof(text), "dx %.17g\ndy %.17g\nNODATA_value %.12g\n", r.dx, -r.dy,
                    nodata_);
    }
    return file_->Append(text);
  }
  Status Add(std::span<const double> heights) override {
    line_.clear();
    for (const double h : heights) {
      char text[40];
      std::snprintf(text, sizeof(text), "%s%.12g", line_.empty() ? "" : " ",
                    std::isnan(h) ? nodata_ : h);
      line_ += text;
    }
    line_ += '\n';
    return file_->Append(line_);
  }
  Status End() override { return file_->Commit(); }

 private:
  std::unique_ptr<AtomicFile> file_;
  const double nodata_;
  std::string line_;
};

class HgtRows final : public RowWriter {
 public:
  explicit HgtRows(std::unique_ptr<AtomicFile> file) : file_(std::move(file)) {}
  Status Add(std::span<const double> heights) override {
    line_.clear();
    for (const double h : heights) {
      const double value = std::isnan(h) ? kNodata : std::round(h);
      if (!(value >= kNodata && value <= 32767)) {
        return InvalidArgument("a height of " + std::to_string(h) + " does not fit .hgt");
      }
      const auto bits = static_cast<uint16_t>(static_cast<int16_t>(value));
      line_ += static_cast<char>(bits >> 8);
      line_ += static_cast<char>(bits & 255);
    }
    return file_->Append(line_);
  }
  Status End() override { return file_->Commit(); }
  double Written(double height) const override { return std::round(height); }

 private:
  std::unique_ptr<AtomicFile> file_;
  std::string line_;
};

class TiffRows final : public RowWriter {
 public:
  TiffRows(std::unique_ptr<GdalWriter> file, bool is_float)
      : file_(std::move(file)), is_float_(is_float) {}
  Status Add(std::span<const double> heights) override { return file_->Add(heights); }
  Status End() override { return file_->End(); }
  double Written(double height) const override {
    return is_float_ ? double{static_cast<float>(height)} : height;
  }

 private:
  std::unique_ptr<GdalWriter> file_;
  const bool is_float_;
};

// True when the raster is what a .hgt file of this name holds.
bool IsHgtTile(const HeightRaster& r, const std::string& path) {
  const double south = r.y0 + (r.rows - 1) * r.dy;
  char name[40];
  std::snprintf(name, sizeof(name), "%c%02d%c%03d", south < -0.5 ? 'S' : 'N',
                std::abs(static_cast<int>(std::lround(south))), r.x0 < -0.5 ? 'W' : 'E',
                std::abs(static_cast<int>(std::lround(r.x0))));
  constexpr double kRound = 1e-9;
  const auto whole = [&](double v) { return std::abs(v - std::round(v)) < kRound; };
  return r.columns == r.rows && whole(r.x0) && whole(r.y0) && whole(south) &&
         std::abs(r.y0 - south - 1) < kRound && std::abs((r.columns - 1) * r.dx - 1) < kRound &&
         std::filesystem::path(path).stem() == name;
}

// The least and the largest whole number of a type; none: it has fractions.
std::optional<std::array<double, 2>> LimitsOf(const std::string& type) {
  if (type == "byte") return {{0, 255}};
  if (type == "int16") return {{-32768, 32767}};
  if (type == "uint16") return {{0, 65535}};
  if (type == "int32") return {{-2147483648.0, 2147483647.0}};
  if (type == "uint32") return {{0, 4294967295.0}};
  return std::nullopt;
}

// What the raster was, or nothing of a terrain that was none.
RasterFrame FrameOf(const ObjectRecord& record) { return record.raster.value_or(RasterFrame{}); }

// The value of a type that stands for holes: the raster's own, or another one, that no height has.
std::optional<double> NodataOf(const ObjectRecord& record, const std::string& type) {
  const double low = record.bounds.min.z;
  const double high = record.bounds.max.z;
  const auto limits = LimitsOf(type);
  // Heights with fractions are rounded on their way.
  const double margin = limits ? 0 : 1e-6 * std::max(std::abs(low), std::abs(high));
  constexpr double kLeast = -std::numeric_limits<float>::max();
  for (const double v : {FrameOf(record).nodata.value_or(kNodata), kNodata, -9999.0, 0.0, 255.0,
                         65535.0, -2147483648.0, 4294967295.0, kLeast}) {
    const bool fits = limits ? v == std::floor(v) && v >= (*limits)[0] && v <= (*limits)[1]
                             : std::abs(v) <= -kLeast;
    if (fits && (v < low - margin || v > high + margin)) return v;
  }
  return std::nullopt;
}

// True when each sample of r is a sample of the raster that has a height.
bool IsFull(const ObjectRecord& record, const HeightRaster& r) {
  const Box3d& b = record.bounds;
  return record.vertices == uint64_t{FrameOf(record).columns} * FrameOf(record).rows &&
         r.x0 > b.min.x - 0.5 * r.dx && r.x0 + (r.columns - 1) * r.dx < b.max.x + 0.5 * r.dx &&
         r.y0 < b.max.y - 0.5 * r.dy && r.y0 + (r.rows - 1) * r.dy > b.min.y + 0.5 * r.dy;
}

// Chooses a type that holds all heights, and a value of it that stands for holes. `exact`: the
// raster's samples at full resolution, with the raster's type if that can be.
void ChooseType(const ObjectRecord& record, const HeightRaster& r, bool exact, GdalRaster* raster) {
  raster->sample_type = exact ? FrameOf(record).sample_type : "float32";
  const Grid& grid = record.grid;
  const bool whole =
      grid.step == std::floor(grid.step) && grid.origin.z == std::floor(grid.origin.z);
  if (const auto limits = LimitsOf(raster->sample_type)) {
    const bool fits = record.bounds.min.z >= (*limits)[0] && record.bounds.max.z <= (*limits)[1];
    if (!whole || !fits) raster->sample_type = "float64";
  }
  raster->nodata = NodataOf(record, raster->sample_type);
  const bool needed = FrameOf(record).nodata || !exact || !IsFull(record, r);
  if (!needed) raster->nodata.reset();
  if (needed && !raster->nodata) {
    raster->sample_type = "float64";
    raster->nodata = NodataOf(record, raster->sample_type);
  }
}

Result<std::unique_ptr<RowWriter>> OpenRows(const ObjectRecord& record, const std::string& path,
                                            const HeightRaster& r, bool exact) {
  const std::string suffix = SuffixOf(path);
  if (suffix == ".tif" || suffix == ".tiff") {
    GdalRaster raster;
    raster.columns = r.columns;
    raster.rows = r.rows;
    raster.geotransform = {r.x0 - 0.5 * r.dx, r.dx, 0, r.y0 - 0.5 * r.dy, 0, r.dy};
    raster.is_area = FrameOf(record).is_area;
    raster.height_units = FrameOf(record).height_units;
    raster.crs = record.georeference;
    ChooseType(record, r, exact, &raster);
    MTDB_ASSIGN_OR_RETURN(std::unique_ptr<GdalWriter> file, CreateGeoTiff(path, raster));
    return std::unique_ptr<RowWriter>(
        new TiffRows(std::move(file), raster.sample_type == "float32"));
  }
  if (suffix == ".hgt" && !IsHgtTile(r, path)) {
    return InvalidArgument(path +
                           ": a .hgt file holds one tile of whole degrees and is named by its "
                           "south-western sample; name the tile's --window, or write .tif");
  }
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  if (suffix == ".hgt") return std::unique_ptr<RowWriter>(new HgtRows(std::move(file)));
  auto rows =
      std::make_unique<AsciiRows>(std::move(file), NodataOf(record, "float64").value_or(kNodata));
  MTDB_RETURN_IF_ERROR(rows->Begin(r));
  return std::unique_ptr<RowWriter>(std::move(rows));
}

}  // namespace

bool IsRasterOutput(const std::string& path) {
  const std::string suffix = SuffixOf(path);
  return suffix == ".asc" || suffix == ".hgt" || suffix == ".tif" || suffix == ".tiff";
}

Result<RasterOutputReport> WriteRaster(const Surface& surface, const std::string& path,
                                       const RasterOutputOptions& options) {
  const ObjectRecord& record = surface.record();
  MTDB_ASSIGN_OR_RETURN(const HeightRaster r,
                        RasterSamples(record, options.window, options.spacing));
  const bool exact = !options.spacing && options.heights.error_model < 0;
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<RowWriter> writer, OpenRows(record, path, r, exact));
  RasterOutputReport report;
  report.columns = r.columns;
  report.rows = r.rows;
  const auto write = [&](std::span<const double> rows) -> Status {
    for (const double h : rows) {
      report.holes += std::isnan(h);
      if (std::isnan(h)) continue;
      report.rounding = std::max(report.rounding, std::abs(h - writer->Written(h)));
    }
    for (size_t begin = 0; begin < rows.size(); begin += r.columns) {
      MTDB_RETURN_IF_ERROR(writer->Add(rows.subspan(begin, r.columns)));
    }
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(VisitHeights(surface, r, options.heights, &report.cost, write));
  MTDB_RETURN_IF_ERROR(writer->End());
  return report;
}

}  // namespace mtdb
