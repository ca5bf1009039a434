// Mesh files: readers and writers of PLY, OBJ, STL, OFF and (writing only) binary glTF and Draco.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

// What a reader met beside vertices and triangles.
struct MeshReadReport {
  std::string format;                // "PLY binary little endian", "STL ASCII", ...
  uint64_t polygons = 0;             // faces of more than three corners, split into fans
  uint64_t strips = 0;               // tristrips split
  uint64_t short_faces = 0;          // faces of fewer than three corners, dropped
  std::vector<std::string> ignored;  // elements and properties that mtdb does not carry
};

// Reads the file at `path` (by its content where it has a magic word, else by its extension) and
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

// By the extension of `path`: .ply (binary little endian; attributes), .obj, .stl (binary), .off,
// .glb (attributes; see codecs/README.md), .drc. kUnsupported for others. PLY, OBJ, OFF and .glb
// stream; STL keeps 12 bytes a vertex and .drc the whole mesh. bytes_written() is valid after
// End().
//
// Positions: PLY, OBJ and OFF keep them as they are, in double where they need it. The others have
// float32: rounding() says what that moved, and meshes that are far from 0 for their size are
// written as offsets from an origin: the node's translation in .glb, the metadata "origin" in .drc,
// and the header in STL ("binary STL by mtdb, origin X Y Z"), which ReadMeshFile adds again.
class MeshFileWriter : public MeshSink {
 public:
  virtual uint64_t bytes_written() const = 0;
  // STL, .glb and .drc: what their float32 positions are offsets from, where float32 alone would
  // lose too much. After Begin.
  virtual std::optional<Vec3d> origin() const = 0;
};
// "ply", "obj", "stl", "off", "glb" or "drc", by the extension, in whatever letters; kUnsupported
// for others.
Result<std::string> MeshFileFormat(const std::string& path);
Result<std::unique_ptr<MeshFileWriter>> CreateMeshFileWriter(const std::string& path,
                                                             const MeshWriteOptions& options = {});

}  // namespace mtdb
