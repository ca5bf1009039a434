// SPDX-License-Identifier: Apache-2.0
// Mesh files: their formats, readers and writers.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

// A format of mesh files, as programs that offer it need to know it.
struct MeshFormat {
  std::string_view name;  // "PLY"
  // The suffixes of its files, in small letters and without the dot. Programs ask for the format by
  // the first one.
  std::vector<std::string_view> suffixes;
  std::string_view content_type = "application/octet-stream";  // in HTTP
  bool exact = false;       // its writer keeps positions as they are, in double where they need it
  bool keeps_mesh = false;  // its writer keeps the whole mesh in memory
};
// The formats that ReadMeshFile reads, and those that CreateMeshFileWriter writes, in the order in
// which programs list them.
std::vector<MeshFormat> ReadMeshFormats();
std::vector<MeshFormat> WrittenMeshFormats();
// The suffixes of `formats`, for help: ".ply .obj .stl".
std::string SuffixesOf(const std::vector<MeshFormat>& formats);
// The format that is read whose files have this suffix: "ply", "stl". kUnsupported when there is
// none.
Result<MeshFormat> FindReadMeshFormat(std::string_view suffix);
// The written format that programs ask for by `suffix`: "ply", "glb". kUnsupported when there is
// none: "expected ply, obj or stl, found 'x'".
Result<MeshFormat> FindWrittenMeshFormat(std::string_view suffix);
// The format in which CreateMeshFileWriter writes a file of this name, by its suffix, in capital or
// small letters. kUnsupported when there is none.
Result<MeshFormat> WrittenMeshFormatOf(const std::string& path);

// What a reader found in the file besides vertices and triangles.
struct MeshReadReport {
  std::string format;     // "PLY binary little endian", "STL ASCII", ...
  uint64_t polygons = 0;  // faces of more than three corners, split into triangles
  uint64_t fans = 0;      // of these, those that were not split inside of their outline, but round
                          // their first corner: it crosses itself, or has more than 2^18 corners
  uint64_t strips = 0;    // tristrips split
  uint64_t short_faces = 0;        // faces of fewer than three corners, dropped
  uint64_t left_out_vertices = 0;  // that no face uses, with coordinates that are no finite numbers
  std::vector<std::string> notes;  // sentences about how the file was understood
  std::vector<std::string> ignored;  // elements and properties that mtdb does not carry
};

struct MeshReadOptions {
  // The descriptor of an open file, or of a pipe, that is read from where it stands; the path then
  // only names it in messages. It stays open.
  int descriptor = -1;
  // The format's suffix ("stl"), where neither the file's name nor its content tells it; empty:
  // that of the name.
  std::string suffix;
  // The folder of nameless temporary files: what a pipe, or a file compressed by gzip, is copied
  // to, since readers go back and forth, and positions that polygons of texts need; empty: the
  // system's.
  std::string tmp_directory;
  // The most that this copy takes; more is kBudgetExceeded.
  uint64_t max_tmp_bytes = ~uint64_t{0};
  // Called before each read of the input, while it is opened and later, and some times a second
  // while a pipe delivers nothing. An error ends the reading and is returned.
  std::function<Status()> look;
};

// A mesh file that is open, and may be read any number of times. Files compressed by gzip are
// decompressed when they are opened; ".gz" is no part of their suffix.
class MeshInput {
 public:
  // kNotFound, kIoError, kNoSpace and kBudgetExceeded (temporary files), kBadInput (damaged gzip;
  // of what is copied, a first mebibyte that no mesh begins with, and more than a header promises).
  static Result<MeshInput> Open(const std::string& path, const MeshReadOptions& options = {});
  MeshInput(MeshInput&&) noexcept;
  MeshInput& operator=(MeshInput&&) noexcept;
  ~MeshInput();

  // Pushes the mesh into `sink` in blocks. The content tells the format where it begins with a
  // magic word, else the suffix does. Memory does not grow with the file, except for STL, whose
  // vertices are joined by exact position, for the vertex table of OBJ faces, and for what
  // codecs/mesh_file/README.md says of compressed formats. A file with texture coordinates gives a
  // textured mesh; its images are read when Texture::load is called, also when the input is closed.
  // Errors: kIoError, and kBadInput with
  // file, element number or line, what was expected and what was found; among them: coordinates
  // that are not finite of vertices that faces use, vertex indices out of range, a count that the
  // file is too short for, no vertices.
  Status Read(MeshSink& sink, MeshReadReport* report) const;
  const std::string& path() const;
  uint64_t temporary_bytes() const;  // of the copy; 0: there is none

 private:
  struct Impl;
  explicit MeshInput(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Reads the file at `path` once: MeshInput::Open() and Read().
Status ReadMeshFile(const std::string& path, MeshSink& sink, MeshReadReport* report);

// Whether ReadMeshFile would read the file: it begins as the files of some format do, or is named
// like one; or it is compressed by gzip. False for a file that cannot be opened.
bool IsMeshFile(const std::string& path);

struct MeshWriteOptions {
  int draco_position_bits = 20;  // .drc
  int draco_level = 7;           // .drc: 0 fast .. 10 small
  // The descriptor of an open, empty file: the mesh is written to it. `path` names it in messages,
  // without the suffix. The file stays open; it has no mesh in it unless End() succeeded.
  int descriptor = -1;
  // .off: normals too, where the mesh has some; many programs know only OFF and COFF.
  bool off_normals = false;
  // .ply: positions as float64, also where float32 is enough. Formats that are not exact refuse it:
  // kInvalidArgument.
  bool double_positions = false;
  // .glb: z is up in the mesh, and becomes y, which is up in glTF, at the file's node; which also
  // makes metres of the units of x, y and z, and puts `metres_from` at 0.
  struct UpFrame {
    Vec3d metres{1, 1, 1};
    Vec3d metres_from;
  };
  std::optional<UpFrame> up_frame;
};

// What a file has of the mesh that was given to its writer.
struct MeshWriteReport {
  std::string positions;  // "float32", "float64", "decimal" or "quantised"
  // Positions in the file are offsets from here, and who reads them has to add it: in the header of
  // .stl, which only mtdb reads, and the metadata of .drc.
  std::optional<Vec3d> origin;
  // Positions in a .glb file are offsets from here, which its node adds: nobody else has to.
  std::optional<Vec3d> node_origin;
  // Attributes that the file does not have: "red, green, blue (float32)".
  std::vector<std::string> not_written;
  // What else was changed on the way: "colours of uint16 are rounded to 8 bits".
  std::vector<std::string> notes;
};

// A sink that writes a file. The file appears under its name only when End() succeeds, so that a
// failed run leaves nothing half done. codecs/mesh_file/README.md says what each format carries.
// Writers stream, except that STL keeps 12 bytes a vertex, and formats with keeps_mesh, and .glb of
// a textured mesh, the whole mesh.
//
// PLY and OBJ have the images of a textured mesh in files beside theirs, and OBJ an MTL file. They
// appear just before the mesh does; those that were not there before disappear again when it fails.
// An image that cannot be loaded is an error of End(). Into a descriptor, there are none of them.
//
// Formats that are not exact store positions as float32; rounding() says how far that moved them.
// When a mesh is far from 0 for its size, they store offsets from an origin: the node's translation
// in glTF, the metadata "origin" in Draco, and the header in STL ("binary STL by mtdb, origin X Y
// Z"), which ReadMeshFile adds again. PLY has float32 where that moves no coordinate by more than
// an eighth of the step of the grid that positions lie on (MeshHeader::position_step).
//
// kInvalidArgument when an attribute has a name that none may have (store/base/attribute_layout.h).
class MeshFileWriter : public MeshSink {
 public:
  virtual uint64_t bytes_written() const = 0;  // after End()
  virtual MeshWriteReport report() const = 0;  // after End()
};
// The format is that of the suffix of `path`; kUnsupported when no format has it.
Result<std::unique_ptr<MeshFileWriter>> CreateMeshFileWriter(const std::string& path,
                                                             const MeshWriteOptions& options = {});

}  // namespace mtdb
