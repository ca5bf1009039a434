// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/output_files.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>
#include <draco/compression/decode.h>
#include <functional>
#include <nlohmann/json.hpp>
#include <string_view>

#include "codecs/mesh_file/mesh_file.h"
#include "tests/everything/process.h"

namespace mtdb::everything {

namespace {

// The columns of an attribute that has several, as files of the input name them.
std::vector<std::string> ColumnNames(const std::string& kind, size_t count) {
  if (kind == "NORMAL") return {"nx", "ny", "nz"};
  if (kind != "COLOR_0") return std::vector<std::string>(count, kind);
  std::vector<std::string> names{"red", "green", "blue", "alpha"};
  names.resize(std::min(count, names.size()));
  return names;
}

// One attribute of a file: `count` columns of one type. value: where those of a vertex are.
struct FileColumns {
  std::string kind;  // NORMAL, COLOR_0, or the attribute's name in the file
  ScalarType type = ScalarType::kFloat32;
  size_t count = 1;
  std::function<void(size_t vertex, std::byte* value)> read;
};

// Appends them to the mesh's rows.
void TakeColumns(const std::vector<FileColumns>& all, TriangleMesh* mesh) {
  for (const FileColumns& c : all) {
    for (const std::string& name : ColumnNames(c.kind, c.count)) {
      mesh->header.attributes.attributes.push_back({name, c.type});
    }
  }
  const size_t row_bytes = mesh->header.attributes.row_bytes();
  mesh->rows.resize(mesh->positions.size() * row_bytes);
  for (size_t v = 0; v < mesh->positions.size(); ++v) {
    std::byte* out = mesh->rows.data() + v * row_bytes;
    for (const FileColumns& c : all) {
      c.read(v, out);
      out += c.count * ScalarSize(c.type);
    }
  }
}

ScalarType GlbType(int component) {
  switch (component) {
    case 5120: return ScalarType::kInt8;
    case 5121: return ScalarType::kUint8;
    case 5122: return ScalarType::kInt16;
    case 5123: return ScalarType::kUint16;
    default: return ScalarType::kFloat32;
  }
}

void ReadGlbRows(const nlohmann::json& json, const nlohmann::json& attributes, const char* binary,
                 TriangleMesh* mesh) {
  std::vector<FileColumns> all;
  for (const auto& [name, number] : attributes.items()) {
    if (name == "POSITION") continue;
    const auto& accessor = json.at("accessors").at(number.get<size_t>());
    const auto& view = json.at("bufferViews").at(accessor.at("bufferView").get<size_t>());
    FileColumns columns;
    columns.kind = name;
    columns.type = GlbType(accessor.at("componentType"));
    const std::string type = accessor.at("type");
    columns.count = type == "SCALAR" ? 1 : static_cast<size_t>(type.back() - '0');
    const char* begin =
        binary + view.value("byteOffset", size_t{0}) + accessor.value("byteOffset", size_t{0});
    const size_t bytes = columns.count * ScalarSize(columns.type);
    const size_t stride = view.value("byteStride", bytes);
    columns.read = [=](size_t vertex, std::byte* value) {
      std::memcpy(value, begin + vertex * stride, bytes);
    };
    all.push_back(columns);
  }
  TakeColumns(all, mesh);
}

ScalarType DracoType(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8: return ScalarType::kInt8;
    case draco::DT_UINT8: return ScalarType::kUint8;
    case draco::DT_INT16: return ScalarType::kInt16;
    case draco::DT_UINT16: return ScalarType::kUint16;
    case draco::DT_INT32: return ScalarType::kInt32;
    case draco::DT_UINT32: return ScalarType::kUint32;
    case draco::DT_FLOAT64: return ScalarType::kFloat64;
    default: return ScalarType::kFloat32;
  }
}

void ReadDracoRows(const draco::Mesh& read, TriangleMesh* mesh) {
  std::vector<FileColumns> all;
  for (int i = 0; i < read.num_attributes(); ++i) {
    const draco::PointAttribute* a = read.attribute(i);
    FileColumns columns;
    if (a->attribute_type() == draco::GeometryAttribute::POSITION) continue;
    if (a->attribute_type() == draco::GeometryAttribute::NORMAL) columns.kind = "NORMAL";
    if (a->attribute_type() == draco::GeometryAttribute::COLOR) columns.kind = "COLOR_0";
    if (a->attribute_type() == draco::GeometryAttribute::GENERIC) {
      const draco::AttributeMetadata* told = read.GetAttributeMetadataByAttributeId(i);
      if (told == nullptr || !told->GetEntryString("name", &columns.kind)) continue;
    }
    columns.type = DracoType(a->data_type());
    columns.count = static_cast<size_t>(a->num_components());
    columns.read = [=](size_t vertex, std::byte* value) {
      a->GetMappedValue(draco::PointIndex(static_cast<uint32_t>(vertex)), value);
    };
    all.push_back(columns);
  }
  TakeColumns(all, mesh);
}

// Whole files only, as mtdb writes them: one mesh at one node.
Status ReadGlb(const std::string& path, TriangleMesh* mesh) {
  const std::string bytes = ReadText(path);
  if (bytes.size() < 20) return BadInput(path + ": too short");
  uint32_t json_bytes = 0;
  std::memcpy(&json_bytes, bytes.data() + 12, 4);
  const auto json = nlohmann::json::parse(bytes.substr(20, json_bytes), nullptr, false);
  if (json.is_discarded()) return BadInput(path + ": no JSON");
  if (!json.contains("meshes")) return Status::Ok();
  const char* binary = bytes.data() + 20 + json_bytes + 8;
  const auto& primitive = json.at("meshes").at(0).at("primitives").at(0);
  Vec3d origin;
  for (const auto& node : json.at("nodes")) {
    // A terrain's node turns it as well.
    const bool turned = node.contains("matrix");
    if (!turned && !node.contains("translation")) continue;
    const auto& place = turned ? node.at("extras").at("origin") : node.at("translation");
    for (int i = 0; i < 3; ++i) origin[i] = place.at(static_cast<size_t>(i));
  }
  const auto place = [&](const nlohmann::json& accessor) {
    const auto& view = json.at("bufferViews").at(accessor.at("bufferView").get<size_t>());
    return std::pair(view.value("byteOffset", size_t{0}) + accessor.value("byteOffset", size_t{0}),
                     view.value("byteStride", size_t{0}));
  };
  const auto& positions =
      json.at("accessors").at(primitive.at("attributes").at("POSITION").get<size_t>());
  const auto [at, told_stride] = place(positions);
  const size_t stride = told_stride == 0 ? 12 : told_stride;
  for (size_t v = 0; v < positions.at("count").get<size_t>(); ++v) {
    float p[3];
    std::memcpy(p, binary + at + v * stride, sizeof(p));
    mesh->positions.push_back(origin + Vec3d{p[0], p[1], p[2]});
  }
  ReadGlbRows(json, primitive.at("attributes"), binary, mesh);
  const auto& indices = json.at("accessors").at(primitive.at("indices").get<size_t>());
  const size_t first = place(indices).first;
  const int type = indices.at("componentType");
  const size_t size = type == 5125 ? 4 : type == 5123 ? 2 : 1;
  std::vector<VertexIndex> all;
  for (size_t i = 0; i < indices.at("count").get<size_t>(); ++i) {
    uint32_t index = 0;
    std::memcpy(&index, binary + first + i * size, size);
    all.push_back(index);
  }
  for (size_t i = 0; i + 2 < all.size(); i += 3) {
    mesh->triangles.push_back({all[i], all[i + 1], all[i + 2]});
  }
  return Status::Ok();
}

Status ReadDraco(const std::string& path, TriangleMesh* mesh) {
  const std::string bytes = ReadText(path);
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return BadInput(path + ": " + decoded.status().error_msg_string());
  const draco::Mesh& read = *decoded.value();
  const draco::PointAttribute* positions =
      read.GetNamedAttribute(draco::GeometryAttribute::POSITION);
  if (positions == nullptr) return BadInput(path + ": no positions");
  std::vector<double> told(3);
  if (read.GetMetadata() != nullptr) read.GetMetadata()->GetEntryDoubleArray("origin", &told);
  const Vec3d origin{told.at(0), told.at(1), told.at(2)};
  for (draco::PointIndex p(0); p < read.num_points(); ++p) {
    double xyz[3];
    positions->ConvertValue<double>(positions->mapped_index(p), 3, xyz);
    mesh->positions.push_back(origin + Vec3d{xyz[0], xyz[1], xyz[2]});
  }
  ReadDracoRows(read, mesh);
  for (draco::FaceIndex f(0); f < read.num_faces(); ++f) {
    const auto& face = read.face(f);
    mesh->triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
  return Status::Ok();
}

}  // namespace

namespace {

// Which attributes of an object mean colours and normals: the first set of names that is there.
std::array<std::string, 4> ColourNames(const AttributeLayout& layout) {
  const auto has = [&](const char* name) {
    return std::ranges::find(layout.attributes, name, &VertexAttribute::name) !=
           layout.attributes.end();
  };
  if (has("red")) return {"red", "green", "blue", "alpha"};
  if (has("diffuse_red")) {
    return {"diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"};
  }
  return {"r", "g", "b", "a"};
}
std::array<std::string, 3> NormalNames(const AttributeLayout& layout) {
  const bool plain =
      std::ranges::find(layout.attributes, "nx", &VertexAttribute::name) != layout.attributes.end();
  if (plain) return {"nx", "ny", "nz"};
  return {"normal_x", "normal_y", "normal_z"};
}
template <size_t kSize>
size_t PlaceIn(const std::array<std::string, kSize>& names, const std::string& name) {
  return static_cast<size_t>(std::ranges::find(names, name) - names.begin());
}

}  // namespace

std::string CarriedName(const std::string& format, const AttributeLayout& stored,
                        const std::string& attribute) {
  if (format == "ply") return attribute;
  constexpr std::array<const char*, 4> kColours{"red", "green", "blue", "alpha"};
  constexpr std::array<const char*, 3> kNormals{"nx", "ny", "nz"};
  if (const size_t c = PlaceIn(ColourNames(stored), attribute); c < 4) return kColours[c];
  if (const size_t n = PlaceIn(NormalNames(stored), attribute); n < 3) return kNormals[n];
  if (format != "glb") return attribute;
  std::string name = "_";
  for (const char c : attribute) {
    const auto byte = static_cast<unsigned char>(c);
    name += byte < 0x80 && std::isalnum(byte) != 0 ? static_cast<char>(std::toupper(byte)) : '_';
  }
  return name;
}

namespace {

double ScalarOf(ScalarType type, const std::byte* value) {
  const auto as = [&]<typename T>(T number) {
    std::memcpy(&number, value, sizeof(number));
    return static_cast<double>(number);
  };
  switch (type) {
    case ScalarType::kInt8: return as(int8_t{});
    case ScalarType::kUint8: return as(uint8_t{});
    case ScalarType::kInt16: return as(int16_t{});
    case ScalarType::kUint16: return as(uint16_t{});
    case ScalarType::kInt32: return as(int32_t{});
    case ScalarType::kUint32: return as(uint32_t{});
    case ScalarType::kFloat32: return as(float{});
    case ScalarType::kFloat64: return as(double{});
  }
  return 0;
}

// Two directions; where one is none, any will do. `told` is of float32.
bool IsSameNormal(const std::byte* told, const std::byte* stored, ScalarType type, double most) {
  Vec3d a, b;
  for (size_t i = 0; i < 3; ++i) {
    a[static_cast<int>(i)] = ScalarOf(ScalarType::kFloat32, told + 4 * i);
    b[static_cast<int>(i)] = ScalarOf(type, stored + ScalarSize(type) * i);
  }
  const double length = Length(b);
  if (!(length > 1e-6) || !std::isfinite(length)) return true;
  return Length(a - b * (1 / length)) <= most;
}

// Bytes of Draco's are what is next to the colour; .glb has its light, but for alpha.
bool IsSameColour(const std::string& format, size_t component, double told, ScalarType told_type,
                  double stored, ScalarType stored_type) {
  const double whole = stored_type >= ScalarType::kFloat32  ? 1
                       : stored_type == ScalarType::kUint16 ? 65535
                                                            : 255;
  const double part = stored / whole;
  if (format == "drc") return std::abs(told - 255 * part) <= 0.5 + 1e-9;
  const double light = component == 3    ? part
                       : part <= 0.04045 ? part / 12.92
                                         : std::pow((part + 0.055) / 1.055, 2.4);
  if (told_type == ScalarType::kFloat32) return std::abs(told - light) <= 1e-7;
  return std::abs(told - 65535 * light) <= 0.5 + 1e-6;
}

}  // namespace

bool CarriedRowMatches(const std::string& format, const AttributeLayout& carried,
                       const std::byte* row, const AttributeLayout& stored,
                       const std::byte* stored_row) {
  size_t offset = 0;
  const bool keeps = format == "ply";
  const auto colours = ColourNames(stored);
  const auto normals = NormalNames(stored);
  for (const VertexAttribute& a : stored.attributes) {
    const std::string name = CarriedName(format, stored, a.name);
    const std::byte* value = stored_row + offset;
    offset += ScalarSize(a.type);
    size_t at = 0;
    const VertexAttribute* found = nullptr;
    for (const VertexAttribute& c : carried.attributes) {
      if (c.name == name) found = &c;
      if (found != nullptr) break;
      at += ScalarSize(c.type);
    }
    // A vertex of a .glb has room for 252 bytes.
    if (found == nullptr && format == "glb" && stored.attributes.size() > 40) continue;
    if (found == nullptr) return false;
    if (const size_t n = PlaceIn(normals, a.name); n < 3 && !keeps) {
      const double most = format == "glb" ? 1e-5 : 0.02;
      if (n == 0 && !IsSameNormal(row + at, value, a.type, most)) return false;
      continue;
    }
    double wanted = ScalarOf(a.type, value);
    const double told = ScalarOf(found->type, row + at);
    if (const size_t c = PlaceIn(colours, a.name); c < 4 && !keeps) {
      if (!IsSameColour(format, c, told, found->type, wanted, a.type)) return false;
      continue;
    }
    if (format == "glb" && found->type == ScalarType::kFloat32) {
      wanted = static_cast<double>(static_cast<float>(wanted));
      if (!std::isfinite(wanted)) wanted = 0;
    }
    if (wanted != told && !(std::isnan(wanted) && std::isnan(told))) return false;
  }
  return true;
}

const OutputFormat& OutputFormatOf(const std::string& extension) {
  for (const OutputFormat& f : kOutputFormats) {
    if (extension == f.extension) return f;
  }
  return kOutputFormats[0];
}

Status ReadOutput(const std::string& path, TriangleMesh* mesh) {
  if (path.ends_with(".glb")) return ReadGlb(path, mesh);
  if (path.ends_with(".drc")) return ReadDraco(path, mesh);
  TriangleMeshSink sink(mesh);
  return ReadMeshFile(path, sink, nullptr);
}

}  // namespace mtdb::everything
