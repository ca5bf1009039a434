// SPDX-License-Identifier: Apache-2.0
// OFF, COFF, NOFF and CNOFF in text. The vertices are read twice: first for the kind of their
// colours and for the precision that their positions need.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/polygons/face_emitter.h"
#include "codecs/mesh_file/polygons/left_out_vertices.h"
#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/polygons/vertex_positions.h"
#include "codecs/mesh_file/readers/readers.h"
#include "store/base/coordinate_limit.h"

namespace mtdb::internal {
namespace {

constexpr size_t kNormalValues = 3;
constexpr size_t kMaxVertexValues = 3 + kNormalValues + 4;

// The keyword's letters, or that it is none.
struct OffKeyword {
  bool valid = false;
  bool colours = false;
  bool normals = false;
  bool unsupported = false;  // texture coordinates, other dimensions
};

// Whether the word is a number of a header without keyword.
bool IsCount(std::string_view word) {
  int64_t count = 0;
  return ParseInteger(word, &count) && count >= 0;
}

// Cuts "OFF5", as many files begin, into the keyword and the first count.
std::string_view TakeKeyword(std::string_view* word) {
  const size_t digits = word->find("OFF") == std::string_view::npos ? 0 : word->find("OFF") + 3;
  if (digits == 0 || !IsCount(word->substr(digits))) return std::exchange(*word, {});
  const std::string_view keyword = word->substr(0, digits);
  word->remove_prefix(digits);
  return keyword;
}

// False for what is certainly a number below 1e30.
bool MayBeNoCoordinate(std::string_view text) {
  return text.size() > 30 || std::any_of(text.begin(), text.end(), [](char c) {
           return c != '-' && c != '.' && (c < '0' || c > '9');
         });
}

OffKeyword ParseKeyword(std::string_view word) {
  OffKeyword keyword;
  if (word == "off") word = "OFF";
  if (!word.ends_with("OFF")) return keyword;
  word.remove_suffix(3);
  keyword.valid = true;
  for (const char c : word) {
    if (c == 'C') {
      keyword.colours = true;
    } else if (c == 'N') {
      keyword.normals = true;
    } else if (c == 'S' || c == 'T' || c == '4' || c == 'n') {
      keyword.unsupported = true;
    } else {
      keyword.valid = false;
    }
  }
  return keyword;
}

class OffReader {
 public:
  OffReader(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
            MeshReadReport* report)
      : file_(file),
        emitter_(sink),
        report_(report),
        faces_(emitter_, report, left_out_, [this, tmp = start.tmp] { return Positions(tmp); }) {}

  Status Read() {
    {
      TextReader text(file_);
      MTDB_RETURN_IF_ERROR(ReadHeader(text));
      MTDB_RETURN_IF_ERROR(ScanVertices(text));
    }
    if (left_out_.count() == vertex_count_) return NoVertexLeft(file_.path(), left_out_);
    report_->left_out_vertices = left_out_.count();
    MeshHeader header;
    header.vertex_count = vertex_count_ - left_out_.count();
    header.double_positions = double_positions_;
    header.from_text = true;
    if (keyword_.normals) {
      for (const char* name : {"nx", "ny", "nz"}) {
        header.attributes.attributes.push_back({name, ScalarType::kFloat32});
      }
    }
    constexpr const char* kColours[4] = {"red", "green", "blue", "alpha"};
    for (size_t i = 0; i < colour_values_; ++i) {
      header.attributes.attributes.push_back({kColours[i], ScalarType::kUint8});
    }
    MTDB_RETURN_IF_ERROR(emitter_.Begin(header));
    TextReader text(file_, body_offset_, body_line_);
    for (uint64_t i = 0; i < vertex_count_; ++i) MTDB_RETURN_IF_ERROR(EmitVertex(text, i));
    for (uint64_t i = 0; i < face_count_; ++i) MTDB_RETURN_IF_ERROR(EmitFace(text, i));
    MTDB_RETURN_IF_ERROR(faces_.End());
    std::string_view rest;
    if (NextLine(text, &rest)) AddIgnored(report_, "lines after the last face");
    MTDB_RETURN_IF_ERROR(text.status());
    return emitter_.End();
  }

 private:
  // The next line that has more than white space and a comment, without the comment.
  static bool NextLine(TextReader& text, std::string_view* line) {
    while (text.NextLine(line)) {
      *line = line->substr(0, line->find('#'));
      if (line->find_first_not_of(" \t\r\v\f") != std::string_view::npos) return true;
    }
    return false;
  }

  Status Error(const TextReader& text, const std::string& what) const {
    return BadInput(file_.path() + ": line " + std::to_string(text.line()) + ": " + what);
  }
  // After NextLine said no.
  Status EndError(const TextReader& text, const std::string& expected) const {
    MTDB_RETURN_IF_ERROR(text.status());
    return BadInput(file_.path() + ": " + expected +
                    ", found the end of the file; the file is cut short");
  }

  Status ReadHeader(TextReader& text) {
    std::string_view line, word;
    if (!NextLine(text, &line)) return EndError(text, "expected 'OFF'");
    LineTokens tokens(line);
    tokens.Next(&word);
    bool more = IsCount(word);  // the keyword may be left out
    std::string_view keyword = "OFF";
    if (!more) {
      keyword = TakeKeyword(&word);
      keyword_ = ParseKeyword(keyword);
      if (!keyword_.valid) return Error(text, "expected 'OFF', found " + Quoted(keyword));
      more = !word.empty() || tokens.Next(&word);
    }
    if (keyword_.unsupported) {
      return Unsupported(file_.path() + ": " + Quoted(keyword) +
                         " is a kind of OFF that mtdb does not read, expected OFF, COFF, NOFF or "
                         "CNOFF");
    }
    report_->format = (keyword == "off" ? "OFF" : std::string(keyword)) + " ASCII";
    if (more && word == "BINARY") {
      return Unsupported(file_.path() +
                         ": binary OFF is not read; convert it to text OFF or to PLY");
    }
    if (!more) {
      if (!NextLine(text, &line)) return EndError(text, "expected the counts 'V F E'");
      tokens = LineTokens(line);
      tokens.Next(&word);
    }
    return ReadCounts(text, line, word, tokens);
  }

  // The first count is read already.
  Status ReadCounts(TextReader& text, std::string_view line, std::string_view word,
                    LineTokens tokens) {
    int64_t vertices = 0, faces = 0;
    std::string_view second;
    if (!ParseInteger(word, &vertices) || vertices < 0 || !tokens.Next(&second) ||
        !ParseInteger(second, &faces) || faces < 0) {
      return Error(text, "expected the counts 'V F E', found " + Quoted(line));
    }
    vertex_count_ = static_cast<uint64_t>(vertices);
    face_count_ = static_cast<uint64_t>(faces);
    if (vertex_count_ == 0) return BadInput(file_.path() + ": no vertices");
    body_offset_ = text.offset();
    body_line_ = text.line();
    // "0 0 0" and "0" are the shortest lines; the file's last may lack its end.
    constexpr uint64_t kVertexBytes = 6, kFaceBytes = 2;
    const uint64_t left = text.remaining() + 1;
    if (vertex_count_ > left / kVertexBytes ||
        face_count_ > (left - vertex_count_ * kVertexBytes) / kFaceBytes) {
      return Error(text, "the header promises " + std::to_string(vertices) + " vertices and " +
                             std::to_string(faces) + " faces, but only " +
                             std::to_string(left - 1) +
                             " bytes follow; the file is cut short or the header is wrong");
    }
    return Status::Ok();
  }

  size_t values_expected() const {
    return 3 + (keyword_.normals ? kNormalValues : 0) + colour_values_;
  }

  // Cuts the line of vertex `index` into its values.
  Status VertexLine(TextReader& text, uint64_t index,
                    std::array<std::string_view, kMaxVertexValues>* values, size_t* count) const {
    std::string_view line;
    if (!NextLine(text, &line)) return EndError(text, "expected vertex " + std::to_string(index));
    LineTokens tokens(line);
    std::string_view token;
    *count = 0;
    while (*count < kMaxVertexValues && tokens.Next(&token)) (*values)[(*count)++] = token;
    return Status::Ok();
  }

  Status ParsePosition(const TextReader& text,
                       const std::array<std::string_view, kMaxVertexValues>& values,
                       Vec3d* position) const {
    for (int axis = 0; axis < 3; ++axis) {
      if (!ParseReal(values[axis], &(*position)[axis])) {
        return Error(text, "expected a number, found " + Quoted(values[axis]));
      }
    }
    return Status::Ok();
  }

  Status ScanPosition(const TextReader& text, uint64_t index,
                      const std::array<std::string_view, kMaxVertexValues>& values) {
    if (std::none_of(values.begin(), values.begin() + 3, MayBeNoCoordinate)) return Status::Ok();
    Vec3d position;
    MTDB_RETURN_IF_ERROR(ParsePosition(text, values, &position));
    if (AreCoordinates(position)) return Status::Ok();
    left_out_.Add(index, "line " + std::to_string(text.line()) + ": " + CoordinateFault(position));
    return Status::Ok();
  }

  // In a pass of its own, which files without polygons are spared.
  Result<std::unique_ptr<VertexPositions>> Positions(const ReaderSpace& tmp) const {
    auto positions = std::make_unique<PositionSpool>(tmp);
    TextReader text(file_, body_offset_, body_line_);
    std::array<std::string_view, kMaxVertexValues> values;
    for (uint64_t i = 0; i < vertex_count_; ++i) {
      size_t count = 0;
      MTDB_RETURN_IF_ERROR(VertexLine(text, i, &values, &count));
      if (count < 3) return EndError(text, "expected vertex values");
      Vec3d position;
      MTDB_RETURN_IF_ERROR(ParsePosition(text, values, &position));
      MTDB_RETURN_IF_ERROR(positions->Append(position));
    }
    MTDB_RETURN_IF_ERROR(positions->Finish());
    return std::unique_ptr<VertexPositions>(std::move(positions));
  }

  Status ScanVertices(TextReader& text) {
    std::array<std::string_view, kMaxVertexValues> values;
    for (uint64_t i = 0; i < vertex_count_; ++i) {
      size_t count = 0;
      MTDB_RETURN_IF_ERROR(VertexLine(text, i, &values, &count));
      if (i == 0 && keyword_.colours) colour_values_ = count == values_expected() + 3 ? 3 : 4;
      if (count < values_expected()) {
        return Error(text, "vertex " + std::to_string(i) + ": expected " +
                               std::to_string(values_expected()) + " numbers, found " +
                               std::to_string(count));
      }
      if (count > values_expected()) AddIgnored(report_, "values after a vertex");
      for (size_t k = 0; k < 3; ++k) {
        double_positions_ |= SignificantDigits(values[k]) > kFloatDigits;
      }
      MTDB_RETURN_IF_ERROR(ScanPosition(text, i, values));
      for (size_t k = 0; k < colour_values_; ++k) {
        const std::string_view colour = values[values_expected() - colour_values_ + k];
        unit_colours_ |= colour.find_first_of(".eE") != std::string_view::npos;
      }
    }
    return Status::Ok();
  }

  Status EmitVertex(TextReader& text, uint64_t index) {
    std::array<std::string_view, kMaxVertexValues> values;
    size_t count = 0;
    MTDB_RETURN_IF_ERROR(VertexLine(text, index, &values, &count));
    if (count < values_expected()) return EndError(text, "expected vertex values");
    Vec3d position;
    MTDB_RETURN_IF_ERROR(ParsePosition(text, values, &position));
    if (left_out_.Has(index)) return Status::Ok();
    std::byte row[kNormalValues * sizeof(float) + 4];
    size_t row_bytes = 0;
    size_t next = 3;
    for (; keyword_.normals && next < 3 + kNormalValues; ++next) {
      float value = 0;
      if (!ParseReal(values[next], &value)) {
        return Error(text, "expected a number, found " + Quoted(values[next]));
      }
      std::memcpy(row + row_bytes, &value, sizeof(value));
      row_bytes += sizeof(value);
    }
    for (size_t k = 0; k < colour_values_; ++k, ++next) {
      double value = 0;
      const double scale = unit_colours_ ? 255 : 1;
      if (!ParseReal(values[next], &value) || !(value >= 0 && value * scale <= 255)) {
        return Error(text, std::string("expected a colour from 0 to ") +
                               (unit_colours_ ? "1" : "255") + ", found " + Quoted(values[next]));
      }
      row[row_bytes++] = static_cast<std::byte>(std::lround(value * scale));
    }
    return emitter_.AddVertex(position, ByteSpan(row, row_bytes));
  }

  Status EmitFace(TextReader& text, uint64_t index) {
    const auto error = [&](const std::string& what) {
      return Error(text, "face " + std::to_string(index) + ": " + what);
    };
    std::string_view line, token;
    if (!NextLine(text, &line)) return EndError(text, "expected face " + std::to_string(index));
    LineTokens tokens(line);
    int64_t corners = 0;
    if (!tokens.Next(&token) || !ParseInteger(token, &corners) || corners < 0) {
      return error("expected a count of corners, found " + Quoted(token));
    }
    for (int64_t i = 0; i < corners; ++i) {
      int64_t v = 0;
      if (!tokens.Next(&token)) {
        return error("expected " + std::to_string(corners) + " vertex indices, found " +
                     std::to_string(i));
      }
      if (!ParseInteger(token, &v)) {
        return error("expected a vertex index, found " + Quoted(token));
      }
      if (v < 0 || static_cast<uint64_t>(v) >= vertex_count_) {
        return error("vertex index " + std::to_string(v) + ", but the file has " +
                     std::to_string(vertex_count_) + " vertices");
      }
      if (left_out_.Has(static_cast<VertexIndex>(v))) {
        return LeftOutError(
            file_.path(), left_out_, static_cast<VertexIndex>(v),
            "face " + std::to_string(index) + " of line " + std::to_string(text.line()));
      }
      MTDB_RETURN_IF_ERROR(faces_.AddCorner(static_cast<VertexIndex>(v)));
    }
    if (tokens.Next(&token)) AddIgnored(report_, "face colours");
    return faces_.EndFace();
  }

  const InputFile& file_;
  MeshEmitter emitter_;
  MeshReadReport* report_;
  LeftOutVertices left_out_;
  FaceEmitter faces_;
  OffKeyword keyword_;
  uint64_t vertex_count_ = 0;
  uint64_t face_count_ = 0;
  uint64_t body_offset_ = 0;
  uint64_t body_line_ = 0;
  size_t colour_values_ = 0;   // per vertex: 0, 3 or 4
  bool unit_colours_ = false;  // 0..1, not 0..255
  bool double_positions_ = false;
};

}  // namespace

MeshFileFit RecogniseOff(const MeshFileStart& start) {
  LineTokens tokens(start.text.substr(0, start.text.find_first_of("#\r\n")));
  std::string_view word;
  if (tokens.Next(&word) && ParseKeyword(TakeKeyword(&word)).valid) return MeshFileFit::kContent;
  return start.named ? MeshFileFit::kName : MeshFileFit::kNone;
}

Status ReadOff(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report) {
  return OffReader(file, start, sink, report).Read();
}

}  // namespace mtdb::internal
