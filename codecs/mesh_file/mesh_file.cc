#include "codecs/mesh_file/mesh_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <string_view>

#include "codecs/mesh_file/internal/file_io.h"
#include "codecs/mesh_file/internal/mesh_writer.h"
#include "codecs/mesh_file/internal/readers.h"

namespace mtdb {
namespace {

std::string LowerExtension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

bool StartsWithWord(std::string_view text, std::string_view word) {
  return text.starts_with(word) && (text.size() == word.size() ||
                                    std::isspace(static_cast<unsigned char>(text[word.size()])));
}

constexpr uint64_t kStlHeaderBytes = 84;
constexpr uint64_t kStlTriangleBytes = 50;

// By size, as binary files may begin with "solid" too.
bool HasBinaryStlSize(std::string_view start, uint64_t size_bytes) {
  if (start.size() < kStlHeaderBytes) return false;
  uint32_t triangles = 0;
  std::memcpy(&triangles, start.data() + kStlHeaderBytes - sizeof(triangles), sizeof(triangles));
  return size_bytes == kStlHeaderBytes + kStlTriangleBytes * triangles;
}

bool HasNul(std::string_view text) { return text.find('\0') != std::string_view::npos; }

}  // namespace

Status ReadMeshFile(const std::string& path, MeshSink& sink, MeshReadReport* report) {
  MeshReadReport unused;
  if (report == nullptr) report = &unused;
  *report = {};
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<InputFile> file, InputFile::Open(path));
  std::array<std::byte, 512> bytes;
  MTDB_ASSIGN_OR_RETURN(const size_t size, file->ReadAt(0, bytes));
  if (size == 0) return BadInput(path + ": the file is empty, expected a mesh");
  const std::string_view start = AsString(ByteSpan(bytes).first(size));
  const std::string extension = LowerExtension(path);

  if (extension == ".stl" && HasBinaryStlSize(start, file->size_bytes())) {
    return ReadBinaryStl(*file, sink, report);
  }
  if (StartsWithWord(start, "ply")) return ReadPly(*file, sink, report);
  if (extension == ".obj") return ReadObj(*file, sink, report);
  if (StartsWithOffKeyword(start)) return ReadOff(*file, sink, report);
  if (StartsWithWord(start, "solid") &&
      !(extension == ".stl" && HasNul(start.substr(0, kStlHeaderBytes)))) {
    return ReadAsciiStl(*file, sink, report);
  }
  if (extension == ".ply") return ReadPly(*file, sink, report);
  if (extension == ".stl") return ReadBinaryStl(*file, sink, report);
  if (extension == ".off") return ReadOff(*file, sink, report);
  return BadInput(path + ": not a mesh file that mtdb reads, expected PLY, OBJ, STL or OFF");
}

Result<std::string> MeshFileFormat(const std::string& path) {
  const std::string extension = LowerExtension(path);
  for (const char* const known : {".ply", ".obj", ".stl", ".off", ".glb", ".drc"}) {
    if (extension == known) return extension.substr(1);
  }
  return Unsupported(path + ": expected a name that ends in .ply, .obj, .stl, .off, .glb or .drc");
}

namespace {

Result<std::unique_ptr<MeshWriter>> CreateWriter(const std::string& path,
                                                 const MeshWriteOptions& options) {
  MTDB_ASSIGN_OR_RETURN(const std::string format, MeshFileFormat(path));
  if (format == "ply") return CreatePlyWriter(path);
  if (format == "obj") return CreateObjWriter(path);
  if (format == "stl") return CreateStlWriter(path);
  if (format == "off") return CreateOffWriter(path);
  if (format == "glb") return CreateGltfWriter(path);
  if (options.draco_position_bits < 1 || options.draco_position_bits > 30) {
    return InvalidArgument("draco_position_bits: expected 1 to 30, found " +
                           std::to_string(options.draco_position_bits));
  }
  if (options.draco_level < 0 || options.draco_level > 10) {
    return InvalidArgument("draco_level: expected 0 to 10, found " +
                           std::to_string(options.draco_level));
  }
  return CreateDracoWriter(path, options);
}

}  // namespace

Result<std::unique_ptr<MeshFileWriter>> CreateMeshFileWriter(const std::string& path,
                                                             const MeshWriteOptions& options) {
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<MeshWriter> writer, CreateWriter(path, options));
  if (options.descriptor >= 0) writer->WriteInto(options.descriptor);
  return std::unique_ptr<MeshFileWriter>(std::move(writer));
}

std::string NonFinite(Vec3d p) {
  constexpr const char* kNames[3] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    if (std::isfinite(p[axis])) continue;
    return std::string(kNames[axis]) + " is " +
           (std::isnan(p[axis]) ? "nan"
            : p[axis] > 0       ? "inf"
                                : "-inf") +
           ", expected a finite number";
  }
  return "";
}

void AddIgnored(MeshReadReport* report, std::string what) {
  if (std::find(report->ignored.begin(), report->ignored.end(), what) == report->ignored.end()) {
    report->ignored.push_back(std::move(what));
  }
}

}  // namespace mtdb
