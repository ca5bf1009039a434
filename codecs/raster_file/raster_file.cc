// SPDX-License-Identifier: Apache-2.0
#include "codecs/raster_file/raster_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <string_view>

#include "codecs/raster_file/internal/readers.h"

namespace mtdb {

using namespace internal;

namespace {

std::string SmallSuffix(const std::string& path) {
  std::string suffix = std::filesystem::path(path).extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return suffix;
}

}  // namespace

std::string OwnRasterSuffixes() { return ".hgt .asc .dem"; }

Result<std::unique_ptr<RasterReader>> OpenOwnRaster(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(RasterInput file, RasterInput::Open(path));
  const std::string suffix = SmallSuffix(path);
  std::array<char, 9> begin{};
  MTDB_RETURN_IF_ERROR(file.Read(0, begin.data(), std::min<uint64_t>(begin.size(), file.size())));
  const std::string_view start(begin.data(), begin.size());
  if (suffix == ".gz" && start.starts_with("\x1f\x8b")) {
    return BadInput(path +
                    ": rasters are not read compressed; decompress it first, e.g. by gunzip "
                    "--keep");
  }
  if (suffix == ".hgt") return OpenHgt(path, std::move(file));
  // Both are texts of their own kinds under suffixes that others use too.
  if (suffix == ".asc" && (start.starts_with("\xff\xfe") || start.starts_with("\xfe\xff"))) {
    return BadInput(path +
                    ": text in UTF-16 or UTF-32, expected ASCII or UTF-8; convert it first, "
                    "e.g. by iconv -f UTF-16 -t UTF-8");
  }
  if (start.starts_with("\xef\xbb\xbf")) {
    file.SkipFront(3);
    std::shift_left(begin.begin(), begin.end(), 3);
  }
  if (suffix == ".asc" && strncasecmp(begin.data(), "ncols", 5) == 0) {
    return OpenAsciiGrid(path, std::move(file));
  }
  if (suffix == ".dem" && file.size() >= 1024 && begin[0] >= ' ') {
    return OpenUsgsDem(path, std::move(file));
  }
  return Unsupported(path + ": expected a raster of the formats " + OwnRasterSuffixes());
}

}  // namespace mtdb
