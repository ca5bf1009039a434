// SPDX-License-Identifier: Apache-2.0
// How a mesh file is written of an object, and what is told of it: the same by every verb, and by
// the server.
#pragma once

#include <string>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/json.h"
#include "store/object_record.h"

namespace mtdb {

// A terrain has z up, which a .glb's node turns, and in degrees makes local metres of. `normals`
// were asked for.
MeshWriteOptions MeshOptionsOf(const ObjectRecord& record, bool normals);

// "positions", "origin", "node_origin", "not_written", "notes" (docs/json.md).
Json MeshFileJson(const MeshWriteReport& report);
// That of a text of somebody else; empty where it is none.
MeshWriteReport ParseMeshFile(const std::string& text);
// Lines for people, two spaces in front of each: what is to be known of the file besides its mesh.
std::string MeshFileText(const MeshWriteReport& report);

}  // namespace mtdb
