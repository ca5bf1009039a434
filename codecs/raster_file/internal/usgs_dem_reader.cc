// SPDX-License-Identifier: Apache-2.0
// USGS DEM: a header of 1024 characters, then profiles from west to east, each from south to north
// and of a length and beginning of its own. Rows are gathered from the profiles in bands.
#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "codecs/raster_file/internal/readers.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kRecord = 1024;
constexpr uint64_t kProfileHeader = 144;
constexpr uint64_t kNumber = 6;          // characters of a height
constexpr uint64_t kFirstHeights = 146;  // of a profile's first record
constexpr uint64_t kMoreHeights = 170;   // of each further one
constexpr double kVoid = -32767;
constexpr uint32_t kBand = 128;  // rows that are gathered at a time
constexpr uint32_t kMostProfiles = 1 << 20;

// A Fortran number, maybe with D for E, or nothing.
double NumberIn(const std::string& text, size_t from, size_t count) {
  std::string word;
  for (size_t i = from; i < from + count && i < text.size(); ++i) {
    const char c = text[i];
    if (c == ' ') continue;
    word.push_back(c == 'D' || c == 'd' ? 'E' : c);
  }
  if (!word.empty() && word[0] == '+') word.erase(0, 1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  const bool whole = error == std::errc() && end == word.data() + word.size();
  return whole && std::isfinite(value) ? value : std::numeric_limits<double>::quiet_NaN();
}

class UsgsDemReader final : public RasterReader {
 public:
  UsgsDemReader(const std::string& path, RasterInput file) : file_(std::move(file)) {
    path_ = path;
  }

  Status Open() {
    std::string header(kRecord, ' ');
    MTDB_RETURN_IF_ERROR(file_.Read(0, header.data(), header.size()));
    MTDB_RETURN_IF_ERROR(ReadHeader(header));
    return ListProfiles();
  }

  Status ReadRow(uint32_t row, std::span<double> heights) override {
    if (band_.empty() || row < band_begin_ || row >= band_begin_ + kBand) {
      MTDB_RETURN_IF_ERROR(ReadBand(row / kBand * kBand));
    }
    const size_t columns = profiles_.size();
    std::copy_n(band_.begin() + static_cast<std::ptrdiff_t>((row - band_begin_) * columns), columns,
                heights.begin());
    return Status::Ok();
  }

 private:
  struct Profile {
    uint64_t offset = 0;  // in the file
    uint32_t heights = 0;
    uint32_t first_row = 0;  // of its southernmost height, from the south
    double datum = 0;
  };

  Status Wrong(const std::string& what) const { return BadInput(path_ + ": " + what); }

  Status ReadHeader(const std::string& header) {
    info_.format = "USGS DEM";
    const double system = NumberIn(header, 156, 6);
    const double zone = NumberIn(header, 162, 6);
    const double plane_unit = NumberIn(header, 528, 6);
    const double height_unit = NumberIn(header, 534, 6);
    const double angle = NumberIn(header, 786, 24);
    dx_ = NumberIn(header, 816, 12);
    dy_ = NumberIn(header, 828, 12);
    dz_ = NumberIn(header, 840, 12);
    const double profiles = NumberIn(header, 858, 6);
    if (!(dx_ > 0 && dy_ > 0 && dz_ > 0 && profiles >= 1 && profiles <= kMostProfiles &&
          (height_unit == 1 || height_unit == 2))) {
      return Wrong("header: expected a spacing, a height unit and profiles of a USGS DEM");
    }
    if (angle != 0 && !std::isnan(angle)) {
      return Status(StatusCode::kUnsupported, path_ + ": profiles that are turned are not read");
    }
    count_ = static_cast<uint32_t>(profiles);
    RasterFrame& f = info_.frame;
    f.sample_type = "int32";
    f.height_units = height_unit == 1 ? "ft" : "m";
    f.nodata = kVoid;
    f.transform_of_samples = true;
    f.is_area = false;
    info_.height_step = dz_;
    // Old files do not name their datum; they are of NAD27.
    const double given = NumberIn(header, 890, 2);
    const int datum = given >= 1 && given <= 4 ? static_cast<int>(given) : 1;
    if (system == 1 && plane_unit == 2 && std::abs(zone) <= 60) {
      info_.crs = UtmWkt(static_cast<int>(zone), datum);
    }
    if (system == 0 && plane_unit == 3) {
      seconds_ = 3600;
      if (datum == 3) info_.crs = Wgs84Wkt();
    }
    return Status::Ok();
  }

  // Where the profiles lie in the file and in the raster.
  Status ListProfiles() {
    uint64_t offset = kRecord;
    std::vector<double> souths;
    double x0 = 0;
    double south = std::numeric_limits<double>::infinity();
    double north = -south;
    for (uint32_t i = 0; i < count_; ++i) {
      std::string text(kProfileHeader, ' ');
      MTDB_RETURN_IF_ERROR(file_.Read(offset, text.data(), text.size()));
      const double heights = NumberIn(text, 12, 6);
      const double width = NumberIn(text, 18, 6);
      const double x = NumberIn(text, 24, 24);
      const double y = NumberIn(text, 48, 24);
      Profile p{offset, 0, 0, NumberIn(text, 72, 24)};
      if (!(heights >= 1 && heights <= (1 << 24) && width == 1) || std::isnan(x) || std::isnan(y) ||
          std::isnan(p.datum)) {
        return Wrong("profile " + std::to_string(i) + ": expected its size, place and datum");
      }
      p.heights = static_cast<uint32_t>(heights);
      if (i == 0) x0 = x;
      if (std::abs(x - x0 - i * dx_) > 0.01 * dx_) {
        return Wrong("profile " + std::to_string(i) + ": expected it " + std::to_string(dx_) +
                     " east of the one before");
      }
      south = std::min(south, y);
      north = std::max(north, y + (p.heights - 1) * dy_);
      souths.push_back(y);
      profiles_.push_back(p);
      uint64_t records = 1;
      if (p.heights > kFirstHeights) {
        records += (p.heights - kFirstHeights + kMoreHeights - 1) / kMoreHeights;
      }
      offset += records * kRecord;
    }
    return SetRows(souths, x0, south, north);
  }

  Status SetRows(const std::vector<double>& souths, double x0, double south, double north) {
    const double rows = std::round((north - south) / dy_) + 1;
    if (!(rows <= (1 << 26))) return Wrong("the profiles lie too far apart");
    for (size_t i = 0; i < souths.size(); ++i) {
      const double from = (souths[i] - south) / dy_;
      if (std::abs(from - std::round(from)) > 0.01) {
        return Wrong("profile " + std::to_string(i) + ": its heights are no rows of the others'");
      }
      profiles_[i].first_row = static_cast<uint32_t>(std::round(from));
    }
    RasterFrame& f = info_.frame;
    f.columns = count_;
    f.rows = static_cast<uint32_t>(rows);
    f.geotransform = {x0 / seconds_,  dx_ / seconds_, 0, (south + (rows - 1) * dy_) / seconds_, 0,
                      -dy_ / seconds_};
    return Status::Ok();
  }

  // Gathers rows `begin` .. `begin` + kBand - 1, from the north.
  Status ReadBand(uint32_t begin) {
    const uint32_t rows = info_.frame.rows;
    const size_t columns = profiles_.size();
    band_.assign(size_t{kBand} * columns, std::numeric_limits<double>::quiet_NaN());
    band_begin_ = begin;
    const uint32_t end = std::min(rows, begin + kBand);
    // From the south: rows - end .. rows - begin - 1.
    std::string text;
    for (size_t c = 0; c < columns; ++c) {
      const Profile& p = profiles_[c];
      const uint32_t from = std::max(p.first_row, rows - end);
      const uint32_t to = std::min(p.first_row + p.heights, rows - begin);
      if (from >= to) continue;
      const uint64_t first = OffsetOf(p, from - p.first_row);
      const uint64_t last = OffsetOf(p, to - 1 - p.first_row) + kNumber;
      text.resize(last - first);
      MTDB_RETURN_IF_ERROR(file_.Read(first, text.data(), text.size()));
      for (uint32_t r = from; r < to; ++r) {
        const uint64_t at = OffsetOf(p, r - p.first_row) - first;
        const double value = NumberIn(text, at, kNumber);
        if (std::isnan(value)) {
          return Wrong("profile " + std::to_string(c) + ", height " +
                       std::to_string(r - p.first_row) + ": expected a number, found '" +
                       text.substr(at, kNumber) + "'");
        }
        if (value == kVoid) continue;
        band_[(rows - 1 - r - begin) * columns + c] = p.datum + dz_ * value;
      }
    }
    return Status::Ok();
  }

  static uint64_t OffsetOf(const Profile& p, uint64_t i) {
    if (i < kFirstHeights) return p.offset + kProfileHeader + kNumber * i;
    i -= kFirstHeights;
    return p.offset + kRecord * (1 + i / kMoreHeights) + kNumber * (i % kMoreHeights);
  }

  RasterInput file_;
  uint32_t count_ = 0;
  double dx_ = 0, dy_ = 0, dz_ = 0;
  double seconds_ = 1;  // in a unit of the CRS
  std::vector<Profile> profiles_;
  std::vector<double> band_;
  uint32_t band_begin_ = 0;
};

}  // namespace

Result<std::unique_ptr<RasterReader>> OpenUsgsDem(const std::string& path, RasterInput file) {
  auto reader = std::make_unique<UsgsDemReader>(path, std::move(file));
  MTDB_RETURN_IF_ERROR(reader->Open());
  return std::unique_ptr<RasterReader>(std::move(reader));
}

}  // namespace mtdb::internal
