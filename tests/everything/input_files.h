// SPDX-License-Identifier: Apache-2.0
// Mesh files written in the plainest way: what a walk's inputs are made of. Shares nothing with
// mtdb's own writers.
#pragma once

#include <string>
#include <vector>

#include "store/base/mesh_sink.h"
#include "tests/everything/polygons.h"

namespace mtdb::everything {

struct FileFormat {
  const char* name;       // in walks
  const char* extension;  // with its dot
  bool soup;              // triangles have no shared vertices
  bool floats_only;       // whatever the mesh has
  bool is_text;
  bool typed;  // says whether positions are doubles
  // Leaves in `layout` what the format carries.
  void (*carry)(AttributeLayout* layout);
  std::string (*text)(const TriangleMesh& mesh, const Faces& faces);
};
const std::vector<FileFormat>& FileFormats();
// The first one when there is none of that name.
const FileFormat& FormatOf(const std::string& name);

// How a file is written that says the same.
struct TextDress {
  bool polygons = false;         // where the format has them (JoinedFaces)
  bool byte_order_mark = false;  // of texts
  std::string line_end = "\n";
};

// Writes the mesh and makes of it what the file says: floats, fewer attributes.
void WriteInputFile(const FileFormat& format, const std::string& path, const TextDress& dress,
                    TriangleMesh* mesh);

}  // namespace mtdb::everything
