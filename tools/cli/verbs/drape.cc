// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/verbs/drape.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <vector>

#include "tools/request/read_file.h"

namespace mtdb {

namespace {

std::string LowerSuffix(const std::string& path) {
  std::string suffix = std::filesystem::path(path).extension().string();
  for (char& c : suffix) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return suffix;
}

// Beside the image: with its name, and the suffix of its kind.
std::optional<std::string> WorldFileOf(const std::string& path) {
  const bool png = LowerSuffix(path) == ".png";
  std::vector<std::string> suffixes{".wld", ".WLD"};
  for (const char* const s : {".pgw", ".pngw", ".PGW"}) {
    if (png) suffixes.emplace_back(s);
  }
  for (const char* const s : {".jgw", ".jpgw", ".jpegw", ".JGW"}) {
    if (!png) suffixes.emplace_back(s);
  }
  for (const std::string& suffix : suffixes) {
    const std::string file = std::filesystem::path(path).replace_extension(suffix).string();
    std::error_code error;
    if (std::filesystem::is_regular_file(file, error)) return file;
  }
  return std::nullopt;
}

uint32_t BigEndian(const std::string& bytes, size_t at, size_t count) {
  uint32_t value = 0;
  for (size_t i = 0; i < count; ++i) value = value << 8 | static_cast<uint8_t>(bytes[at + i]);
  return value;
}

// Reads the size from the file's head.
Status ReadSize(const std::string& path, PlacedImage* image) {
  const std::string& b = image->bytes;
  if (b.size() >= 24 && b.starts_with("\x89PNG\r\n\x1a\n")) {
    image->mime_type = "image/png";
    image->columns = BigEndian(b, 16, 4);
    image->rows = BigEndian(b, 20, 4);
  } else if (b.starts_with("\xff\xd8")) {
    image->mime_type = "image/jpeg";
    // Segments: a marker, after any number of bytes 0xff, and its length; a frame's has the size.
    for (size_t at = 2; at + 9 <= b.size() && b[at] == '\xff';) {
      const auto marker = static_cast<uint8_t>(b[at + 1]);
      if (marker == 0xff) {
        ++at;
        continue;
      }
      const bool frame =
          marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
      if (frame) {
        image->rows = BigEndian(b, at + 5, 2);
        image->columns = BigEndian(b, at + 7, 2);
        break;
      }
      at += 2 + BigEndian(b, at + 2, 2);
    }
  }
  if (image->columns != 0 && image->rows != 0) return Status::Ok();
  return BadInput(path + ": is neither a PNG nor a JPEG file");
}

Status ReadWorldFile(const std::string& path, PlacedImage* image) {
  std::ifstream in(path);
  std::vector<double> n;
  for (double value = 0; n.size() < 6 && in >> value;) n.push_back(value);
  if (n.size() < 6 || !std::all_of(n.begin(), n.end(), [](double v) { return std::isfinite(v); })) {
    return BadInput(path + ": expected the six numbers of a world file");
  }
  // It places the middle of the first pixel.
  image->geotransform = {n[4] - (n[0] + n[2]) / 2, n[0], n[2],
                         n[5] - (n[1] + n[3]) / 2, n[1], n[3]};
  return Status::Ok();
}

bool IsGeographic(const std::string& crs) {
  return crs.starts_with("GEOG") || crs.starts_with("GEODCRS");
}

}  // namespace

Result<PlacedImage> ReadPlacedImage(const std::string& path) {
  const std::string suffix = LowerSuffix(path);
  const bool plain = suffix == ".png" || suffix == ".jpg" || suffix == ".jpeg";
  const std::optional<std::string> world = plain ? WorldFileOf(path) : std::nullopt;
  if (!world) {
    Result<PlacedImage> image = ReadGdalImage(path);
    std::error_code error;
    if (image.ok() || !plain || !std::filesystem::is_regular_file(path, error)) return image;
    return BadInput(path + ": says nowhere which place it shows; put a world file beside it (" +
                    std::filesystem::path(path)
                        .filename()
                        .replace_extension(suffix == ".png" ? ".pgw" : ".jgw")
                        .string() +
                    "), or take a GeoTIFF");
  }
  PlacedImage image;
  MTDB_ASSIGN_OR_RETURN(image.bytes, ReadFile(path));
  MTDB_RETURN_IF_ERROR(ReadSize(path, &image));
  MTDB_RETURN_IF_ERROR(ReadWorldFile(*world, &image));
  return image;
}

Result<MeshTexture> ReadDrape(const std::string& path, const ObjectRecord& record) {
  MTDB_ASSIGN_OR_RETURN(PlacedImage image, ReadPlacedImage(path));
  if (!image.crs.empty() && !record.georeference.empty() &&
      IsGeographic(image.crs) != IsGeographic(record.georeference)) {
    return InvalidArgument(
        path + ": one of image and " + record.name +
        " is in degrees, and the other is not; warp the image, as gdalwarp does");
  }
  const auto& g = image.geotransform;
  const double determinant = g[1] * g[5] - g[2] * g[4];
  if (!(std::abs(determinant) > 0) || !std::isfinite(determinant)) {
    return BadInput(path + ": its place is a line");
  }
  MeshTexture texture;
  texture.mime_type = image.mime_type;
  texture.image = std::move(image.bytes);
  const double w = determinant * image.columns, h = determinant * image.rows;
  texture.place = {(g[3] * g[2] - g[0] * g[5]) / w, g[5] / w,  -g[2] / w,
                   (g[0] * g[4] - g[3] * g[1]) / h, -g[4] / h, g[1] / h};
  std::array<double, 2> least{1e300, 1e300}, most{-1e300, -1e300};
  for (const double x : {record.bounds.min.x, record.bounds.max.x}) {
    for (const double y : {record.bounds.min.y, record.bounds.max.y}) {
      for (size_t i = 0; i < 2; ++i) {
        const double at =
            texture.place[3 * i] + texture.place[3 * i + 1] * x + texture.place[3 * i + 2] * y;
        least[i] = std::min(least[i], at);
        most[i] = std::max(most[i], at);
      }
    }
  }
  for (size_t i = 0; i < 2; ++i) {
    constexpr double kMost = 1e6;
    if (!(most[i] - least[i] <= kMost)) {
      return BadInput(path + ": covers less than a millionth of " + record.name +
                      ", as its place says");
    }
  }
  if (least[0] > 1 || least[1] > 1 || most[0] < 0 || most[1] < 0) {
    return InvalidArgument(path + ": the image lies elsewhere than " + record.name);
  }
  return texture;
}

}  // namespace mtdb
