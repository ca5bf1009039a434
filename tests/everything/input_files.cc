#include "tests/everything/input_files.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "tests/everything/process.h"
#include "tests/everything/step.h"
#include "tests/support/mesh_changes.h"

namespace mtdb::everything {

namespace {

constexpr const char* kPlyTypes[] = {"char", "uchar", "short", "ushort",
                                     "int",  "uint",  "float", "double"};

template <typename T>
T ValueAt(const TriangleMesh& mesh, size_t vertex, size_t offset) {
  T value;
  std::memcpy(&value, mesh.rows.data() + vertex * mesh.header.attributes.row_bytes() + offset,
              sizeof(T));
  return value;
}

std::string FloatText(float value) { return NumberText(static_cast<double>(value)); }

std::string ScalarText(const TriangleMesh& mesh, size_t vertex, size_t offset, ScalarType type) {
  switch (type) {
    case ScalarType::kInt8: return std::to_string(ValueAt<int8_t>(mesh, vertex, offset));
    case ScalarType::kUint8: return std::to_string(ValueAt<uint8_t>(mesh, vertex, offset));
    case ScalarType::kInt16: return std::to_string(ValueAt<int16_t>(mesh, vertex, offset));
    case ScalarType::kUint16: return std::to_string(ValueAt<uint16_t>(mesh, vertex, offset));
    case ScalarType::kInt32: return std::to_string(ValueAt<int32_t>(mesh, vertex, offset));
    case ScalarType::kUint32: return std::to_string(ValueAt<uint32_t>(mesh, vertex, offset));
    case ScalarType::kFloat32: return FloatText(ValueAt<float>(mesh, vertex, offset));
    case ScalarType::kFloat64: return NumberText(ValueAt<double>(mesh, vertex, offset));
  }
  return "";
}

std::string PointText(Vec3d p) {
  return NumberText(p.x) + " " + NumberText(p.y) + " " + NumberText(p.z);
}

void AppendBytes(std::string* out, const void* data, size_t size, bool big_endian) {
  const auto* bytes = static_cast<const char*>(data);
  for (size_t i = 0; i < size; ++i) out->push_back(bytes[big_endian ? size - 1 - i : i]);
}

std::string PlyHeader(const TriangleMesh& mesh, const char* encoding) {
  std::string text = std::string("ply\nformat ") + encoding + " 1.0\nelement vertex " +
                     std::to_string(mesh.positions.size()) + "\n";
  for (const char* axis : {"x", "y", "z"}) {
    text += std::string("property ") + (mesh.header.double_positions ? "double " : "float ") +
            axis + "\n";
  }
  for (const VertexAttribute& a : mesh.header.attributes.attributes) {
    text += std::string("property ") + kPlyTypes[static_cast<size_t>(a.type)] + " " + a.name + "\n";
  }
  return text + "element face " + std::to_string(mesh.triangles.size()) +
         "\nproperty list uchar int vertex_indices\nend_header\n";
}

std::string PlyBinary(const TriangleMesh& mesh, bool big) {
  std::string text = PlyHeader(mesh, big ? "binary_big_endian" : "binary_little_endian");
  const size_t row_bytes = mesh.header.attributes.row_bytes();
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    for (int axis = 0; axis < 3; ++axis) {
      const double value = mesh.positions[v][axis];
      const auto single = static_cast<float>(value);
      if (mesh.header.double_positions) {
        AppendBytes(&text, &value, sizeof(value), big);
      } else {
        AppendBytes(&text, &single, sizeof(single), big);
      }
    }
    size_t offset = v * row_bytes;
    for (const VertexAttribute& a : mesh.header.attributes.attributes) {
      AppendBytes(&text, mesh.rows.data() + offset, ScalarSize(a.type), big);
      offset += ScalarSize(a.type);
    }
  }
  for (const TriangleVertices& t : mesh.triangles) {
    text += '\3';
    for (const VertexIndex v : t) {
      const auto index = static_cast<int32_t>(v);
      AppendBytes(&text, &index, sizeof(index), big);
    }
  }
  return text;
}

std::string PlyText(const TriangleMesh& mesh) {
  std::string text = PlyHeader(mesh, "ascii");
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    text += PointText(mesh.positions[v]);
    size_t offset = 0;
    for (const VertexAttribute& a : mesh.header.attributes.attributes) {
      text += " " + ScalarText(mesh, v, offset, a.type);
      offset += ScalarSize(a.type);
    }
    text += '\n';
  }
  for (const TriangleVertices& t : mesh.triangles) {
    text += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) +
            "\n";
  }
  return text;
}

std::string ObjText(const TriangleMesh& mesh) {
  std::string text = "o mesh\n";
  const bool coloured = !mesh.header.attributes.empty();
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    text += "v " + PointText(mesh.positions[v]);
    // As bytes, beyond 1 so that no vertex looks like a unit colour.
    for (size_t c = 0; coloured && c < 3; ++c) {
      text += " " + ScalarText(mesh, v, c, ScalarType::kUint8);
    }
    text += '\n';
  }
  for (const TriangleVertices& t : mesh.triangles) {
    text += "f " + std::to_string(t[0] + 1) + " " + std::to_string(t[1] + 1) + " " +
            std::to_string(t[2] + 1) + "\n";
  }
  return text;
}

std::string OffText(const TriangleMesh& mesh) {
  std::string text = "OFF\n" + std::to_string(mesh.positions.size()) + " " +
                     std::to_string(mesh.triangles.size()) + " 0\n";
  for (const Vec3d& p : mesh.positions) text += PointText(p) + "\n";
  for (const TriangleVertices& t : mesh.triangles) {
    text += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) +
            "\n";
  }
  return text;
}

std::string StlBinary(const TriangleMesh& mesh) {
  std::string text(80, ' ');
  const auto count = static_cast<uint32_t>(mesh.triangles.size());
  AppendBytes(&text, &count, sizeof(count), false);
  for (const TriangleVertices& t : mesh.triangles) {
    text.append(12, '\0');
    for (const VertexIndex v : t) {
      for (int axis = 0; axis < 3; ++axis) {
        const auto value = static_cast<float>(mesh.positions[v][axis]);
        AppendBytes(&text, &value, sizeof(value), false);
      }
    }
    text.append(2, '\0');
  }
  return text;
}

std::string StlText(const TriangleMesh& mesh) {
  std::string text = "solid mesh\n";
  for (const TriangleVertices& t : mesh.triangles) {
    text += "facet normal 0 0 1\nouter loop\n";
    for (const VertexIndex v : t) text += "vertex " + PointText(mesh.positions[v]) + "\n";
    text += "endloop\nendfacet\n";
  }
  return text + "endsolid mesh\n";
}

void CarryAll(AttributeLayout*) {}
void CarryNothing(AttributeLayout* layout) { layout->attributes.clear(); }
void CarryColours(AttributeLayout* layout) {
  const auto is_colour = [](const VertexAttribute& a) {
    return a.name == "red" || a.name == "green" || a.name == "blue";
  };
  std::erase_if(layout->attributes, [&](const VertexAttribute& a) { return !is_colour(a); });
}

}  // namespace

const std::vector<FileFormat>& FileFormats() {
  static const std::vector<FileFormat> kFormats = {
      {"ply", ".ply", false, false, false, true, CarryAll,
       [](const TriangleMesh& mesh) { return PlyBinary(mesh, false); }},
      {"ply-big", ".ply", false, false, false, true, CarryAll,
       [](const TriangleMesh& mesh) { return PlyBinary(mesh, true); }},
      {"ply-text", ".ply", false, false, true, true, CarryAll, PlyText},
      {"obj", ".obj", false, false, true, false, CarryColours, ObjText},
      {"off", ".off", false, false, true, false, CarryNothing, OffText},
      {"stl", ".stl", true, true, false, true, CarryNothing, StlBinary},
      {"stl-text", ".stl", true, false, true, false, CarryNothing, StlText},
  };
  return kFormats;
}

const FileFormat& FormatOf(const std::string& name) {
  const auto& all = FileFormats();
  const auto at = std::ranges::find_if(all, [&](const FileFormat& f) { return f.name == name; });
  return at == all.end() ? all.front() : *at;
}

void WriteInputFile(const FileFormat& format, const std::string& path, TriangleMesh* mesh) {
  AttributeLayout& layout = mesh->header.attributes;
  const AttributeLayout before = layout;
  format.carry(&layout);
  Bytes rows;
  const size_t row_bytes = before.row_bytes();
  for (size_t v = 0; v < mesh->positions.size() && layout != before; ++v) {
    size_t offset = v * row_bytes;
    for (const VertexAttribute& a : before.attributes) {
      const auto from = mesh->rows.begin() + static_cast<std::ptrdiff_t>(offset);
      offset += ScalarSize(a.type);
      const auto& kept = layout.attributes;
      if (std::ranges::find(kept, a) == kept.end()) continue;
      rows.insert(rows.end(), from, from + static_cast<std::ptrdiff_t>(ScalarSize(a.type)));
    }
  }
  if (layout != before) mesh->rows = std::move(rows);
  if (format.floats_only || !mesh->header.double_positions) mtdb::testing::RoundToFloat32(mesh);
  WriteText(path, format.text(*mesh));
}

}  // namespace mtdb::everything
