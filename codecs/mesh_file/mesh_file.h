// Mesh files: their formats, readers and writers.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

// A format of mesh files, as whoever offers it to others wants to know it.
struct MeshFormat {
  std::string_view name;  // "PLY"
  // Of files, in small letters and without the dot. Programs ask for the format by the first one.
  std::vector<std::string_view> suffixes;
  std::string_view content_type = "application/octet-stream";  // in HTTP
  bool exact = false;       // positions are written as they are, in double where they need it
  bool keeps_mesh = false;  // its writer keeps the whole mesh in memory
};
// In the order in which they are offered: those that ReadMeshFile reads, and those that
// CreateMeshFileWriter writes.
std::vector<MeshFormat> ReadMeshFormats();
std::vector<MeshFormat> WrittenMeshFormats();
// Their suffixes, for help: ".ply .obj .stl".
std::string SuffixesOf(const std::vector<MeshFormat>& formats);
// The format that programs ask for by that name, "ply" or "glb", and writes. kUnsupported for
// others: "expected ply, obj or stl, found 'x'".
Result<MeshFormat> FindWrittenMeshFormat(std::string_view suffix);
// The format that is written to a file of that name, by its suffix in whatever letters.
// kUnsupported for others.
Result<MeshFormat> WrittenMeshFormatOf(const std::string& path);

// What a reader met beside vertices and triangles.
struct MeshReadReport {
  std::string format;                // "PLY binary little endian", "STL ASCII", ...
  uint64_t polygons = 0;             // faces of more than three corners, split into fans
  uint64_t strips = 0;               // tristrips split
  uint64_t short_faces = 0;          // faces of fewer than three corners, dropped
  std::vector<std::string> ignored;  // elements and properties that mtdb does not carry
};

// Reads the file at `path` (by its content where it has a magic word, else by its suffix) and
// pushes it into `sink` in blocks. Memory: blocks, but for STL, whose vertices are joined by exact
// position, and the vertex table of OBJ faces. Errors: kNotFound, kIoError, and kBadInput with
// file, element number or line, what was expected and what was found; among them: non-finite
// coordinates, vertex indices out of range, a count that the file is too short for, no vertices.
Status ReadMeshFile(const std::string& path, MeshSink& sink, MeshReadReport* report);

// A sink that writes a file. The file appears under its name only when End() succeeded (it is
// written beside it and renamed), so that a failed run leaves nothing half done.
struct MeshWriteOptions {
  int draco_position_bits = 20;  // .drc
  int draco_level = 7;           // .drc: 0 fast .. 10 small
  // An open, empty file, which the mesh is written to instead of `path`, which then is no more than
  // a name for messages. It stays open, and has no mesh in it when End() did not succeed.
  int descriptor = -1;
};

// By the suffix of `path`; kUnsupported when no format has it. What each format carries is in
// codecs/mesh_file/README.md. They stream, but for STL, which keeps 12 bytes a vertex, and those
// that keep the mesh. bytes_written() is valid after End().
//
// Positions: formats that are not exact have float32; rounding() says what that moved, and meshes
// that are far from 0 for their size are written as offsets from an origin: the node's translation
// in glTF, the metadata "origin" in Draco, and the header in STL ("binary STL by mtdb, origin X Y
// Z"), which ReadMeshFile adds again.
class MeshFileWriter : public MeshSink {
 public:
  virtual uint64_t bytes_written() const = 0;
  // What the positions of a format that is not exact are offsets from, where float32 alone would
  // lose too much. After Begin.
  virtual std::optional<Vec3d> origin() const = 0;
};
Result<std::unique_ptr<MeshFileWriter>> CreateMeshFileWriter(const std::string& path,
                                                             const MeshWriteOptions& options = {});

}  // namespace mtdb
