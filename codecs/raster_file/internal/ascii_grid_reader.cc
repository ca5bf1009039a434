// SPDX-License-Identifier: Apache-2.0
// ESRI ASCII grid: a header of names and numbers, then rows of numbers from north to south.
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <string_view>
#include <vector>

#include "codecs/raster_file/internal/readers.h"

namespace mtdb::internal {

namespace {

constexpr size_t kBlock = size_t{1} << 16;
constexpr int kMostDecimals = 9;
constexpr size_t kLongestWord = 1024;
constexpr size_t kMostNames = 100;     // of the header
constexpr double kEsriNodata = -9999;  // where the header names none

// The words of a text, block by block, from any place.
class Words {
 public:
  explicit Words(const RasterInput* file) : file_(file) {}
  void Seek(uint64_t offset, uint64_t line = 1) {
    begin_ = offset;
    at_ = size_ = 0;
    line_ = line;
    after_return_ = false;
  }
  uint64_t offset() const { return begin_ + at_; }  // behind the last word
  uint64_t line() const { return line_; }           // of the last word, from the one of Seek()
  // Empty at the end of the file.
  Status Next(std::string* word) {
    word->clear();
    for (;;) {
      if (at_ == size_) {
        begin_ += size_;
        at_ = 0;
        size_ = static_cast<size_t>(std::min<uint64_t>(kBlock, file_->size() - begin_));
        if (size_ == 0) return Status::Ok();
        block_.resize(kBlock);
        MTDB_RETURN_IF_ERROR(file_->Read(begin_, block_.data(), size_));
      }
      const char c = block_[at_];
      const bool is_space = c == ' ' || (c >= '\t' && c <= '\r');
      if (is_space && !word->empty()) return Status::Ok();
      if (c == '\r' || (c == '\n' && !after_return_)) ++line_;
      after_return_ = c == '\r';
      if (word->size() == kLongestWord) {
        return BadInput(file_->path() + ": byte " + std::to_string(offset()) +
                        ": expected a number or a name, found more than " +
                        std::to_string(kLongestWord) + " characters without a space");
      }
      ++at_;
      if (!is_space) word->push_back(c);
    }
  }

 private:
  const RasterInput* file_;
  std::string block_;
  uint64_t begin_ = 0;
  size_t at_ = 0, size_ = 0;
  uint64_t line_ = 1;
  bool after_return_ = false;  // of a CR, to which an LF belongs
};

bool ParseNumber(std::string_view text, double* value) {
  if (!text.empty() && text[0] == '+') text.remove_prefix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *value);
  return error == std::errc() && end == text.data() + text.size();
}

class AsciiGridReader final : public RasterReader {
 public:
  AsciiGridReader(const std::string& path, RasterInput file)
      : file_(std::move(file)), words_(&file_) {
    path_ = path;
  }

  Status Open() {
    MTDB_RETURN_IF_ERROR(ReadHeader());
    MTDB_RETURN_IF_ERROR(SurveyRows());
    MTDB_RETURN_IF_ERROR(ReadCrs());
    while (!info_.crs.empty() && std::isspace(static_cast<unsigned char>(info_.crs.back())) != 0) {
      info_.crs.pop_back();
    }
    return Status::Ok();
  }

  Status ReadRow(uint32_t row, std::span<double> heights) override {
    words_.Seek(rows_[row]);
    std::string word;
    for (size_t column = 0; column < heights.size(); ++column) {
      MTDB_RETURN_IF_ERROR(words_.Next(&word));
      if (!ParseNumber(word, &heights[column])) return Wrong(row, column, word);
      if (heights[column] == info_.frame.nodata || !std::isfinite(heights[column])) {
        heights[column] = std::numeric_limits<double>::quiet_NaN();
      }
    }
    return Status::Ok();
  }

 private:
  // From the .prj beside it, if there is one.
  Status ReadCrs() {
    const auto path = std::filesystem::path(path_).replace_extension(".prj");
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) return Status::Ok();
    std::ifstream prj(path);
    std::stringstream text;
    text << prj.rdbuf();
    if (!prj || (text.fail() && std::filesystem::file_size(path, error) > 0)) {
      return IoError(path.string() + ": cannot be read");
    }
    info_.crs = text.str();
    return Status::Ok();
  }
  Status Wrong(uint64_t row, uint64_t column, const std::string& found) const {
    return BadInput(path_ + ": row " + std::to_string(row) + ", column " + std::to_string(column) +
                    ": expected a number, found " +
                    (found.empty() ? "the end of the file" : "'" + found.substr(0, 40) + "'"));
  }

  Status ReadHeader() {
    std::map<std::string, double> values;
    std::string word;
    uint64_t begin = 0;
    for (;;) {
      begin = words_.offset();
      rows_line_ = words_.line();
      MTDB_RETURN_IF_ERROR(words_.Next(&word));
      if (word.empty() || std::isalpha(static_cast<unsigned char>(word[0])) == 0 ||
          strcasecmp(word.c_str(), "nan") == 0) {
        break;
      }
      std::string name = word;
      for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      MTDB_RETURN_IF_ERROR(words_.Next(&word));
      if (values.size() == kMostNames) {
        return BadInput(path_ + ": header: more than " + std::to_string(kMostNames) + " names");
      }
      if (!ParseNumber(word, &values[name])) {
        return BadInput(path_ + ": header: " + name + ": expected a number, found '" +
                        word.substr(0, 40) + "'");
      }
    }
    rows_.push_back(begin);
    return SetFrame(values);
  }

  Status SetFrame(const std::map<std::string, double>& values) {
    const auto value = [&](const char* name) {
      const auto at = values.find(name);
      return at == values.end() ? std::numeric_limits<double>::quiet_NaN() : at->second;
    };
    RasterFrame& f = info_.frame;
    const double columns = value("ncols");
    const double rows = value("nrows");
    const bool centre = values.count("xllcenter") != 0;
    const double x = value(centre ? "xllcenter" : "xllcorner");
    const double y = value(centre ? "yllcenter" : "yllcorner");
    const bool square = values.count("cellsize") != 0;
    const double dx = value(square ? "cellsize" : "dx");
    const double dy = value(square ? "cellsize" : "dy");
    constexpr double kMost = 1 << 30;
    if (!(columns >= 1 && columns <= kMost && rows >= 1 && rows <= kMost &&
          columns == std::floor(columns) && rows == std::floor(rows) && dx > 0 && dy > 0) ||
        !std::isfinite(x) || !std::isfinite(y)) {
      return BadInput(path_ +
                      ": header: expected ncols, nrows, xllcorner or xllcenter, yllcorner or "
                      "yllcenter, and cellsize");
    }
    f.columns = static_cast<uint32_t>(columns);
    f.rows = static_cast<uint32_t>(rows);
    f.transform_of_samples = centre;
    f.is_area = !centre;
    f.geotransform = {x, dx, 0, y + dy * (centre ? rows - 1 : rows), 0, -dy};
    const auto nodata = values.find("nodata_value");
    names_nodata_ = nodata != values.end();
    f.nodata = names_nodata_ ? nodata->second : kEsriNodata;
    return Status::Ok();
  }

  // One pass: where rows begin, and with how many decimals heights are written.
  Status SurveyRows() {
    info_.format = "ESRI ASCII grid";
    const RasterFrame& f = info_.frame;
    if (uint64_t{f.columns} * f.rows > file_.size()) {
      return BadInput(path_ + ": header: " + std::to_string(f.rows) + " rows of " +
                      std::to_string(f.columns) + " heights do not fit a file of " +
                      std::to_string(file_.size()) + " bytes");
    }
    words_.Seek(rows_[0], rows_line_);
    std::string word;
    int decimals = 0;
    uint64_t unnamed = 0;  // samples that are holes though the header names no such value
    for (uint32_t row = 0; row < f.rows; ++row) {
      if (row > 0) rows_.push_back(words_.offset());
      for (uint32_t column = 0; column < f.columns; ++column) {
        MTDB_RETURN_IF_ERROR(words_.Next(&word));
        double value = 0;
        if (!ParseNumber(word, &value)) return Wrong(row, column, word);
        NoteLine(words_.line());
        if (value == f.nodata && !names_nodata_) ++unnamed;
        if (value == f.nodata || !std::isfinite(value)) continue;
        decimals = std::max(decimals, DecimalsOf(word));
      }
    }
    MTDB_RETURN_IF_ERROR(CheckEnd());
    EndLine();
    if (odd_line_ != 0 && whole_lines_ > 0) {
      info_.notes.push_back(path_ + ": line " + std::to_string(odd_line_) + " has " +
                            std::to_string(odd_count_) + " numbers, where a row has " +
                            std::to_string(f.columns) +
                            "; rows are counted by numbers, not by lines");
    }
    if (unnamed > 0) {
      info_.notes.push_back(path_ + ": no NODATA_value line: " + std::to_string(unnamed) +
                            " samples of -9999 count as holes, as ESRI's description says");
    }
    info_.frame.sample_type = decimals == 0 ? "int32" : "float64";
    info_.height_step = decimals > kMostDecimals ? 0 : std::pow(10.0, -decimals);
    return Status::Ok();
  }

  // Counts the numbers of each line, and keeps the first line that has other than a row has.
  void NoteLine(uint64_t line) {
    if (line != counted_line_) {
      EndLine();
      counted_line_ = line;
      counted_ = 0;
    }
    ++counted_;
  }
  void EndLine() {
    whole_lines_ += counted_ == info_.frame.columns;
    if (counted_ == 0 || counted_ == info_.frame.columns || odd_line_ != 0) return;
    odd_line_ = counted_line_;
    odd_count_ = counted_;
  }

  // Nothing may be left behind the last row: rows of other lengths would be shifted. Lines may be
  // broken anywhere.
  Status CheckEnd() {
    uint64_t left = 0;
    std::string word, first;
    uint64_t line = 0;
    for (;; ++left) {
      MTDB_RETURN_IF_ERROR(words_.Next(&word));
      if (word.empty()) break;
      NoteLine(words_.line());
      if (left == 0) {
        first = word.substr(0, 40);
        line = words_.line();
      }
    }
    if (left == 0) return Status::Ok();
    EndLine();
    const RasterFrame& f = info_.frame;
    std::string message = path_ + ": line " + std::to_string(line) + ": behind " +
                          std::to_string(f.rows) + " rows of " + std::to_string(f.columns) +
                          " numbers, as the header says, " + std::to_string(left) +
                          " more are left, beginning with '" + first + "'";
    if (odd_line_ != 0) {
      message +=
          "; line " + std::to_string(odd_line_) + " has " + std::to_string(odd_count_) + " numbers";
    }
    return BadInput(message);
  }

  static int DecimalsOf(const std::string& word) {
    if (word.find_first_of("eE") != std::string::npos) return kMostDecimals + 1;
    const size_t point = word.find('.');
    if (point == std::string::npos) return 0;
    const size_t last = word.find_last_not_of('0');
    return static_cast<int>(last - point);
  }

  RasterInput file_;
  Words words_;
  std::vector<uint64_t> rows_;  // where they begin
  uint64_t rows_line_ = 1;      // the line of the first one
  bool names_nodata_ = false;
  uint64_t counted_line_ = 0, counted_ = 0;  // see NoteLine()
  uint64_t odd_line_ = 0, odd_count_ = 0;
  uint64_t whole_lines_ = 0;  // that have as many as a row
};

}  // namespace

Result<std::unique_ptr<RasterReader>> OpenAsciiGrid(const std::string& path, RasterInput file) {
  auto reader = std::make_unique<AsciiGridReader>(path, std::move(file));
  MTDB_RETURN_IF_ERROR(reader->Open());
  return std::unique_ptr<RasterReader>(std::move(reader));
}

}  // namespace mtdb::internal
