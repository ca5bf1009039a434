// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <vector>

#include "codecs/raster_file/raster_file.h"
#include "tests/codecs/mesh_file_testing.h"

namespace mtdb {
namespace {

using testing::ScratchFolder;

const std::string kHeader = "ncols 3\nnrows 2\nxllcorner 5\nyllcorner 6\ncellsize 10\n";
const std::string kNodataLine = "NODATA_value -1\n";

struct Grid {
  Status status;
  RasterInfo info;
  std::vector<double> heights;  // -7777: none
};

Grid ReadGrid(const std::string& text, const std::string& name = "a.asc") {
  const ScratchFolder folder;
  Grid grid;
  Result<std::unique_ptr<RasterReader>> reader = OpenOwnRaster(folder.Write(name, text));
  grid.status = reader.status();
  if (!reader.ok()) return grid;
  grid.info = (*reader)->info();
  const uint32_t columns = grid.info.frame.columns;
  std::vector<double> row(columns);
  for (uint32_t r = 0; r < grid.info.frame.rows && grid.status.ok(); ++r) {
    grid.status = (*reader)->ReadRow(r, row);
    for (const double h : row) grid.heights.push_back(std::isnan(h) ? -7777 : h);
  }
  return grid;
}

void RequireBad(const std::string& text, std::initializer_list<const char*> parts) {
  const Status status = ReadGrid(text).status;
  INFO(status.message());
  REQUIRE(status.code() == StatusCode::kBadInput);
  for (const char* part : parts) {
    INFO(part);
    REQUIRE(status.message().find(part) != std::string::npos);
  }
}

TEST_CASE("an ASCII grid may begin with a byte order mark, and break lines anywhere and anyhow") {
  for (const char* mark : {"", "\xef\xbb\xbf"}) {
    for (const char* rows :
         {"1 2 3\n4 5 6\n", "1 2\n3 4\n5 6", "1 2 3 4 5 6", " 1 2 3\n\n4 5 6\n \n"}) {
      for (const char* end : {"\n", "\r\n", "\r"}) {
        CAPTURE(mark, rows, std::string(end).size());
        std::string text;
        for (const char c : kHeader + kNodataLine + rows) {
          text += c == '\n' ? end : std::string(1, c);
        }
        const Grid grid = ReadGrid(mark + text);
        INFO(grid.status.message());
        REQUIRE(grid.status.ok());
        REQUIRE(grid.heights == std::vector<double>{1, 2, 3, 4, 5, 6});
        REQUIRE(grid.info.notes.empty());
      }
    }
  }
}

TEST_CASE("an ASCII grid with numbers left over is refused, with counts and the line") {
  const std::string header = kHeader + kNodataLine;
  for (const char* end : {"\n", "\r"}) {
    std::string text;
    for (const char c : header + "1 2 3 9\n4 5 6 9\n") text += c == '\n' ? end : std::string(1, c);
    RequireBad(text, {"line 8: behind 2 rows of 3 numbers", "2 more are left, beginning with '6'",
                      "line 7 has 4 numbers"});
  }
  RequireBad(header + "1 2 3\n4 5 6\n7 8 9\n",
             {"line 9: behind 2 rows of 3 numbers", "3 more are left, beginning with '7'"});
  RequireBad(header + "1 2 3\n4 5 6\nend\n", {"line 9", "1 more are left, beginning with 'end'"});
  RequireBad(header + "1 2 3\n4 5\n", {"row 1, column 2: expected a number, found the end"});
}

TEST_CASE("an ASCII grid that names no value for holes has them at -9999, and says so") {
  const Grid grid = ReadGrid(kHeader + "1 2 -9999\n4 -9999.00 6\n");
  REQUIRE(grid.status.ok());
  REQUIRE(grid.heights == std::vector<double>{1, 2, -7777, 4, -7777, 6});
  REQUIRE(grid.info.frame.nodata == -9999.0);
  REQUIRE(grid.info.notes.size() == 1);
  REQUIRE(grid.info.notes[0].find("no NODATA_value line: 2 samples of -9999") != std::string::npos);
  // Where it names another one, -9999 is a height.
  const Grid other = ReadGrid(kHeader + kNodataLine + "1 2 -9999\n4 -1 6\n");
  REQUIRE(other.heights == std::vector<double>{1, 2, -9999, 4, -7777, 6});
  REQUIRE(other.info.notes.empty());
}

TEST_CASE("rasters in UTF-16 or compressed are refused with what to do") {
  const auto message = [](const std::string& name, const std::string& text) {
    const Grid grid = ReadGrid(text, name);
    REQUIRE(grid.status.code() == StatusCode::kBadInput);
    return grid.status.message();
  };
  REQUIRE(message("a.asc", std::string("\xff\xfen\0c\0o\0l\0", 10)).find("iconv") !=
          std::string::npos);
  REQUIRE(message("N00E010.hgt.gz", "\x1f\x8b\x08 and so on").find("gunzip") != std::string::npos);
}

}  // namespace
}  // namespace mtdb
