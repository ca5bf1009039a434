// SPDX-License-Identifier: Apache-2.0
// Draco: the whole file and the decoded mesh in memory.
#include <cmath>
#include <cstring>
#include <limits>

#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/polygons/scalar_row.h"
#include "codecs/mesh_file/readers/draco_mesh.h"
#include "codecs/mesh_file/readers/readers.h"
#include "store/base/attribute_layout.h"

namespace mtdb::internal {

namespace {

struct Column {
  int attribute = 0;
  int components = 0;
};

// What is read of a mesh.
struct Contents {
  int positions = -1;  // their attribute; -1: there is none
  MeshHeader header;
  std::vector<Column> columns;
};
Contents ContentsOf(const DracoMesh& mesh, MeshReadReport* report) {
  Contents contents;
  int& positions = contents.positions;
  MeshHeader& header = contents.header;
  std::vector<Column>& columns = contents.columns;
  for (const DracoAttribute& a : mesh.attributes()) {
    const auto add = [&](std::initializer_list<const char*> names, ScalarType type) {
      columns.push_back({a.index, static_cast<int>(names.size())});
      for (const char* name : names) header.attributes.attributes.push_back({name, type});
    };
    const bool first = std::none_of(columns.begin(), columns.end(), [&](const Column& c) {
      return mesh.attributes()[static_cast<size_t>(c.attribute)].kind == a.kind;
    });
    if (a.kind == DracoKind::kPosition && a.components == 3 && positions < 0) {
      positions = a.index;
      header.double_positions = a.type == ScalarType::kFloat64;
    } else if (a.kind == DracoKind::kNormal && a.components == 3 && first) {
      add({"nx", "ny", "nz"}, ScalarType::kFloat32);
    } else if (a.kind == DracoKind::kColour && a.type == ScalarType::kUint8 && first &&
               a.components == 3) {
      add({"red", "green", "blue"}, ScalarType::kUint8);
    } else if (a.kind == DracoKind::kColour && a.type == ScalarType::kUint8 && first &&
               a.components == 4) {
      add({"red", "green", "blue", "alpha"}, ScalarType::kUint8);
    } else if (a.kind == DracoKind::kGeneric && a.components == 1 && !a.name.empty()) {
      const std::string usable = UsableAttributeName(a.name, header.attributes);
      if (usable != a.name) AddIgnored(report, "the name of an attribute, which is " + usable);
      columns.push_back({a.index, 1});
      header.attributes.attributes.push_back({usable, a.type});
    } else {
      AddIgnored(report, std::to_string(mesh.points()) + (a.kind == DracoKind::kTexture
                                                              ? " texture coordinates"
                                                              : " values of a Draco attribute"));
    }
  }
  return contents;
}

}  // namespace

MeshFileFit RecogniseDraco(const MeshFileStart& start) {
  return start.bytes.starts_with("DRACO") ? MeshFileFit::kContent : MeshFileFit::kNone;
}

Status ReadDraco(const InputFile& file, MeshSink& sink, MeshReadReport* report) {
  report->format = "Draco";
  Bytes bytes(file.size_bytes());
  MTDB_ASSIGN_OR_RETURN(const size_t size, file.ReadAt(0, bytes));
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<DracoMesh> mesh,
                        DracoMesh::Decode(ByteSpan(bytes).first(size), file.path()));
  bytes = Bytes();
  Contents contents = ContentsOf(*mesh, report);
  const int positions = contents.positions;
  MeshHeader& header = contents.header;
  if (positions < 0) return BadInput(file.path() + ": Draco: the mesh has no positions");
  const Vec3d origin = mesh->origin();
  header.double_positions |= origin != Vec3d{};
  header.vertex_count = mesh->points();
  header.triangle_count = mesh->triangles();
  MeshEmitter emitter(sink);
  MTDB_RETURN_IF_ERROR(emitter.Begin(header));
  Bytes row(header.attributes.row_bytes());
  for (uint32_t v = 0; v < mesh->points(); ++v) {
    const std::array<double, 4> p = mesh->Value(positions, v);
    const Vec3d position{p[0], p[1], p[2]};
    if (const std::string problem = CoordinateFault(position); !problem.empty()) {
      return BadInput(file.path() + ": vertex " + std::to_string(v) + ": " + problem);
    }
    std::byte* at = row.data();
    size_t attribute = 0;
    for (const Column& c : contents.columns) {
      const std::array<double, 4> value = mesh->Value(c.attribute, v);
      for (int i = 0; i < c.components; ++i) {
        at = PutScalar(value[static_cast<size_t>(i)],
                       header.attributes.attributes[attribute++].type, at);
      }
    }
    MTDB_RETURN_IF_ERROR(emitter.AddVertex(position + origin, row));
  }
  for (uint32_t t = 0; t < mesh->triangles(); ++t) {
    const TriangleVertices corners = mesh->triangle(t);
    for (const VertexIndex v : corners) {
      if (v < mesh->points()) continue;
      return BadInput(file.path() + ": triangle " + std::to_string(t) + ": vertex index " +
                      std::to_string(v) + ", but the mesh has " + std::to_string(mesh->points()) +
                      " vertices");
    }
    MTDB_RETURN_IF_ERROR(emitter.AddTriangle(corners[0], corners[1], corners[2]));
  }
  return emitter.End();
}

}  // namespace mtdb::internal
