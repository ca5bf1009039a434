// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/internal/stream_start.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <string_view>
#include <vector>

#include "codecs/mesh_file/input/ply_header.h"
#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/readers/readers.h"
#include "store/base/attributes.h"

namespace mtdb::internal {
namespace {

constexpr const char* kInTheFirst = " in the first MiB; nothing more was read";
constexpr uint64_t kNoLimit = ~uint64_t{0};

Status None(const InputFile& start, const std::string& what) {
  return BadInput(start.path() + ": " + what + kInTheFirst);
}

// a * b + c, as much as fits.
uint64_t Saturated(uint64_t a, uint64_t b, uint64_t c) {
  uint64_t product = 0, sum = 0;
  return __builtin_mul_overflow(a, b, &product) || __builtin_add_overflow(product, c, &sum)
             ? kNoLimit
             : sum;
}

// The most that an element takes in binary.
uint64_t MostBytes(const PlyElement& element) {
  uint64_t bytes = 0;
  for (const PlyProperty& p : element.properties) {
    if (!p.is_list) {
      bytes = Saturated(1, ScalarSize(p.type), bytes);
      continue;
    }
    const size_t count_bytes = ScalarSize(p.count_type);
    const uint64_t most = (uint64_t{1} << (8 * std::min<size_t>(count_bytes, 4))) - 1;
    bytes = Saturated(most, ScalarSize(p.type), Saturated(1, count_bytes, bytes));
  }
  return bytes;
}

Result<StreamFacts> CheckPly(const InputFile& start, std::string_view text) {
  const Result<PlyHeader> header = ReadPlyHeader(start);
  if (!header.ok()) {
    // What has come of a header that goes on may end anywhere.
    const bool goes_on = text.find("end_header") == text.npos && text.find('\0') == text.npos;
    return goes_on ? None(start, "the header of a PLY file does not end") : header.status();
  }
  StreamFacts facts;
  facts.is_text = header->encoding == PlyEncoding::kAscii;
  if (facts.is_text) return facts;
  facts.most_bytes = header->body_offset;
  for (const PlyElement& element : header->elements) {
    facts.most_bytes = Saturated(element.count, MostBytes(element), facts.most_bytes);
  }
  return facts;
}

Result<StreamFacts> CheckBinaryStl(const InputFile& start, ByteSpan bytes) {
  constexpr size_t kHeaderBytes = 84, kTriangleBytes = 50, kNormalBytes = 12;
  uint32_t triangles = 0;
  std::memcpy(&triangles, bytes.data() + kHeaderBytes - sizeof(triangles), sizeof(triangles));
  // Programs that write as they go may leave 0 or -1 for the count, though facets follow.
  const bool is_counted = triangles != 0 && triangles != ~uint32_t{0};
  const size_t most = (bytes.size() - kHeaderBytes) / kTriangleBytes;
  const size_t whole = is_counted ? std::min<uint64_t>(triangles, most) : most;
  bool has_facet = false;
  for (size_t i = 0; i < whole; ++i) {
    std::array<Vec3f, 3> corners;
    std::memcpy(corners.data(), bytes.data() + kHeaderBytes + i * kTriangleBytes + kNormalBytes,
                sizeof(corners));
    has_facet |= corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0];
    for (const Vec3f& corner : corners) {
      const std::string problem = CoordinateFault({corner.x, corner.y, corner.z});
      if (problem.empty()) continue;
      return BadInput(start.path() + ": facet " + std::to_string(i) + ": " + problem);
    }
  }
  if (!is_counted && !has_facet)
    return None(start, "no facet of a binary STL file, whose count is 0,");
  if (!is_counted) return StreamFacts{};
  return StreamFacts{Saturated(triangles, kTriangleBytes, kHeaderBytes), false};
}

// Whether a line of the text begins with one of these words, in capital or small letters.
bool HasLineOf(std::string_view text, std::initializer_list<std::string_view> words) {
  while (!text.empty()) {
    const size_t end = std::min(text.find_first_of("\r\n"), text.size());
    std::string_view word;
    LineTokens(text.substr(0, end)).Next(&word);
    std::string lower(word.substr(0, 16));
    for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (std::ranges::find(words, lower) != words.end()) return true;
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return false;
}

// The keyword, and two counts behind it.
bool HasOffCounts(std::string_view text) {
  int numbers =
      -1;  // the keyword comes first, if there is one, and the first count may follow it at once
  while (!text.empty() && numbers < 2) {
    const size_t end = std::min(text.find_first_of("\r\n"), text.size());
    LineTokens tokens(text.substr(0, std::min(text.find('#'), end)));
    std::string_view word;
    while (numbers < 2 && tokens.Next(&word)) {
      int64_t value = 0;
      if (numbers < 0) {
        numbers = 0;
        const size_t keyword = word.find("OFF");
        if (keyword != word.npos) word.remove_prefix(keyword + 3);
        if (!ParseInteger(word, &value)) continue;
      } else if (!ParseInteger(word, &value)) {
        return false;
      }
      ++numbers;
    }
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return numbers == 2;
}

// The file's length is in its header, and no JSON is longer than its reader takes.
Result<StreamFacts> CheckGltf(ByteSpan bytes, bool binary) {
  constexpr uint64_t kMostJsonBytes = uint64_t{16} << 20;
  if (!binary) return StreamFacts{kMostJsonBytes, true};
  constexpr size_t kLengthOffset = 8;
  uint32_t length = 0;
  std::memcpy(&length, bytes.data() + kLengthOffset, sizeof(length));
  return StreamFacts{length, false};
}

// Versions 1.0 to 2.9, a point cloud or a mesh, coded one way or the other.
Result<StreamFacts> CheckDraco(const InputFile& start, ByteSpan bytes) {
  constexpr size_t kVersion = 5, kType = 7, kMethod = 8;
  const auto at = [&](size_t i) { return std::to_integer<unsigned>(bytes[i]); };
  if (at(kVersion) >= 1 && at(kVersion) <= 2 && at(kType) <= 1 && at(kMethod) <= 1) {
    return StreamFacts{};
  }
  return BadInput(start.path() + ": begins as a Draco file of version " +
                  std::to_string(at(kVersion)) + ", which there is not; it is no Draco file");
}

Result<StreamFacts> CheckText(const InputFile& start, std::string_view name,
                              std::string_view text) {
  if (name == "OBJ" &&
      !HasLineOf(text, {"v", "vt", "vn", "vp", "f", "o", "g", "s", "l", "p", "usemtl", "mtllib"})) {
    return None(start, "no statement of OBJ ('v X Y Z', 'f A B C', ...)");
  }
  if (name == "STL" && !HasLineOf(text, {"facet", "endsolid"})) {
    return None(start, "no facet of an ASCII STL file");
  }
  if (name == "OFF" && !HasOffCounts(text)) {
    return None(start, "no counts 'V F E' of an OFF file");
  }
  return StreamFacts{kNoLimit, true};
}

}  // namespace

Result<StreamFacts> CheckStreamStart(const InputFile& start, const MeshFormatRow* row,
                                     const MeshFileStart& first) {
  if (row == nullptr) return StreamFacts{};  // the caller says so
  std::vector<std::byte> buffer(kStreamStartBytes);
  MTDB_ASSIGN_OR_RETURN(const size_t size, start.ReadAt(0, buffer));
  if (size < kStreamStartBytes) return StreamFacts{};
  const ByteSpan bytes(buffer);
  const std::string_view text = AsString(bytes);
  const std::string_view name = row->format.name;
  const bool is_text_stl = IsAsciiStl(first) && text.find('\0') == std::string_view::npos;
  StreamFacts facts;
  if (name == "PLY") {
    MTDB_ASSIGN_OR_RETURN(facts, CheckPly(start, text));
  } else if (name == "STL" && !is_text_stl) {
    MTDB_ASSIGN_OR_RETURN(facts, CheckBinaryStl(start, bytes));
  } else if (name == "glTF" || name == "glTF JSON") {
    MTDB_ASSIGN_OR_RETURN(facts, CheckGltf(bytes, name == "glTF"));
  } else if (name == "Draco") {
    MTDB_ASSIGN_OR_RETURN(facts, CheckDraco(start, bytes));
  } else if (name == "OBJ" || name == "OFF" || name == "STL") {
    MTDB_ASSIGN_OR_RETURN(facts, CheckText(start, name, text));
  }
  const size_t zero = facts.is_text ? text.find('\0') : text.npos;
  if (zero != text.npos) {
    return BadInput(start.path() + ": byte " + std::to_string(zero) +
                    " is 0, expected the text of a " + std::string(name) + " file");
  }
  return facts;
}

}  // namespace mtdb::internal
