// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/input_files.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <zlib.h>

#include "tests/everything/polygons.h"
#include "tests/everything/process.h"
#include "tests/everything/step.h"
#include "tests/support/mesh_changes.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include "draco/compression/encode.h"
#include "draco/mesh/mesh.h"
#pragma GCC diagnostic pop

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

std::string PlyHeader(const TriangleMesh& mesh, const Faces& faces, const char* encoding) {
  std::string text = std::string("ply\nformat ") + encoding + " 1.0\nelement vertex " +
                     std::to_string(mesh.positions.size()) + "\n";
  for (const char* axis : {"x", "y", "z"}) {
    text += std::string("property ") + (mesh.header.double_positions ? "double " : "float ") +
            axis + "\n";
  }
  for (const VertexAttribute& a : mesh.header.attributes.attributes) {
    text += std::string("property ") + kPlyTypes[static_cast<size_t>(a.type)] + " " + a.name + "\n";
  }
  return text + "element face " + std::to_string(faces.size()) +
         "\nproperty list uchar int vertex_indices\nend_header\n";
}

std::string PlyBinary(const TriangleMesh& mesh, const Faces& faces, bool big) {
  std::string text = PlyHeader(mesh, faces, big ? "binary_big_endian" : "binary_little_endian");
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
  for (const auto& face : faces) {
    text += static_cast<char>(face.size());
    for (const VertexIndex v : face) {
      const auto index = static_cast<int32_t>(v);
      AppendBytes(&text, &index, sizeof(index), big);
    }
  }
  return text;
}

// "4 0 1 2 3", line by line.
std::string FaceLines(const Faces& faces) {
  std::string text;
  for (const auto& face : faces) {
    text += std::to_string(face.size());
    for (const VertexIndex v : face) text += " " + std::to_string(v);
    text += '\n';
  }
  return text;
}

std::string PlyText(const TriangleMesh& mesh, const Faces& faces) {
  std::string text = PlyHeader(mesh, faces, "ascii");
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    text += PointText(mesh.positions[v]);
    size_t offset = 0;
    for (const VertexAttribute& a : mesh.header.attributes.attributes) {
      text += " " + ScalarText(mesh, v, offset, a.type);
      offset += ScalarSize(a.type);
    }
    text += '\n';
  }
  return text + FaceLines(faces);
}

std::string ObjText(const TriangleMesh& mesh, const Faces& faces) {
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
  for (const auto& face : faces) {
    text += 'f';
    for (const VertexIndex v : face) text += " " + std::to_string(v + 1);
    text += '\n';
  }
  return text;
}

std::string OffText(const TriangleMesh& mesh, const Faces& faces) {
  std::string text =
      "OFF\n" + std::to_string(mesh.positions.size()) + " " + std::to_string(faces.size()) + " 0\n";
  for (const Vec3d& p : mesh.positions) text += PointText(p) + "\n";
  return text + FaceLines(faces);
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

// The light of a byte of sRGB, as glTF has colours.
float LinearOf(uint8_t byte) {
  const double part = byte / 255.0;
  return static_cast<float>(part <= 0.04045 ? part / 12.92 : std::pow((part + 0.055) / 1.055, 2.4));
}

// The description of a mesh whose vertices (positions, and colours of three floats) are followed by
// its corners, in a buffer that `uri` names, and the buffer.
std::string GltfJson(const TriangleMesh& mesh, const std::string& uri) {
  const bool coloured = !mesh.header.attributes.empty();
  const size_t stride = coloured ? 24 : 12;
  const size_t vertices = mesh.positions.size();
  const std::string count = std::to_string(vertices);
  const std::string corners = std::to_string(3 * mesh.triangles.size());
  const std::string vertex_bytes = std::to_string(vertices * stride);
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
         R"("meshes":[{"primitives":[{"attributes":{"POSITION":0)" +
         std::string(coloured ? R"(,"COLOR_0":2)" : "") + R"(},"indices":1}]}],"accessors":[)" +
         R"({"bufferView":0,"componentType":5126,"type":"VEC3","count":)" + count + "}," +
         R"({"bufferView":1,"componentType":5125,"type":"SCALAR","count":)" + corners + "}," +
         R"({"bufferView":0,"byteOffset":12,"componentType":5126,)" + R"("type":"VEC3","count":)" +
         (coloured ? count : "0") + "}]," + R"("bufferViews":[{"buffer":0,"byteStride":)" +
         std::to_string(stride) + ",\"byteLength\":" + vertex_bytes +
         R"(},{"buffer":0,"byteOffset":)" + vertex_bytes +
         ",\"byteLength\":" + std::to_string(12 * mesh.triangles.size()) +
         R"(}],"buffers":[{"byteLength":)" +
         std::to_string(vertices * stride + 12 * mesh.triangles.size()) + uri + "}]}";
}

std::string GltfBuffer(const TriangleMesh& mesh) {
  std::string bytes;
  const bool coloured = !mesh.header.attributes.empty();
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto value = static_cast<float>(mesh.positions[v][axis]);
      AppendBytes(&bytes, &value, sizeof(value), false);
    }
    for (size_t c = 0; coloured && c < 3; ++c) {
      const float light = LinearOf(ValueAt<uint8_t>(mesh, v, c));
      AppendBytes(&bytes, &light, sizeof(light), false);
    }
  }
  for (const TriangleVertices& t : mesh.triangles) {
    for (const VertexIndex v : t) {
      const auto index = static_cast<uint32_t>(v);
      AppendBytes(&bytes, &index, sizeof(index), false);
    }
  }
  return bytes;
}

std::string GltfBinary(const TriangleMesh& mesh) {
  std::string json = GltfJson(mesh, "");
  while (json.size() % 4 != 0) json += ' ';
  const std::string buffer = GltfBuffer(mesh);
  std::string file = "glTF";
  for (const size_t word : {size_t{2}, 28 + json.size() + buffer.size(), json.size()}) {
    const auto value = static_cast<uint32_t>(word);
    AppendBytes(&file, &value, sizeof(value), false);
  }
  file += "JSON" + json;
  const auto size = static_cast<uint32_t>(buffer.size());
  AppendBytes(&file, &size, sizeof(size), false);
  return file + std::string("BIN\0", 4) + buffer;
}

std::string GltfText(const TriangleMesh& mesh) {
  const std::string bytes = GltfBuffer(mesh);
  const char* const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t bits = 0;
    for (size_t b = 0; b < 3; ++b) {
      bits = bits << 8 | (i + b < bytes.size() ? static_cast<uint8_t>(bytes[i + b]) : 0u);
    }
    for (size_t d = 0; d < 4; ++d) {
      text += i + d <= bytes.size() ? digits[bits >> (18 - 6 * d) & 63] : '=';
    }
  }
  return GltfJson(mesh, R"(,"uri":"data:application/octet-stream;base64,)" + text + "\"");
}

// By Draco itself, without quantisation and in the mesh's order.
std::string DracoFile(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) return "DRACO";
  draco::Mesh out;
  out.set_num_points(static_cast<uint32_t>(mesh.positions.size()));
  out.SetNumFaces(mesh.triangles.size());
  draco::GeometryAttribute attribute;
  attribute.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_FLOAT32, false,
                 3 * sizeof(float), 0);
  const int id = out.AddAttribute(attribute, true, static_cast<uint32_t>(mesh.positions.size()));
  for (uint32_t v = 0; v < mesh.positions.size(); ++v) {
    const Vec3d p = mesh.positions[v];
    const Vec3f f{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
    out.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(v), &f);
  }
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    draco::Mesh::Face face;
    for (size_t c = 0; c < 3; ++c) {
      face[c] = draco::PointIndex(static_cast<uint32_t>(mesh.triangles[t][c]));
    }
    out.SetFace(draco::FaceIndex(t), face);
  }
  draco::Encoder encoder;
  encoder.SetEncodingMethod(draco::MESH_SEQUENTIAL_ENCODING);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeMeshToBuffer(out, &buffer).ok()) return "DRACO";
  return {buffer.data(), buffer.size()};
}

// In two members, as programs that append to such files make them.
void WriteCompressed(const std::string& path, const std::string& text) {
  const size_t half = text.size() / 2;
  for (const auto& [mode, part] :
       {std::pair("wb", text.substr(0, half)), std::pair("ab", text.substr(half))}) {
    const gzFile file = ::gzopen(path.c_str(), mode);
    if (file == nullptr) return;
    ::gzwrite(file, part.data(), static_cast<unsigned>(part.size()));
    ::gzclose(file);
  }
}

// Of a format that has nothing but triangles.
template <std::string (*kText)(const TriangleMesh& mesh)>
std::string OfTriangles(const TriangleMesh& mesh, const Faces&) {
  return kText(mesh);
}

// A text as other programs and systems write it.
void Dress(const TextDress& dress, std::string* text) {
  std::string dressed = dress.byte_order_mark ? "\xef\xbb\xbf" : "";
  for (const char c : *text) {
    if (c == '\n') {
      dressed += dress.line_end;
    } else {
      dressed += c;
    }
  }
  *text = std::move(dressed);
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
       [](const TriangleMesh& mesh, const Faces& f) { return PlyBinary(mesh, f, false); }},
      {"ply-big", ".ply", false, false, false, true, CarryAll,
       [](const TriangleMesh& mesh, const Faces& f) { return PlyBinary(mesh, f, true); }},
      {"ply-text", ".ply", false, false, true, true, CarryAll, PlyText},
      {"obj", ".obj", false, false, true, false, CarryColours, ObjText},
      {"off", ".off", false, false, true, false, CarryNothing, OffText},
      {"stl", ".stl", true, true, false, true, CarryNothing, OfTriangles<StlBinary>},
      {"stl-text", ".stl", true, false, true, false, CarryNothing, OfTriangles<StlText>},
      {"glb", ".glb", false, true, false, true, CarryColours, OfTriangles<GltfBinary>},
      {"gltf", ".gltf", false, true, false, true, CarryColours, OfTriangles<GltfText>},
      {"drc", ".drc", false, true, false, true, CarryNothing, OfTriangles<DracoFile>},
  };
  return kFormats;
}

const FileFormat& FormatOf(const std::string& name) {
  const auto& all = FileFormats();
  const auto at = std::ranges::find_if(all, [&](const FileFormat& f) { return f.name == name; });
  return at == all.end() ? all.front() : *at;
}

void WriteInputFile(const FileFormat& format, const std::string& path, const TextDress& dress,
                    TriangleMesh* mesh) {
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
  std::string text = format.text(*mesh, dress.polygons ? JoinedFaces(*mesh) : TriangleFaces(*mesh));
  if (format.is_text) Dress(dress, &text);
  if (path.ends_with(".gz")) {
    WriteCompressed(path, text);
  } else {
    WriteText(path, text);
  }
}

}  // namespace mtdb::everything
