#include "tests/everything/output_files.h"

#include <cstring>
#include <draco/compression/decode.h>
#include <nlohmann/json.hpp>

#include "codecs/mesh_file/mesh_file.h"
#include "tests/everything/process.h"

namespace mtdb::everything {

namespace {

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
    if (!node.contains("translation")) continue;
    for (int i = 0; i < 3; ++i) origin[i] = node.at("translation").at(static_cast<size_t>(i));
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
  for (draco::FaceIndex f(0); f < read.num_faces(); ++f) {
    const auto& face = read.face(f);
    mesh->triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
  return Status::Ok();
}

}  // namespace

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
