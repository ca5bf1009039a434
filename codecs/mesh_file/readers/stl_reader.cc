// SPDX-License-Identifier: Apache-2.0
// STL, binary and ASCII: a soup of triangles, whose corners are joined by exact position.
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>

#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/polygons/vertex_joiner.h"
#include "codecs/mesh_file/readers/readers.h"

namespace mtdb::internal {
namespace {

constexpr size_t kHeaderBytes = 84;  // 80 of any text, and the count
constexpr size_t kTextBytes = 80;
constexpr size_t kTriangleBytes = 50;  // normal, three corners, two bytes

// Joins corners and sends what is new, or sends all where the sink joins them. Positions are
// offsets from `origin`.
template <typename Position>
class SoupEmitter {
 public:
  explicit SoupEmitter(MeshSink& sink, Vec3d origin = {})
      : emitter_(sink), raw_(sink.joins_soup()), most_bytes_(sink.soup_bytes()), origin_(origin) {}

  Status Begin(MeshHeader header) {
    header.soup = raw_;
    return emitter_.Begin(header);
  }
  Status AddTriangle(const std::string& path, const std::array<Position, 3>& corners) {
    empty_ = false;
    if (raw_) {
      for (const Position& p : corners) MTDB_RETURN_IF_ERROR(AddVertex(p));
      next_ += 3;
      return emitter_.AddTriangle(next_ - 3, next_ - 2, next_ - 1);
    }
    TriangleVertices triangle{};
    for (size_t i = 0; i < 3; ++i) {
      if (joiner_.size() == VertexJoiner<Position>::kMaxVertices) {
        return Unsupported(path + ": STL of more than 4294967295 vertices; convert it to PLY");
      }
      if (const uint64_t bytes = joiner_.next_bytes(); bytes > most_bytes_) {
        return Status(StatusCode::kBudgetExceeded,
                      path + ": to join the corners of more than " +
                          std::to_string(joiner_.size()) + " vertices takes " +
                          std::to_string((bytes >> 20) + 1) + " MiB, " +
                          std::to_string(most_bytes_ >> 20) +
                          " MiB are allowed; allow more --memory, convert it to PLY, or ingest it "
                          "without files of "
                          "other formats");
      }
      bool added = false;
      const uint32_t index = joiner_.Add(corners[i], &added);
      triangle[i] = index;
      if (!added) continue;
      MTDB_RETURN_IF_ERROR(AddVertex(joiner_.position(index)));
    }
    return emitter_.AddTriangle(triangle[0], triangle[1], triangle[2]);
  }
  Status End() { return emitter_.End(); }
  bool empty() const { return empty_; }

 private:
  Status AddVertex(const Position& p) {
    return emitter_.AddVertex(origin_ + Vec3d{p.x, p.y, p.z}, {});
  }
  MeshEmitter emitter_;
  const bool raw_;
  const uint64_t most_bytes_;
  const Vec3d origin_;
  VertexIndex next_ = 0;
  bool empty_ = true;
  VertexJoiner<Position> joiner_;
};

std::string CornerFault(Vec3f p) { return CoordinateFault({p.x, p.y, p.z}); }

bool IsZero(Vec3f p) { return p.x == 0 && p.y == 0 && p.z == 0; }

// What the writer of far meshes says in the header.
Vec3d OriginOf(std::string_view text) {
  const std::string start = std::string("binary STL by mtdb") + kStlOriginWord;
  if (!text.starts_with(start)) return {};
  LineTokens tokens(text.substr(start.size()));
  Vec3d origin;
  for (int i = 0; i < 3; ++i) {
    std::string_view token;
    if (!tokens.Next(&token) || !ParseReal(token, &origin[i]) || !std::isfinite(origin[i])) {
      return {};
    }
  }
  return origin;
}

class AsciiStlReader {
 public:
  AsciiStlReader(const InputFile& file, MeshSink& sink, MeshReadReport* report)
      : file_(file), text_(file), soup_(sink), report_(report) {}

  Status Read() {
    report_->format = "STL ASCII";
    MeshHeader header;
    header.from_text = true;
    MTDB_ASSIGN_OR_RETURN(header.double_positions, HasLongDigits());
    MTDB_RETURN_IF_ERROR(soup_.Begin(header));
    bool any = false;
    while (NextLine()) {
      any = true;
      if (word_ != "solid") return Expected("'solid'");
      MTDB_RETURN_IF_ERROR(ReadSolid());
    }
    MTDB_RETURN_IF_ERROR(text_.status());
    if (!any || soup_.empty()) return BadInput(file_.path() + ": no facets");
    return soup_.End();
  }

 private:
  // Puts the first word of the next line that has one into word_, in small letters, and leaves
  // the others to tokens_.
  bool NextLine() {
    word_.clear();
    while (text_.NextLine(&line_)) {
      tokens_ = LineTokens(line_);
      std::string_view word;
      if (!tokens_.Next(&word)) continue;
      word_ = Lower(word);
      return true;
    }
    line_ = {};
    return false;
  }
  static std::string Lower(std::string_view word) {
    std::string lower(word.substr(0, 16));  // longer than any keyword
    for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return lower;
  }
  bool NextWordIs(const char* keyword) {
    std::string_view word;
    return tokens_.Next(&word) && Lower(word) == keyword;
  }

  Status Expected(const std::string& what) const {
    MTDB_RETURN_IF_ERROR(text_.status());
    if (word_.empty()) {
      return BadInput(file_.path() + ": expected " + what +
                      ", found the end of the file; the file is cut short");
    }
    return BadInput(file_.path() + ": line " + std::to_string(text_.line()) + ": expected " + what +
                    ", found " + Quoted(line_));
  }

  // A pass of its own, which ends at the first number that float32 cannot be meant by.
  Result<bool> HasLongDigits() const {
    TextReader text(file_);
    std::string_view line, token;
    while (text.NextLine(&line)) {
      LineTokens tokens(line);
      if (!tokens.Next(&token) || Lower(token) != "vertex") continue;
      while (tokens.Next(&token)) {
        if (SignificantDigits(token) > kFloatDigits) return true;
      }
    }
    MTDB_RETURN_IF_ERROR(text.status());
    return false;
  }

  Status ReadVector(Vec3d* v) {
    for (int axis = 0; axis < 3; ++axis) {
      std::string_view token;
      if (!tokens_.Next(&token) || !ParseReal(token, &(*v)[axis])) {
        return Expected("three numbers");
      }
    }
    return Status::Ok();
  }

  Status ReadSolid() {
    for (;;) {
      if (!NextLine()) return Expected("'facet' or 'endsolid'");
      if (word_ == "endsolid") return Status::Ok();
      if (word_ != "facet") return Expected("'facet' or 'endsolid'");
      MTDB_RETURN_IF_ERROR(ReadFacet());
    }
  }

  Status ReadFacet() {
    if (!NextWordIs("normal")) return Expected("'facet normal X Y Z'");
    // Normals are not used, and some programs write what is no number.
    std::string_view token;
    for (double value = 0; tokens_.Next(&token);) {
      if (!ParseReal(token, &value) || value != 0) AddIgnored(report_, "facet normals");
    }
    if (!NextLine() || word_ != "outer" || !NextWordIs("loop")) return Expected("'outer loop'");
    std::array<Vec3d, 3> corners;
    for (Vec3d& corner : corners) {
      if (!NextLine() || word_ != "vertex") return Expected("'vertex X Y Z'");
      MTDB_RETURN_IF_ERROR(ReadVector(&corner));
      if (tokens_.Next(&token)) return Expected("'vertex X Y Z' and no more");
      if (std::string problem = CoordinateFault(corner); !problem.empty()) {
        return BadInput(file_.path() + ": line " + std::to_string(text_.line()) + ": " + problem);
      }
    }
    if (!NextLine() || word_ != "endloop") return Expected("'endloop'");
    if (!NextLine() || word_ != "endfacet") return Expected("'endfacet'");
    return soup_.AddTriangle(file_.path(), corners);
  }

  const InputFile& file_;
  TextReader text_;
  SoupEmitter<Vec3d> soup_;
  MeshReadReport* report_;
  std::string_view line_;
  std::string word_;
  LineTokens tokens_{{}};
};

bool HasBinarySize(const MeshFileStart& start) {
  if (start.bytes.size() < kHeaderBytes) return false;
  uint32_t triangles = 0;
  std::memcpy(&triangles, start.bytes.data() + kHeaderBytes - sizeof(triangles), sizeof(triangles));
  return start.file_bytes == kHeaderBytes + uint64_t{kTriangleBytes} * triangles;
}

// Programs that write as they go may leave 0 or -1 for the count, though facets follow.
uint64_t FacetsBehind(uint32_t promised, uint64_t bytes) {
  const bool is_open = promised == 0 || promised == ~uint32_t{0};
  const uint64_t facets = bytes / kTriangleBytes;
  return is_open && bytes % kTriangleBytes == 0 && facets < ~uint32_t{0} ? facets : promised;
}

}  // namespace

bool IsAsciiStl(const MeshFileStart& start) {
  constexpr std::string_view kSolid = "solid";
  const size_t word = std::min(start.text.find_first_not_of(" \t\r\n\v\f"), start.text.size());
  const std::string_view text = start.text.substr(word);
  const bool is_solid =
      std::equal(kSolid.begin(), kSolid.end(), text.begin(),
                 text.begin() + std::min(kSolid.size(), text.size()),
                 [](char a, char b) { return a == std::tolower(static_cast<unsigned char>(b)); });
  if (!is_solid || !StartsWithWord(text, text.substr(0, kSolid.size()))) return false;
  const bool has_nul = start.bytes.substr(0, kHeaderBytes).find('\0') != std::string_view::npos;
  return !(start.named && has_nul);
}

MeshFileFit RecogniseStl(const MeshFileStart& start) {
  if (start.named && HasBinarySize(start)) return MeshFileFit::kCertain;
  if (IsAsciiStl(start)) return MeshFileFit::kContent;
  return start.named ? MeshFileFit::kName : MeshFileFit::kNone;
}

Status ReadStl(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report) {
  const bool binary = !IsAsciiStl(start) || (start.named && HasBinarySize(start));
  return binary ? ReadBinaryStl(file, sink, report) : ReadAsciiStl(file, sink, report);
}

Status ReadAsciiStl(const InputFile& file, MeshSink& sink, MeshReadReport* report) {
  return AsciiStlReader(file, sink, report).Read();
}

namespace {

Status ReadFacets(const std::string& path, uint32_t triangles, BlockReader& reader,
                  SoupEmitter<Vec3f>& soup, MeshReadReport* report) {
  for (uint32_t i = 0; i < triangles; ++i) {
    if (!reader.Ensure(kTriangleBytes)) {
      MTDB_RETURN_IF_ERROR(reader.status());
      return BadInput(path + ": facet " + std::to_string(i) +
                      ": the file ends in the middle of it");
    }
    Vec3f normal;
    std::array<Vec3f, 3> corners;
    uint16_t attribute = 0;
    std::memcpy(&normal, reader.data(), sizeof(normal));
    std::memcpy(corners.data(), reader.data() + sizeof(normal), sizeof(corners));
    std::memcpy(&attribute, reader.data() + sizeof(normal) + sizeof(corners), sizeof(attribute));
    reader.Consume(kTriangleBytes);
    if (!IsZero(normal)) AddIgnored(report, "facet normals");
    if (attribute != 0) AddIgnored(report, "facet attribute bytes");
    for (const Vec3f& corner : corners) {
      if (std::string problem = CornerFault(corner); !problem.empty()) {
        return BadInput(path + ": facet " + std::to_string(i) + ": " + problem);
      }
    }
    MTDB_RETURN_IF_ERROR(soup.AddTriangle(path, corners));
  }
  return Status::Ok();
}

}  // namespace

Status ReadBinaryStl(const InputFile& file, MeshSink& sink, MeshReadReport* report) {
  report->format = "STL binary";
  BlockReader reader(file, 0);
  if (!reader.Ensure(kHeaderBytes)) {
    MTDB_RETURN_IF_ERROR(reader.status());
    return BadInput(file.path() +
                    ": expected STL, binary with a header of 84 bytes or text that "
                    "begins with 'solid', found " +
                    std::to_string(file.size_bytes()) + " bytes");
  }
  uint32_t triangles = 0;
  std::memcpy(&triangles, reader.data() + kHeaderBytes - sizeof(triangles), sizeof(triangles));
  MeshHeader header;
  const Vec3d origin = OriginOf({reinterpret_cast<const char*>(reader.data()), kTextBytes});
  header.double_positions = origin != Vec3d{};
  reader.Consume(kHeaderBytes);
  const uint64_t left = reader.remaining();
  if (const uint64_t facets = FacetsBehind(triangles, left); facets != triangles) {
    report->notes.push_back("the header has no count of facets (" + std::to_string(triangles) +
                            "), " + std::to_string(facets) + " follow and were read");
    triangles = static_cast<uint32_t>(facets);
  }
  if (triangles == 0) {
    return BadInput(file.path() + ": no facets: the header's count is 0, and " +
                    std::to_string(left) + " bytes follow, expected a multiple of 50");
  }
  if (left / kTriangleBytes < triangles) {
    return BadInput(file.path() + ": the header promises " + std::to_string(triangles) +
                    " facets of 50 bytes, but only " + std::to_string(left) +
                    " bytes follow; the file is cut short or is no STL");
  }
  header.triangle_count = triangles;
  SoupEmitter<Vec3f> soup(sink, origin);
  MTDB_RETURN_IF_ERROR(soup.Begin(header));
  MTDB_RETURN_IF_ERROR(ReadFacets(file.path(), triangles, reader, soup, report));
  if (reader.remaining() > 0) {
    AddIgnored(report, std::to_string(reader.remaining()) + " bytes after the last facet");
  }
  return soup.End();
}

}  // namespace mtdb::internal
