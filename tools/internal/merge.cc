#include "tools/internal/merge.h"

#include <algorithm>
#include <cstring>

namespace mtdb {

namespace {

// Rows of `from` (layout `from_layout`) in `layout`, whose attributes are all in from_layout.
Bytes Project(const Bytes& from, const AttributeLayout& from_layout,
              const AttributeLayout& layout) {
  const size_t from_row = from_layout.row_bytes();
  const size_t row = layout.row_bytes();
  const size_t count = from_row == 0 ? 0 : from.size() / from_row;
  Bytes rows(count * row);
  size_t offset = 0;
  for (const VertexAttribute& a : layout.attributes) {
    size_t from_offset = 0;
    for (const VertexAttribute& b : from_layout.attributes) {
      if (a == b) break;
      from_offset += ScalarSize(b.type);
    }
    const size_t size = ScalarSize(a.type);
    for (size_t i = 0; i < count; ++i) {
      std::memcpy(rows.data() + i * row + offset, from.data() + i * from_row + from_offset, size);
    }
    offset += size;
  }
  return rows;
}

bool Has(const AttributeLayout& layout, const VertexAttribute& attribute) {
  return std::find(layout.attributes.begin(), layout.attributes.end(), attribute) !=
         layout.attributes.end();
}

void DropMissing(AttributeLayout& layout, const AttributeLayout& other, const std::string& path,
                 std::vector<std::string>* notes) {
  std::erase_if(layout.attributes, [&](const VertexAttribute& a) {
    if (Has(other, a)) return false;
    notes->push_back("attribute " + a.name + " dropped: " + path +
                     " has none of that name and type");
    return true;
  });
}

}  // namespace

Status ReadMeshes(const std::vector<std::string>& paths, TriangleMesh* mesh,
                  std::vector<std::string>* notes) {
  for (size_t i = 0; i < paths.size(); ++i) {
    TriangleMesh part;
    TriangleMeshSink sink(&part);
    MeshReadReport report;
    MTDB_RETURN_IF_ERROR(ReadMeshFile(paths[i], sink, &report));
    for (const std::string& what : report.ignored) {
      notes->push_back(paths[i] + ": not carried: " + what);
    }
    if (report.short_faces != 0) {
      notes->push_back(paths[i] + ": " + std::to_string(report.short_faces) +
                       " faces of fewer than three corners dropped");
    }
    if (i == 0) {
      *mesh = std::move(part);
      continue;
    }
    AttributeLayout common = mesh->header.attributes;
    DropMissing(common, part.header.attributes, paths[i], notes);
    AttributeLayout theirs = part.header.attributes;
    DropMissing(theirs, common, paths[0], notes);
    mesh->rows = Project(mesh->rows, mesh->header.attributes, common);
    const Bytes rows = Project(part.rows, part.header.attributes, common);
    mesh->rows.insert(mesh->rows.end(), rows.begin(), rows.end());
    mesh->header.attributes = common;
    mesh->header.double_positions |= part.header.double_positions;
    const VertexIndex first = mesh->positions.size();
    mesh->positions.insert(mesh->positions.end(), part.positions.begin(), part.positions.end());
    for (TriangleVertices t : part.triangles) {
      for (VertexIndex& v : t) v += first;
      mesh->triangles.push_back(t);
    }
  }
  return Status::Ok();
}

}  // namespace mtdb
