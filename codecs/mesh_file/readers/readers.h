// SPDX-License-Identifier: Apache-2.0
// The reader of each mesh file format, and how it knows its files. ReadMeshFile
// (codecs/mesh_file/mesh_file.h) chooses among them.
#pragma once

#include <string>
#include <string_view>

#include "codecs/mesh_file/input/file_io.h"
#include "codecs/mesh_file/mesh_file.h"
#include "codecs/mesh_file/polygons/left_out_vertices.h"
#include "codecs/mesh_file/readers/mesh_format_table.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

Status ReadPly(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report);
Status ReadObj(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report);
Status ReadOff(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report);
Status ReadDraco(const InputFile& file, MeshSink& sink, MeshReadReport* report);
// Binary or JSON.
Status ReadGltf(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
                MeshReadReport* report);
// Binary or ASCII.
Status ReadStl(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report);
bool IsAsciiStl(const MeshFileStart& start);
Status ReadBinaryStl(const InputFile& file, MeshSink& sink, MeshReadReport* report);
Status ReadAsciiStl(const InputFile& file, MeshSink& sink, MeshReadReport* report);

// In a binary STL's header, before the origin that its positions are offsets from.
inline constexpr const char* kStlOriginWord = ", origin";

// "ply" and white space.
MeshFileFit RecognisePly(const MeshFileStart& start);
// Any text whose name says so.
MeshFileFit RecogniseObj(const MeshFileStart& start);
// OFF, COFF, NOFF, CNOFF, ... and white space, '#' or a count; or the name says so.
MeshFileFit RecogniseOff(const MeshFileStart& start);
// "solid", in letters of any size, and white space, maybe behind some; or the size that the header
// promises, as binary files may begin with "solid" too.
MeshFileFit RecogniseStl(const MeshFileStart& start);
// "DRACO".
MeshFileFit RecogniseDraco(const MeshFileStart& start);
// "glTF".
MeshFileFit RecogniseGltf(const MeshFileStart& start);
// An object of JSON whose name says so.
MeshFileFit RecogniseGltfJson(const MeshFileStart& start);
// True when `text` begins with the word, and white space or nothing behind it.
bool StartsWithWord(std::string_view text, std::string_view word);

// "y is nan, expected a finite number" for the first coordinate of `p` that is none
// (coordinate_limit.h); "" when all are.
std::string CoordinateFault(Vec3d p);

// Of a file whose vertices have all been left out: the first one's fault.
Status NoVertexLeft(const std::string& path, const LeftOutVertices& left_out);
// A face's corner is a vertex that was left out.
Status LeftOutError(const std::string& path, const LeftOutVertices& left_out, VertexIndex vertex,
                    const std::string& face);

// Adds a line to report->ignored unless it is there.
void AddIgnored(MeshReadReport* report, std::string what);
// The line of MeshEmitter::wrong_corners().
void AddWrongCorners(uint64_t triangles, MeshReadReport* report);

}  // namespace mtdb::internal
