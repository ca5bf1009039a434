// SPDX-License-Identifier: Apache-2.0
// The table of mesh formats. A new format is a reader or a writer and one row: suffixes, content
// types, help, messages and what a server offers all come from here.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "codecs/mesh_file/input/file_io.h"
#include "codecs/mesh_file/mesh_file.h"
#include "codecs/mesh_file/polygons/vertex_positions.h"
#include "codecs/mesh_file/writers/mesh_writer.h"

namespace mtdb::internal {

// How a file begins, and whether its name has one of the format's suffixes.
struct MeshFileStart {
  std::string_view bytes;  // 512, or as many as there are
  std::string_view text;   // these, without a byte order mark
  uint64_t file_bytes = 0;
  bool named = false;
  ReaderSpace tmp;  // for temporary files of a reader
};
// How well a file fits a format. The best one reads it, of equals the first of the table.
enum class MeshFileFit {
  kNone,
  kName,     // it has the suffix, and nothing speaks against it
  kContent,  // it begins as such files do
  kCertain,  // its size agrees too
};

struct MeshFormatRow {
  MeshFormat format;
  // Both, or neither for a format that is not read.
  MeshFileFit (*recognise)(const MeshFileStart& start) = nullptr;
  Status (*read)(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
                 MeshReadReport* report) = nullptr;
  // None for a format that is not written.
  Result<std::unique_ptr<MeshWriter>> (*create_writer)(const std::string& path,
                                                       const MeshWriteOptions& options) = nullptr;
};

// The formats of this folder.
std::vector<MeshFormatRow> OwnMeshFormats();

// The table in use. It is OwnMeshFormats(), and has a file to itself, so that a program may be
// linked with another table.
const std::vector<MeshFormatRow>& MeshFormatTable();

}  // namespace mtdb::internal
