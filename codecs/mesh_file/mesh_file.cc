// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/mesh_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string_view>

#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/internal/open_input.h"
#include "codecs/mesh_file/internal/stream_start.h"
#include "codecs/mesh_file/readers/mesh_format_table.h"
#include "codecs/mesh_file/readers/readers.h"
#include "store/base/coordinate_limit.h"
#include "store/base/file_kind.h"

namespace mtdb {

using namespace internal;

namespace {

// "ply" of "a/b.PLY" and of "a/b.ply.gz".
std::string LowerSuffix(const std::string& path) {
  std::filesystem::path name(path);
  if (name.extension() == ".gz") name.replace_extension();
  std::string suffix = name.extension().string();
  if (!suffix.empty()) suffix.erase(0, 1);
  for (char& c : suffix) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return suffix;
}

// "a, b or c", of what is put before a text of each format.
template <typename TextOf>
std::string OneOf(const std::vector<MeshFormat>& formats, TextOf&& text_of) {
  std::string list;
  for (size_t i = 0; i < formats.size(); ++i) {
    if (i > 0) list += i + 1 < formats.size() ? ", " : " or ";
    list += text_of(formats[i]);
  }
  return list;
}
std::string Dotted(const MeshFormat& format) { return "." + std::string(format.suffixes[0]); }

bool HasSuffix(const MeshFormat& format, std::string_view suffix) {
  return std::ranges::find(format.suffixes, suffix) != format.suffixes.end();
}

template <typename Want>
std::vector<MeshFormat> FormatsThat(Want&& want) {
  std::vector<MeshFormat> formats;
  for (const MeshFormatRow& row : MeshFormatTable()) {
    if (want(row)) formats.push_back(row.format);
  }
  return formats;
}

// Null when no format that is written has the suffix.
const MeshFormatRow* RowOfWritten(std::string_view suffix) {
  for (const MeshFormatRow& row : MeshFormatTable()) {
    if (row.create_writer != nullptr && HasSuffix(row.format, suffix)) return &row;
  }
  return nullptr;
}
Result<const MeshFormatRow*> RowOfFile(const std::string& path) {
  const MeshFormatRow* const row = RowOfWritten(LowerSuffix(path));
  if (row != nullptr) return row;
  return Unsupported(path + ": expected a name that ends in " +
                     OneOf(WrittenMeshFormats(), Dotted));
}

}  // namespace

std::vector<MeshFormat> ReadMeshFormats() {
  return FormatsThat([](const MeshFormatRow& row) { return row.read != nullptr; });
}

std::vector<MeshFormat> WrittenMeshFormats() {
  return FormatsThat([](const MeshFormatRow& row) { return row.create_writer != nullptr; });
}

std::string SuffixesOf(const std::vector<MeshFormat>& formats) {
  std::string list;
  for (const MeshFormat& format : formats) {
    for (const std::string_view suffix : format.suffixes) {
      list += (list.empty() ? "." : " .") + std::string(suffix);
    }
  }
  return list;
}

namespace {

Status NoFormat(const std::vector<MeshFormat>& formats, std::string_view suffix) {
  return Unsupported(
      "expected " + OneOf(formats, [](const MeshFormat& f) { return std::string(f.suffixes[0]); }) +
      ", found '" + std::string(suffix) + "'");
}

}  // namespace

Result<MeshFormat> FindReadMeshFormat(std::string_view suffix) {
  for (const MeshFormat& format : ReadMeshFormats()) {
    if (HasSuffix(format, suffix)) return format;
  }
  return NoFormat(ReadMeshFormats(), suffix);
}

Result<MeshFormat> FindWrittenMeshFormat(std::string_view suffix) {
  for (const MeshFormat& format : WrittenMeshFormats()) {
    if (format.suffixes[0] == suffix) return format;
  }
  return NoFormat(WrittenMeshFormats(), suffix);
}

Result<MeshFormat> WrittenMeshFormatOf(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const MeshFormatRow* const row, RowOfFile(path));
  return row->format;
}

std::string internal::ExactSuffixes() {
  return OneOf(
      FormatsThat([](const MeshFormatRow& row) { return row.create_writer && row.format.exact; }),
      Dotted);
}

namespace {

// The format that fits the file best, and how the file begins.
struct FoundFormat {
  const MeshFormatRow* row = nullptr;  // null: none
  MeshFileFit fit = MeshFileFit::kNone;
  MeshFileStart start;
  std::array<std::byte, 512> bytes;
};

Status FindFormat(const InputFile& file, const std::string& suffix, FoundFormat* found) {
  MTDB_ASSIGN_OR_RETURN(const size_t size, file.ReadAt(0, found->bytes));
  if (size == 0) return BadInput(file.path() + ": the file is empty, expected a mesh");
  found->start.bytes = AsString(ByteSpan(found->bytes).first(size));
  found->start.text = found->start.bytes.substr(ByteOrderMarkBytes(found->start.bytes));
  found->start.file_bytes = file.size_bytes();
  for (const MeshFormatRow& row : MeshFormatTable()) {
    if (row.read == nullptr) continue;
    found->start.named = HasSuffix(row.format, suffix);
    const MeshFileFit fit = row.recognise(found->start);
    if (fit <= found->fit) continue;
    found->row = &row;
    found->fit = fit;
  }
  found->start.named = found->row != nullptr && HasSuffix(found->row->format, suffix);
  return Status::Ok();
}

}  // namespace

bool IsMeshFile(const std::string& path) {
  const Result<std::unique_ptr<InputFile>> file = InputFile::Open(path);
  FoundFormat found;
  if (!file.ok() || !FindFormat(**file, LowerSuffix(path), &found).ok()) return false;
  return found.row != nullptr || IsGzip(found.start.bytes);
}

namespace {

Status NoMeshFile(const std::string& path, std::string_view start) {
  const std::string_view kind = KindOfFile(start);
  return BadInput(
      path + ": not a mesh file that mtdb reads, expected " +
      OneOf(ReadMeshFormats(), [](const MeshFormat& f) { return std::string(f.name); }) +
      (kind.empty() ? "" : "; it seems to be " + std::string(kind)));
}

}  // namespace

struct MeshInput::Impl {
  std::unique_ptr<InputFile> file;
  std::string suffix;
  ReaderSpace tmp;
  uint64_t temporary_bytes = 0;
};

MeshInput::MeshInput(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MeshInput::MeshInput(MeshInput&&) noexcept = default;
MeshInput& MeshInput::operator=(MeshInput&&) noexcept = default;
MeshInput::~MeshInput() = default;

Result<MeshInput> MeshInput::Open(const std::string& path, const MeshReadOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->suffix = options.suffix.empty() ? LowerSuffix(path) : options.suffix;
  InputRules rules{options.tmp_directory, options.max_tmp_bytes, options.look, {}};
  rules.check_start = [&](const InputFile& start) -> Result<StreamFacts> {
    FoundFormat found;
    MTDB_RETURN_IF_ERROR(FindFormat(start, impl->suffix, &found));
    if (found.row == nullptr) return NoMeshFile(path, found.start.bytes);
    return CheckStreamStart(start, found.row, found.start);
  };
  MTDB_ASSIGN_OR_RETURN(impl->file,
                        OpenInputFile(path, options.descriptor, rules, &impl->temporary_bytes));
  const uint64_t most = options.max_tmp_bytes;
  impl->tmp = {options.tmp_directory, most - std::min(most, impl->temporary_bytes)};
  return MeshInput(std::move(impl));
}

uint64_t MeshInput::temporary_bytes() const { return impl_->temporary_bytes; }
const std::string& MeshInput::path() const { return impl_->file->path(); }

Status MeshInput::Read(MeshSink& sink, MeshReadReport* report) const {
  MeshReadReport unused;
  if (report == nullptr) report = &unused;
  *report = {};
  FoundFormat found;
  MTDB_RETURN_IF_ERROR(FindFormat(*impl_->file, impl_->suffix, &found));
  found.start.tmp = impl_->tmp;
  if (found.fit < MeshFileFit::kCertain && IsWideText(found.start.bytes)) {
    return WideTextError(path());
  }
  if (found.row == nullptr) {
    return NoMeshFile(path(), found.start.bytes);
  }
  return found.row->read(*impl_->file, found.start, sink, report);
}

Status ReadMeshFile(const std::string& path, MeshSink& sink, MeshReadReport* report) {
  MTDB_ASSIGN_OR_RETURN(const MeshInput input, MeshInput::Open(path));
  return input.Read(sink, report);
}

Result<std::unique_ptr<MeshFileWriter>> CreateMeshFileWriter(const std::string& path,
                                                             const MeshWriteOptions& options) {
  MTDB_ASSIGN_OR_RETURN(const MeshFormatRow* const row, RowOfFile(path));
  if (options.double_positions && !row->format.exact) {
    return InvalidArgument(path + ": " + std::string(row->format.name) +
                           " has no positions of float64; write " + internal::ExactSuffixes());
  }
  const size_t named = options.descriptor >= 0 ? path.rfind('.') : path.size();
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<MeshWriter> writer,
                        row->create_writer(path.substr(0, named), options));
  if (options.descriptor >= 0) writer->WriteInto(options.descriptor);
  return std::unique_ptr<MeshFileWriter>(std::move(writer));
}

bool internal::StartsWithWord(std::string_view text, std::string_view word) {
  return text.starts_with(word) && (text.size() == word.size() ||
                                    std::isspace(static_cast<unsigned char>(text[word.size()])));
}

std::string internal::CoordinateFault(Vec3d p) {
  constexpr const char* kNames[3] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    if (IsCoordinate(p[axis])) continue;
    char value[32];
    std::snprintf(value, sizeof(value), "%.9g", std::isnan(p[axis]) ? std::abs(p[axis]) : p[axis]);
    return std::string(kNames[axis]) + " is " + value + ", expected a " +
           (std::isfinite(p[axis]) ? "number from -1e30 to 1e30" : "finite number");
  }
  return "";
}

Status internal::NoVertexLeft(const std::string& path, const LeftOutVertices& left_out) {
  return BadInput(path + ": " + left_out.first_fault() + ", and no vertex of the file is better");
}

Status internal::LeftOutError(const std::string& path, const LeftOutVertices& left_out,
                              VertexIndex vertex, const std::string& face) {
  return BadInput(path + ": " + left_out.FaultOf(vertex) + "; " + face + " uses this vertex");
}

void internal::AddIgnored(MeshReadReport* report, std::string what) {
  constexpr size_t kMost = 64;  // a hostile file has a million
  std::vector<std::string>& all = report->ignored;
  constexpr size_t kLongest = 400;
  if (what.size() > kLongest) {
    what.resize(kLongest);
    while (!what.empty() && (static_cast<unsigned char>(what.back()) & 0x80) != 0) what.pop_back();
    what += " ...";
  }
  std::ranges::replace_if(
      what, [](unsigned char c) { return c < ' ' || c == 0x7f; }, '?');
  if (all.size() > kMost || std::find(all.begin(), all.end(), what) != all.end()) return;
  all.push_back(all.size() == kMost ? "others" : std::move(what));
}

void internal::AddWrongCorners(uint64_t triangles, MeshReadReport* report) {
  if (triangles == 0) return;
  AddIgnored(report, "wrong texture coordinates of " + std::to_string(triangles) +
                         (triangles == 1 ? " triangle" : " triangles"));
}

}  // namespace mtdb
