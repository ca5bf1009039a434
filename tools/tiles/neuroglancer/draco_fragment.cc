// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/neuroglancer/draco_fragment.h"

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>
#include <memory>
#include <new>
#include <span>
#include <utility>

namespace mtdb {

namespace {

constexpr int kSpeed = 3;  // of 0 to 10, and 0 is the smallest

Result<Bytes> Encode(const DracoFragment& fragment) {
  draco::Mesh mesh;
  mesh.set_num_points(static_cast<uint32_t>(fragment.positions.size()));
  mesh.SetNumFaces(fragment.triangles.size());
  draco::GeometryAttribute attribute;
  attribute.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_INT32, false,
                 sizeof(fragment.positions[0]), 0);
  const int id = mesh.AddAttribute(attribute, true, mesh.num_points());
  for (uint32_t v = 0; v < fragment.positions.size(); ++v) {
    mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(v), &fragment.positions[v]);
  }
  for (uint32_t t = 0; t < fragment.triangles.size(); ++t) {
    draco::Mesh::Face face;
    for (size_t i = 0; i < 3; ++i) face[i] = draco::PointIndex(fragment.triangles[t][i]);
    mesh.SetFace(draco::FaceIndex(t), face);
  }
  draco::ExpertEncoder encoder(mesh);
  encoder.SetSpeedOptions(kSpeed, kSpeed);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  draco::EncoderBuffer buffer;
  if (const draco::Status status = encoder.EncodeToBuffer(&buffer); !status.ok()) {
    return InvalidArgument("Draco cannot encode a fragment of " +
                           std::to_string(fragment.triangles.size()) +
                           " triangles: " + status.error_msg_string());
  }
  const auto bytes = std::as_bytes(std::span(buffer.data(), buffer.size()));
  return Bytes(bytes.begin(), bytes.end());
}

Result<DracoFragment> Decode(ByteSpan bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return Corrupt("is no mesh by Draco: " + decoded.status().error_msg_string());
  const std::unique_ptr<draco::Mesh> mesh = std::move(decoded).value();
  const draco::PointAttribute* const at =
      mesh->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  if (at == nullptr || at->num_components() != 3 || at->data_type() != draco::DT_INT32) {
    return Corrupt("has no positions of three whole numbers");
  }
  DracoFragment fragment;
  fragment.positions.resize(mesh->num_points());
  for (uint32_t v = 0; v < mesh->num_points(); ++v) {
    at->GetMappedValue(draco::PointIndex(v), fragment.positions[v].data());
  }
  fragment.triangles.resize(mesh->num_faces());
  for (uint32_t t = 0; t < mesh->num_faces(); ++t) {
    const draco::Mesh::Face& face = mesh->face(draco::FaceIndex(t));
    for (size_t i = 0; i < 3; ++i) {
      fragment.triangles[t][i] = face[i].value();
      if (face[i].value() >= mesh->num_points())
        return Corrupt("names vertices that are not there");
    }
  }
  return fragment;
}

}  // namespace

Result<Bytes> EncodeDracoFragment(const DracoFragment& fragment) { return Encode(fragment); }

Result<DracoFragment> DecodeDracoFragment(ByteSpan bytes) {
  // Of damaged bytes Draco may want more memory than there is.
  try {
    return Decode(bytes);
  } catch (const std::bad_alloc&) {
    return Corrupt("wants more memory than there is");
  }
}

}  // namespace mtdb
