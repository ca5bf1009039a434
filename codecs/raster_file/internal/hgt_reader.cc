// SPDX-License-Identifier: Apache-2.0
// SRTM .hgt: a square of int16, big-endian, rows from north to south. The name says where its
// south-western sample lies; neighbours share a row or a column.
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>
#include <vector>

#include "codecs/raster_file/internal/readers.h"

namespace mtdb::internal {

namespace {

constexpr double kNodata = -32768;

struct Place {
  int latitude = 0, longitude = 0;
};

// "N37W120".
std::optional<Place> PlaceOf(const std::string& name) {
  const auto number = [&](size_t from, size_t count) {
    int value = 0;
    for (size_t i = from; i < from + count; ++i) {
      if (std::isdigit(static_cast<unsigned char>(name[i])) == 0) return -1;
      value = 10 * value + (name[i] - '0');
    }
    return value;
  };
  if (name.size() < 7) return std::nullopt;
  const char ns = static_cast<char>(std::toupper(static_cast<unsigned char>(name[0])));
  const char ew = static_cast<char>(std::toupper(static_cast<unsigned char>(name[3])));
  const int latitude = number(1, 2);
  const int longitude = number(4, 3);
  const bool legal = (ns == 'N' || ns == 'S') && (ew == 'E' || ew == 'W') && latitude >= 0 &&
                     latitude <= 90 && longitude >= 0 && longitude <= 180;
  if (!legal) return std::nullopt;
  return Place{ns == 'S' ? -latitude : latitude, ew == 'W' ? -longitude : longitude};
}

class HgtReader final : public RasterReader {
 public:
  HgtReader(const std::string& path, RasterInput file, Place place, uint32_t side)
      : file_(std::move(file)) {
    path_ = path;
    info_.format = "SRTM .hgt";
    info_.crs = Wgs84Wkt();
    info_.height_step = 1;
    RasterFrame& f = info_.frame;
    f.columns = f.rows = side;
    const double step = 1.0 / (side - 1);
    f.geotransform = {double(place.longitude), step, 0, place.latitude + 1.0, 0, -step};
    f.transform_of_samples = true;
    f.is_area = false;
    f.nodata = kNodata;
    f.sample_type = "int16";
    f.height_units = "m";
    f.vertical_datum = "EGM96";
    row_.resize(2 * size_t{side});
  }

  Status ReadRow(uint32_t row, std::span<double> heights) override {
    MTDB_RETURN_IF_ERROR(file_.Read(uint64_t{row} * row_.size(), row_.data(), row_.size()));
    for (size_t i = 0; i < heights.size(); ++i) {
      const auto value = static_cast<int16_t>(row_[2 * i] << 8 | row_[2 * i + 1]);
      heights[i] = value == kNodata ? std::numeric_limits<double>::quiet_NaN() : value;
    }
    return Status::Ok();
  }

 private:
  RasterInput file_;
  std::vector<uint8_t> row_;
};

}  // namespace

Result<std::unique_ptr<RasterReader>> OpenHgt(const std::string& path, RasterInput file) {
  const std::optional<Place> place = PlaceOf(std::filesystem::path(path).stem().string());
  if (!place) {
    return BadInput(path +
                    ": the name of a .hgt file says where it lies: expected one like N37W120.hgt");
  }
  const auto side = static_cast<uint32_t>(std::lround(std::sqrt(double(file.size()) / 2)));
  if (side < 2 || uint64_t{2} * side * side != file.size()) {
    return BadInput(path + ": expected a square of int16, as 2 x 1201 x 1201 bytes are, found " +
                    std::to_string(file.size()) + " bytes");
  }
  return std::unique_ptr<RasterReader>(new HgtReader(path, std::move(file), *place, side));
}

}  // namespace mtdb::internal
