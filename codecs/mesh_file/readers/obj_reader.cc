// SPDX-License-Identifier: Apache-2.0
// OBJ: read twice, as only a first pass over the vertices tells what the header must say (whether
// all vertices have colours, whether positions need double) and what indices are legal.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <utility>

#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/polygons/face_emitter.h"
#include "codecs/mesh_file/polygons/left_out_vertices.h"
#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/polygons/vertex_positions.h"
#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/textures/obj_textures.h"
#include "store/base/coordinate_limit.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMaxIgnored = 64;

// Statements that mtdb does not carry, and what they are.
constexpr std::array<std::array<std::string_view, 2>, 9> kDropped{{{"vt", "texture coordinates"},
                                                                   {"vn", "normals"},
                                                                   {"usemtl", "uses of materials"},
                                                                   {"mtllib", "material files"},
                                                                   {"g", "groups"},
                                                                   {"o", "object names"},
                                                                   {"s", "smoothing groups"},
                                                                   {"l", "lines"},
                                                                   {"p", "points"}}};

// The lines of a file. A vertex, its texture coordinates or a face may go on in the next line,
// behind a backslash. In what mtdb does not read, a backslash may be the end of a name or of a
// comment, as of "C:\scans\": there, only a line that begins with a number belongs to the one
// before, and is left out.
class ObjLines {
 public:
  explicit ObjLines(const InputFile& file) : text_(file) {}

  bool Next(std::string_view* line) {
    while (text_.NextLine(line)) {
      const bool ends_in_backslash = EndsInBackslash(*line);
      if (may_go_on_ && IsNumber(FirstWord(*line))) {
        may_go_on_ = ends_in_backslash;
        continue;
      }
      may_go_on_ = false;
      line_ = text_.line();
      if (!ends_in_backslash) return true;
      const std::string_view word = FirstWord(*line);
      if (word == "v" || word == "f" || word == "vt") return Join(line);
      may_go_on_ = word[0] != '#';
      return true;
    }
    return false;
  }
  uint64_t line() const { return line_; }  // the first of the joined ones
  const Status& status() const { return text_.status(); }

 private:
  static std::string_view FirstWord(std::string_view line) {
    std::string_view word;
    LineTokens(line).Next(&word);
    return word;
  }
  static bool IsNumber(std::string_view word) {
    return !word.empty() &&
           std::string_view("0123456789.+-").find(word[0]) != std::string_view::npos;
  }
  // White space behind it is hard to see, and does not count.
  static bool EndsInBackslash(std::string_view line) {
    size_t size = line.size();
    while (size > 0 && (line[size - 1] == ' ' || line[size - 1] == '\t')) --size;
    return size > 0 && line[size - 1] == '\\';
  }
  // A comment ends with its line, whatever is in it.
  bool Join(std::string_view* line) {
    joined_.clear();
    while (EndsInBackslash(*line) && line->find('#') == std::string_view::npos) {
      joined_ += line->substr(0, line->rfind('\\'));
      joined_ += ' ';
      *line = {};
      if (joined_.size() > TextReader::kMaxLineBytes || !text_.NextLine(line)) break;
    }
    joined_ += *line;
    *line = joined_;
    return text_.status().ok();
  }

  TextReader text_;
  std::string joined_;
  uint64_t line_ = 0;
  bool may_go_on_ = false;  // the line before was none of mtdb's, and ended in a backslash
};

// Colours as they stand in the file.
enum class ColourScale { kNone, kUnit, kByte };

class ObjReader {
 public:
  ObjReader(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
            MeshReadReport* report)
      : file_(file),
        emitter_(sink),
        report_(report),
        textures_(file.path(), start.tmp, report),
        faces_(emitter_, report, left_out_, [this, tmp = start.tmp] { return Positions(tmp); }) {}

  Status Read() {
    report_->format = "OBJ";
    MTDB_RETURN_IF_ERROR(Scan());
    if (vertex_count_ == 0) {
      return BadInput(file_.path() + ": no vertices, expected lines 'v X Y Z'");
    }
    if (left_out_.count() == vertex_count_) return NoVertexLeft(file_.path(), left_out_);
    report_->left_out_vertices = left_out_.count();
    MeshHeader header;
    header.vertex_count = vertex_count_ - left_out_.count();
    header.double_positions = double_positions_;
    header.from_text = true;
    if (colours_ != ColourScale::kNone) {
      for (const char* name : {"red", "green", "blue"}) {
        header.attributes.attributes.push_back({name, ScalarType::kUint8});
      }
    }
    MTDB_RETURN_IF_ERROR(textures_.Finish());
    if (textures_.are_used()) textures_.PutInto(&header);
    MTDB_RETURN_IF_ERROR(emitter_.Begin(header));
    MTDB_RETURN_IF_ERROR(Emit());
    MTDB_RETURN_IF_ERROR(faces_.End());
    AddWrongCorners(emitter_.wrong_corners(), report_);
    return emitter_.End();
  }

 private:
  struct Vertex {
    Vec3d position;
    std::array<double, 3> colour{};
    bool has_colour = false;
    bool has_weight = false;
    bool has_more = false;  // than a colour with alpha
    bool colour_is_integer = true;
    bool long_digits = false;
  };

  Status Error(const ObjLines& lines, const std::string& what) const {
    return BadInput(file_.path() + ": line " + std::to_string(lines.line()) + ": " + what);
  }

  // "v X Y Z", "v X Y Z W", "v X Y Z R G B", "v X Y Z R G B A"; numbers behind these are reported.
  Status ParseVertex(const ObjLines& lines, LineTokens tokens, Vertex* vertex) const {
    constexpr size_t kMax = 8;
    std::string_view values[kMax];
    size_t count = 0;
    std::string_view token;
    while (count < kMax && tokens.Next(&token) && token[0] != '#') values[count++] = token;
    vertex->has_more = count == kMax;
    if (count < 3) {
      return Error(lines, "expected 'v X Y Z', found " + std::to_string(count) + " numbers");
    }
    for (int axis = 0; axis < 3; ++axis) {
      double& value = vertex->position[axis];
      if (!ParseReal(values[axis], &value)) {
        return Error(lines, "expected a number, found " + Quoted(values[axis]));
      }
      vertex->long_digits |= SignificantDigits(values[axis]) > kFloatDigits;
    }
    vertex->has_weight = count == 4 || count == 5;
    vertex->has_colour = count >= 6;
    for (size_t i = 0; vertex->has_colour && i < 3; ++i) {
      const std::string_view text = values[3 + i];
      if (!ParseReal(text, &vertex->colour[i]) || !std::isfinite(vertex->colour[i])) {
        return Error(lines, "expected a colour, found " + Quoted(text));
      }
      vertex->colour_is_integer &= vertex->colour[i] == std::floor(vertex->colour[i]);
    }
    return Status::Ok();
  }

  // What is behind a line's word.
  static std::string_view RestOf(std::string_view line, std::string_view word) {
    return line.substr(static_cast<size_t>(word.data() + word.size() - line.data()));
  }

  // First pass: vertices, and what faces have of textures.
  Status Scan() {
    ObjLines lines(file_);
    std::string_view line, word;
    uint64_t coloured = 0;
    bool all_unit = true, all_byte = true;
    while (lines.Next(&line)) {
      LineTokens tokens(line);
      if (!tokens.Next(&word)) continue;
      if (word != "v") {
        MTDB_RETURN_IF_ERROR(textures_.Scan(word, RestOf(line, word)));
        continue;
      }
      Vertex vertex;
      MTDB_RETURN_IF_ERROR(ParseVertex(lines, tokens, &vertex));
      if (!AreCoordinates(vertex.position)) {
        left_out_.Add(vertex_count_, "line " + std::to_string(lines.line()) + ": " +
                                         CoordinateFault(vertex.position));
      }
      ++vertex_count_;
      double_positions_ |= vertex.long_digits;
      if (vertex.has_weight) AddIgnored(report_, "vertex weights");
      if (vertex.has_more) AddIgnored(report_, "numbers behind the colour of a vertex");
      if (!vertex.has_colour) continue;
      ++coloured;
      for (const double c : vertex.colour) {
        all_unit &= c >= 0 && c <= 1;
        all_byte &= c >= 0 && c <= 255 && vertex.colour_is_integer;
      }
    }
    if (coloured == vertex_count_ && (all_unit || all_byte)) {
      colours_ = all_unit ? ColourScale::kUnit : ColourScale::kByte;
    } else if (coloured > 0) {
      AddIgnored(report_, coloured < vertex_count_ ? "vertex colours (not all vertices have one)"
                                                   : "vertex colours (not from 0 to 1)");
    }
    return lines.status();
  }

  Status Emit() {
    ObjLines lines(file_);
    std::string_view line, word;
    while (lines.Next(&line)) {
      LineTokens tokens(line);
      if (!tokens.Next(&word) || word[0] == '#') continue;
      if (word == "v") {
        MTDB_RETURN_IF_ERROR(EmitVertex(lines, tokens));
      } else if (word == "f") {
        MTDB_RETURN_IF_ERROR(EmitFace(lines, tokens));
      } else if (!textures_.are_used() || !textures_.Follow(word, RestOf(line, word))) {
        CountDropped(word);
      }
    }
    for (const auto& [what, count] : dropped_) {
      AddIgnored(report_, std::to_string(count) + " " + what);
    }
    return lines.status();
  }

  void CountDropped(std::string_view word) {
    const auto known = std::find_if(kDropped.begin(), kDropped.end(),
                                    [&](const auto& statement) { return statement[0] == word; });
    std::string what;
    if (known != kDropped.end()) {
      what = (*known)[1];
    } else {
      const std::string quoted = Quoted(word);
      what = "OBJ statements " + quoted.substr(1, quoted.size() - 2);
    }
    const auto at = std::find_if(dropped_.begin(), dropped_.end(),
                                 [&](const auto& entry) { return entry.first == what; });
    if (at != dropped_.end()) {
      ++at->second;
    } else if (dropped_.size() < kMaxIgnored) {
      dropped_.emplace_back(what, 1);
    }
  }

  Status EmitVertex(const ObjLines& lines, LineTokens tokens) {
    Vertex vertex;
    MTDB_RETURN_IF_ERROR(ParseVertex(lines, tokens, &vertex));
    if (left_out_.Has(vertices_seen_++)) return Status::Ok();
    std::array<std::byte, 3> row{};
    const double scale = colours_ == ColourScale::kUnit ? 255 : 1;
    for (size_t i = 0; colours_ != ColourScale::kNone && i < row.size(); ++i) {
      row[i] = static_cast<std::byte>(std::lround(vertex.colour[i] * scale));
    }
    return emitter_.AddVertex(vertex.position,
                              ByteSpan(row).first(colours_ == ColourScale::kNone ? 0 : row.size()));
  }

  // "12", "12/3", "12//4", "12/3/4"; only the first number matters here, the second one to
  // textures_.
  Status ParseCorner(const ObjLines& lines, std::string_view token, VertexIndex* vertex) const {
    const size_t slash = std::min(token.find('/'), token.size());
    int64_t index = 0;
    if (!ParseInteger(token.substr(0, slash), &index) || !IsReferences(token.substr(slash))) {
      return Error(lines,
                   "expected a corner like 12, 12/3, 12//4 or 12/3/4, found " + Quoted(token));
    }
    const auto seen = static_cast<int64_t>(vertices_seen_);
    const int64_t absolute = index > 0 ? index - 1 : index + seen;
    if (index == 0 || absolute < 0 || absolute >= static_cast<int64_t>(vertex_count_)) {
      return Error(lines, "vertex index " + std::to_string(index) + ", but the file has " +
                              std::to_string(index < 0 ? vertices_seen_ : vertex_count_) +
                              (index < 0 ? " vertices up to here" : " vertices, counted from 1"));
    }
    *vertex = static_cast<VertexIndex>(absolute);
    if (!left_out_.Has(*vertex)) return Status::Ok();
    return LeftOutError(file_.path(), left_out_, *vertex,
                        "the face of line " + std::to_string(lines.line()));
  }

  static bool IsReferences(std::string_view text) {
    return std::count(text.begin(), text.end(), '/') <= 2 &&
           text.find_first_not_of("0123456789-/") == std::string_view::npos;
  }

  Status EmitFace(const ObjLines& lines, LineTokens tokens) {
    const bool is_textured = textures_.are_used() && ObjTextures::HasAll(tokens);
    std::string_view token;
    while (tokens.Next(&token) && token[0] != '#') {
      VertexIndex v = 0;
      MTDB_RETURN_IF_ERROR(ParseCorner(lines, token, &v));
      TextureCorner corner = kNoTexture;
      if (is_textured) MTDB_RETURN_IF_ERROR(textures_.Corner(token, &corner));
      MTDB_RETURN_IF_ERROR(faces_.AddCorner(v, corner));
    }
    return faces_.EndFace();
  }

  // In a pass of its own, which files without polygons are spared.
  Result<std::unique_ptr<VertexPositions>> Positions(ReaderSpace tmp) const {
    tmp.max_bytes -= std::min(tmp.max_bytes, textures_.temporary_bytes());
    auto positions = std::make_unique<PositionSpool>(tmp);
    ObjLines lines(file_);
    std::string_view line, word;
    while (lines.Next(&line)) {
      LineTokens tokens(line);
      if (!tokens.Next(&word) || word != "v") continue;
      Vertex vertex;
      MTDB_RETURN_IF_ERROR(ParseVertex(lines, tokens, &vertex));
      MTDB_RETURN_IF_ERROR(positions->Append(vertex.position));
    }
    MTDB_RETURN_IF_ERROR(lines.status());
    MTDB_RETURN_IF_ERROR(positions->Finish());
    return std::unique_ptr<VertexPositions>(std::move(positions));
  }

  const InputFile& file_;
  MeshEmitter emitter_;
  MeshReadReport* report_;
  LeftOutVertices left_out_;
  ObjTextures textures_;
  FaceEmitter faces_;
  std::vector<std::pair<std::string, uint64_t>> dropped_;  // in the order of first sight
  uint64_t vertex_count_ = 0;
  uint64_t vertices_seen_ = 0;
  bool double_positions_ = false;
  ColourScale colours_ = ColourScale::kNone;
};

}  // namespace

MeshFileFit RecogniseObj(const MeshFileStart& start) {
  return start.named ? MeshFileFit::kContent : MeshFileFit::kNone;
}

Status ReadObj(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report) {
  return ObjReader(file, start, sink, report).Read();
}

}  // namespace mtdb::internal
