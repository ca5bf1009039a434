// SPDX-License-Identifier: Apache-2.0
// Meshes that mtdb has written, in every format that it writes, read back.
#pragma once

#include <string>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb::everything {

struct OutputFormat {
  const char* extension;  // without its dot
  bool rows;              // has the attributes as stored
  bool order;             // vertices that triangles share
  bool lossy;             // positions are rounded as the format likes
};
inline constexpr OutputFormat kOutputFormats[] = {
    {"ply", true, true, false},  {"obj", false, true, false}, {"off", false, true, false},
    {"stl", false, false, true}, {"glb", false, true, true},  {"drc", false, true, true},
};
// The first one when there is none of that name.
const OutputFormat& OutputFormatOf(const std::string& extension);

// What the format calls an attribute of an object with these attributes.
std::string CarriedName(const std::string& format, const AttributeLayout& stored,
                        const std::string& attribute);

// Whether a row of such a file says what a row of the object does: normals of length 1, in few
// bits; colours as bytes, or as light; in .glb numbers as float32, 0 where they are not finite; all
// else as it is.
bool CarriedRowMatches(const std::string& format, const AttributeLayout& carried,
                       const std::byte* row, const AttributeLayout& stored,
                       const std::byte* stored_row);

// .glb and .drc too have rows then, of what they carry, by the names above.
Status ReadOutput(const std::string& path, TriangleMesh* mesh);

}  // namespace mtdb::everything
