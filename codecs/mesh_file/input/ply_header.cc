// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/input/ply_header.h"

#include <algorithm>
#include <optional>
#include <string_view>

#include "codecs/mesh_file/input/text_reader.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMaxElements = 256;
constexpr size_t kMaxProperties = 4096;  // of an element
constexpr size_t kMaxTextures = 65536;

std::optional<ScalarType> TypeFromName(std::string_view name) {
  struct Entry {
    std::string_view name;
    ScalarType type;
  };
  static constexpr Entry kTypes[] = {
      {"char", ScalarType::kInt8},      {"int8", ScalarType::kInt8},
      {"uchar", ScalarType::kUint8},    {"uint8", ScalarType::kUint8},
      {"short", ScalarType::kInt16},    {"int16", ScalarType::kInt16},
      {"ushort", ScalarType::kUint16},  {"uint16", ScalarType::kUint16},
      {"int", ScalarType::kInt32},      {"int32", ScalarType::kInt32},
      {"uint", ScalarType::kUint32},    {"uint32", ScalarType::kUint32},
      {"float", ScalarType::kFloat32},  {"float32", ScalarType::kFloat32},
      {"double", ScalarType::kFloat64}, {"float64", ScalarType::kFloat64},
  };
  for (const Entry& e : kTypes) {
    if (e.name == name) return e.type;
  }
  return std::nullopt;
}

class HeaderParser {
 public:
  explicit HeaderParser(const InputFile& file) : file_(file), text_(file) {}

  Result<PlyHeader> Parse() {
    std::string_view line;
    if (!NextLine(&line) || line != "ply") {
      MTDB_RETURN_IF_ERROR(text_.status());
      return BadInput(file_.path() + ": line 1: expected 'ply', found " + Quoted(line));
    }
    const TextReader::LineEnd first_end = text_.line_end();
    bool ended = false;
    while (!ended) {
      if (!NextLine(&line)) {
        MTDB_RETURN_IF_ERROR(text_.status());
        return BadInput(file_.path() +
                        ": the header has no end_header line; the file is cut short");
      }
      MTDB_RETURN_IF_ERROR(ParseLine(line, &ended));
    }
    if (text_.offset() == file_.size_bytes() && !EndsWithNewline()) {
      return BadInput(file_.path() + ": the file ends within the header; it is cut short");
    }
    if (!has_format_) return BadInput(file_.path() + ": the header has no format line");
    header_.body_offset = text_.offset();
    // Where lines end in CR, an LF behind the last one is a value's byte.
    if (first_end == TextReader::LineEnd::kCr && text_.line_end() == TextReader::LineEnd::kCrLf &&
        header_.encoding != PlyEncoding::kAscii) {
      --header_.body_offset;
    }
    header_.line_count = text_.line();
    MTDB_RETURN_IF_ERROR(CheckCounts());
    return std::move(header_);
  }

 private:
  bool NextLine(std::string_view* line) {
    if (!text_.NextLine(line)) return false;
    while (!line->empty() && (line->back() == ' ' || line->back() == '\t')) {
      line->remove_suffix(1);
    }
    return true;
  }

  bool EndsWithNewline() const {
    std::byte last{};
    const Result<size_t> n = file_.ReadAt(file_.size_bytes() - 1, {&last, 1});
    return n.ok() && *n == 1 && (last == std::byte{'\n'} || last == std::byte{'\r'});
  }

  Status Error(const std::string& what) const {
    return BadInput(file_.path() + ": line " + std::to_string(text_.line()) + ": " + what);
  }

  Status ParseLine(std::string_view line, bool* ended) {
    LineTokens tokens(line);
    std::string_view word;
    if (!tokens.Next(&word) || word == "obj_info") return Status::Ok();
    if (word == "comment") return ParseComment(line, tokens);
    if (word == "end_header") {
      *ended = true;
      return Status::Ok();
    }
    if (word == "format") return ParseFormat(tokens);
    if (word == "element") return ParseElement(tokens);
    if (word == "property") return ParseProperty(tokens);
    return Error("expected element, property or end_header, found " + Quoted(line));
  }

  // "comment TextureFile NAME"; the name may have blanks.
  Status ParseComment(std::string_view line, LineTokens& tokens) {
    std::string_view word, name;
    if (!tokens.Next(&word) || word != "TextureFile" || !tokens.Next(&name)) return Status::Ok();
    if (header_.texture_files.size() == kMaxTextures) {
      return Error("more than " + std::to_string(kMaxTextures) + " comments TextureFile");
    }
    header_.texture_files.emplace_back(line.substr(static_cast<size_t>(name.data() - line.data())));
    return Status::Ok();
  }

  Status ParseFormat(LineTokens& tokens) {
    std::string_view name, version;
    tokens.Next(&name);
    tokens.Next(&version);
    if (name == "ascii") {
      header_.encoding = PlyEncoding::kAscii;
    } else if (name == "binary_little_endian") {
      header_.encoding = PlyEncoding::kBinaryLittleEndian;
    } else if (name == "binary_big_endian") {
      header_.encoding = PlyEncoding::kBinaryBigEndian;
    } else {
      return Error("expected format ascii, binary_little_endian or binary_big_endian, found " +
                   Quoted(name));
    }
    if (version != "1.0") return Error("expected format version 1.0, found " + Quoted(version));
    if (has_format_) return Error("a second format line");
    has_format_ = true;
    return Status::Ok();
  }

  // Names go into messages and into other files.
  Status CheckName(std::string_view name) const {
    constexpr size_t kMaxNameBytes = 255;
    const bool printable = std::none_of(name.begin(), name.end(),
                                        [](char c) { return (c >= 0 && c < ' ') || c == '\x7f'; });
    if (printable && !name.empty() && name.size() <= kMaxNameBytes) return Status::Ok();
    return Error("expected a name of 1 to 255 printable characters, found " + Quoted(name));
  }

  Status ParseElement(LineTokens& tokens) {
    std::string_view name, count;
    tokens.Next(&name);
    MTDB_RETURN_IF_ERROR(CheckName(name));
    if (header_.elements.size() == kMaxElements) return Error("more than 256 elements");
    int64_t value = 0;
    if (!tokens.Next(&count) || !ParseInteger(count, &value) || value < 0) {
      return Error("expected 'element NAME COUNT', found count " + Quoted(count));
    }
    if (header_.Find(std::string(name)) != nullptr) {
      return Error("element " + Quoted(name) + " is declared twice");
    }
    header_.elements.push_back({std::string(name), static_cast<uint64_t>(value), {}});
    return Status::Ok();
  }

  Status ParseType(std::string_view name, ScalarType* type) const {
    const std::optional<ScalarType> found = TypeFromName(name);
    if (!found) {
      return Error(
          "expected a type (char, uchar, short, ushort, int, uint, float, double), found " +
          Quoted(name));
    }
    *type = *found;
    return Status::Ok();
  }

  Status ParseProperty(LineTokens& tokens) {
    if (header_.elements.empty()) return Error("a property before the first element");
    PlyProperty property;
    std::string_view word;
    tokens.Next(&word);
    if (word == "list") {
      property.is_list = true;
      tokens.Next(&word);
      MTDB_RETURN_IF_ERROR(ParseType(word, &property.count_type));
      if (property.count_type >= ScalarType::kFloat32) {
        return Error("expected an integer type for the count of a list, found " + Quoted(word));
      }
      tokens.Next(&word);
    }
    MTDB_RETURN_IF_ERROR(ParseType(word, &property.type));
    tokens.Next(&word);
    MTDB_RETURN_IF_ERROR(CheckName(word));
    property.name = word;
    PlyElement& element = header_.elements.back();
    if (element.properties.size() == kMaxProperties) {
      return Error("more than 4096 properties of an element");
    }
    for (const PlyProperty& other : element.properties) {
      if (other.name == property.name) {
        return Error("property " + Quoted(property.name) + " is declared twice");
      }
    }
    element.properties.push_back(std::move(property));
    return Status::Ok();
  }

  // Every element takes bytes, so no count can be trusted beyond the file's size.
  Status CheckCounts() const {
    uint64_t left = file_.size_bytes() - header_.body_offset;
    for (const PlyElement& element : header_.elements) {
      // ASCII: each value is at least one digit and one separator, but for the file's last.
      const bool ascii = header_.encoding == PlyEncoding::kAscii;
      const uint64_t each = ascii ? 2 * element.properties.size() : element.min_bytes();
      const uint64_t slack = ascii ? 1 : 0;
      if (each == 0) continue;
      if (element.count > (left + slack) / each) {
        return BadInput(file_.path() + ": the header promises " + std::to_string(element.count) +
                        " of element " + element.name + " of at least " + std::to_string(each) +
                        " bytes, but only " + std::to_string(left) +
                        " bytes are left for them; the file is cut short or the header is wrong");
      }
      left -= std::min(left, element.count * each);
    }
    return Status::Ok();
  }

  const InputFile& file_;
  TextReader text_;
  PlyHeader header_;
  bool has_format_ = false;
};

}  // namespace

bool PlyElement::has_list() const {
  return std::any_of(properties.begin(), properties.end(),
                     [](const PlyProperty& p) { return p.is_list; });
}

uint64_t PlyElement::min_bytes() const {
  uint64_t n = 0;
  for (const PlyProperty& p : properties) n += ScalarSize(p.is_list ? p.count_type : p.type);
  return n;
}

const PlyElement* PlyHeader::Find(const std::string& name) const {
  for (const PlyElement& e : elements) {
    if (e.name == name) return &e;
  }
  return nullptr;
}

Result<PlyHeader> ReadPlyHeader(const InputFile& file) { return HeaderParser(file).Parse(); }

}  // namespace mtdb::internal
