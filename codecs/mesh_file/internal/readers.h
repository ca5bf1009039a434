// The reader of each mesh file format. ReadMeshFile (codecs/mesh_file/mesh_file.h) chooses among
// them.
#pragma once

#include <string>
#include <string_view>

#include "codecs/mesh_file/internal/file_io.h"
#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"

namespace mtdb {

Status ReadPly(const InputFile& file, MeshSink& sink, MeshReadReport* report);
Status ReadObj(const InputFile& file, MeshSink& sink, MeshReadReport* report);
Status ReadOff(const InputFile& file, MeshSink& sink, MeshReadReport* report);
Status ReadBinaryStl(const InputFile& file, MeshSink& sink, MeshReadReport* report);
Status ReadAsciiStl(const InputFile& file, MeshSink& sink, MeshReadReport* report);

// In a binary STL's header, before the origin that its positions are offsets from.
inline constexpr const char* kStlOriginWord = ", origin";

// Whether a file that starts so is OFF: OFF, COFF, NOFF, CNOFF, ... and white space or '#'.
bool StartsWithOffKeyword(std::string_view start);

// "y is nan, expected a finite number" for the first coordinate of `p` that is not finite; "" when
// all are.
std::string NonFinite(Vec3d p);

// Adds a line to report->ignored unless it is there.
void AddIgnored(MeshReadReport* report, std::string what);

}  // namespace mtdb
