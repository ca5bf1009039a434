// SPDX-License-Identifier: Apache-2.0
// Draco: the whole mesh in memory, encoded at End() by its edgebreaker.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <draco/attributes/attribute_quantization_transform.h>
#include <draco/compression/expert_encode.h>
#include <draco/core/quantization_utils.h>
#include <draco/mesh/mesh.h>
#include <memory>
#include <new>
#include <span>
#include <vector>

#include "codecs/mesh_file/writers/mesh_writer.h"

namespace mtdb::internal {
namespace {

constexpr int kNormalBits = 10;
// Besides the positions: Draco's files number attributes in 8 bits with a sign, and its encoder
// does not look.
constexpr size_t kMaxAttributes = 128;

draco::DataType DracoType(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8: return draco::DT_INT8;
    case ScalarType::kUint8: return draco::DT_UINT8;
    case ScalarType::kInt16: return draco::DT_INT16;
    case ScalarType::kUint16: return draco::DT_UINT16;
    case ScalarType::kInt32: return draco::DT_INT32;
    case ScalarType::kUint32: return draco::DT_UINT32;
    case ScalarType::kFloat32: return draco::DT_FLOAT32;
    case ScalarType::kFloat64: return draco::DT_FLOAT64;
  }
  return draco::DT_INVALID;
}

// One attribute of Draco's: some columns of a row, one after another.
struct DracoColumns {
  draco::GeometryAttribute::Type kind = draco::GeometryAttribute::GENERIC;
  ScalarType type = ScalarType::kFloat32;
  std::vector<size_t> offsets;  // in a row
  std::vector<size_t> indices;  // in the layout
  std::string name;             // kept as metadata of generic ones
};

std::vector<DracoColumns> PlanColumns(const AttributeLayout& layout) {
  std::vector<DracoColumns> plan;
  std::vector<size_t> used;
  const auto add = [&](draco::GeometryAttribute::Type kind, ScalarType type,
                       std::span<const size_t> offsets, std::span<const size_t> indices) {
    plan.push_back(
        {kind, type, {offsets.begin(), offsets.end()}, {indices.begin(), indices.end()}, ""});
    used.insert(used.end(), indices.begin(), indices.end());
  };
  if (const ColourAttributes c = FindColours(layout); c.count > 0) {
    const auto count = static_cast<size_t>(c.count);
    add(draco::GeometryAttribute::COLOR, ScalarType::kUint8, std::span(c.offsets).first(count),
        std::span(c.indices).first(count));
  }
  if (const NormalAttributes n = FindNormals(layout); n.found) {
    add(draco::GeometryAttribute::NORMAL, ScalarType::kFloat32, n.offsets, n.indices);
  }
  size_t offset = 0;
  for (size_t i = 0; i < layout.attributes.size(); ++i) {
    const VertexAttribute& a = layout.attributes[i];
    if (std::find(used.begin(), used.end(), i) == used.end()) {
      plan.push_back({draco::GeometryAttribute::GENERIC, a.type, {offset}, {i}, a.name});
    }
    offset += ScalarSize(a.type);
  }
  return plan;
}

class DracoWriter final : public MeshWriter {
 public:
  DracoWriter(const std::string& path, const MeshWriteOptions& options)
      : MeshWriter(path), options_(options) {}

  // The quantum's half, and what Draco's float32 arithmetic adds: some roundings of offsets within
  // the bounds, and one of the sum of the smallest corner and such an offset.
  double LargestRounding(const MeshHeader& header) const override {
    const FloatPositions positions(header, origin_kind());
    double quantised = 0;
    if (!header.bounds.empty()) {
      const Vec3d size = header.bounds.max - header.bounds.min;
      const double range = std::max({size.x, size.y, size.z});
      const Vec3d low = header.bounds.min - positions.origin();
      const Vec3d high = header.bounds.max - positions.origin();
      double most = range;
      for (int i = 0; i < 3; ++i) most = std::max({most, std::abs(low[i]), std::abs(high[i])});
      const double quantum = range / (std::ldexp(1.0, options_.draco_position_bits) - 1);
      quantised = std::sqrt(3.0) * (quantum / 2 + (8 * range + most) * 0x1p-24) * (1 + 1e-6);
    }
    return positions.LargestRounding(header) + quantised;
  }
  double rounding() const override { return float_positions().rounding() + quantised_; }

 private:
  Status WriteHeader() override {
    // Draco counts corners in 32 bits with a sign.
    constexpr uint64_t kMaxTriangles = 0x7fffffffu / 3;
    if (triangle_count() == 0 || triangle_count() > kMaxTriangles ||
        vertex_count() > kMaxTriangles * 3) {
      return InvalidArgument(path() + ": Draco holds 1 to 715827882 triangles, but the mesh has " +
                             std::to_string(triangle_count()) + " triangles and " +
                             std::to_string(vertex_count()) +
                             " vertices; write PLY or ask for another part of it");
    }
    columns_ = PlanColumns(header().attributes);
    CarryAll();
    colours_ = ColourReader(FindColours(header().attributes));
    normals_ = FindNormals(header().attributes);
    if (columns_.size() > kMaxAttributes) {
      return InvalidArgument(path() + ": Draco holds at most " + std::to_string(kMaxAttributes) +
                             " attributes, but the mesh has " + std::to_string(columns_.size()) +
                             "; write PLY");
    }
    // Draco reports a lack of memory by an exception.
    try {
      TakeMemory();
    } catch (const std::bad_alloc&) {
      return OutOfMemory();
    }
    return Status::Ok();
  }

  Status OutOfMemory() const {
    return {StatusCode::kNoSpace,
            path() + ": not enough memory to encode " + std::to_string(triangle_count()) +
                " triangles with Draco; write PLY or ask for a part of the mesh"};
  }

  void TakeMemory() {
    mesh_.set_num_points(static_cast<uint32_t>(vertex_count()));
    mesh_.SetNumFaces(triangle_count());
    AddAttribute(draco::GeometryAttribute::POSITION, ScalarType::kFloat32, 3);
    for (const DracoColumns& c : columns_) {
      const int id = AddAttribute(c.kind, c.type, c.offsets.size());
      if (c.name.empty()) continue;
      auto metadata = std::make_unique<draco::AttributeMetadata>();
      metadata->AddEntryString("name", c.name);
      mesh_.AddAttributeMetadata(id, std::move(metadata));
    }
  }

  int AddAttribute(draco::GeometryAttribute::Type kind, ScalarType type, size_t components) {
    draco::GeometryAttribute attribute;
    const auto stride = static_cast<int64_t>(ScalarSize(type) * components);
    attribute.Init(kind, nullptr, static_cast<uint8_t>(components), DracoType(type),
                   /*normalized=*/kind == draco::GeometryAttribute::COLOR, stride, 0);
    return mesh_.AddAttribute(attribute, /*identity_mapping=*/true,
                              static_cast<uint32_t>(vertex_count()));
  }

  Status WriteVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    const size_t row_bytes = header().attributes.row_bytes();
    for (size_t i = 0; i < positions.size(); ++i, ++next_vertex_) {
      const draco::AttributeValueIndex at(next_vertex_);
      const Vec3d p = positions[i];
      Vec3f f;
      if (!float_positions().Round(p, &f)) return TooLarge();
      mesh_.attribute(0)->SetAttributeValue(at, &f);
      for (size_t k = 0; k < columns_.size(); ++k) {
        std::array<std::byte, sizeof(double) * 4> value;
        PutValue(columns_[k], rows.data() + i * row_bytes, value.data());
        mesh_.attribute(static_cast<int>(k) + 1)->SetAttributeValue(at, value.data());
      }
    }
    return Status::Ok();
  }

  void PutValue(const DracoColumns& columns, const std::byte* row, std::byte* value) {
    if (columns.kind == draco::GeometryAttribute::COLOR) {
      for (int c = 0; c < colours_.count(); ++c) value[c] = std::byte{colours_.Byte(row, c)};
    } else if (columns.kind == draco::GeometryAttribute::NORMAL) {
      // Draco quantises normals, which it cannot do with NaN.
      const Vec3d n = NormalIn(row, normals_);
      std::array<float, 3> single{static_cast<float>(n.x), static_cast<float>(n.y),
                                  static_cast<float>(n.z)};
      if (!std::all_of(single.begin(), single.end(), [](float v) { return std::isfinite(v); })) {
        single = {};
      }
      std::memcpy(value, single.data(), sizeof(single));
    } else {
      std::memcpy(value, row + columns.offsets[0], ScalarSize(columns.type));
    }
  }

  Status WriteTriangles(std::span<const TriangleVertices> triangles) override {
    for (const TriangleVertices& t : triangles) {
      draco::Mesh::Face face;
      for (size_t i = 0; i < 3; ++i) face[i] = draco::PointIndex(static_cast<uint32_t>(t[i]));
      mesh_.SetFace(draco::FaceIndex(next_triangle_++), face);
    }
    return Status::Ok();
  }

  Status WriteEnd() override {
    try {
      return Encode();
    } catch (const std::bad_alloc&) {
      return OutOfMemory();
    }
  }

  Status Encode() {
    draco::ExpertEncoder encoder(mesh_);
    const int speed = 10 - options_.draco_level;
    encoder.SetSpeedOptions(speed, speed);
    encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
    encoder.SetAttributeQuantization(0, options_.draco_position_bits);
    if (const FloatPositions& positions = float_positions(); positions.has_origin()) {
      const Vec3d o = positions.origin();
      auto metadata = std::make_unique<draco::GeometryMetadata>();
      metadata->AddEntryDoubleArray("origin", {o.x, o.y, o.z});
      if (mesh_.GetMetadata() == nullptr) {
        mesh_.AddMetadata(std::move(metadata));
      } else {
        mesh_.metadata()->AddEntryDoubleArray("origin", {o.x, o.y, o.z});
      }
    }
    MeasureQuantisation();
    for (size_t k = 0; k < columns_.size(); ++k) {
      if (columns_[k].kind == draco::GeometryAttribute::NORMAL) {
        encoder.SetAttributeQuantization(static_cast<int>(k) + 1, kNormalBits);
      }
    }
    draco::EncoderBuffer buffer;
    if (const draco::Status status = encoder.EncodeToBuffer(&buffer); !status.ok()) {
      return InvalidArgument(path() + ": Draco cannot encode the mesh: " +
                             status.error_msg_string() + "; write PLY instead");
    }
    return file().Append(std::as_bytes(std::span(buffer.data(), buffer.size())));
  }

  // As the encoder and the decoder will do it.
  void MeasureQuantisation() {
    const draco::PointAttribute& positions = *mesh_.attribute(0);
    draco::AttributeQuantizationTransform transform;
    const int bits = options_.draco_position_bits;
    if (!transform.ComputeParameters(positions, bits)) return;  // the encoder says why
    const int32_t largest = static_cast<int32_t>((uint32_t{1} << bits) - 1);
    draco::Quantizer quantizer;
    quantizer.Init(transform.range(), largest);
    draco::Dequantizer dequantizer;
    if (!dequantizer.Init(transform.range(), largest)) return;
    double most2 = 0;
    for (uint32_t v = 0; v < next_vertex_; ++v) {
      std::array<float, 3> p;
      positions.GetValue(draco::AttributeValueIndex(v), p.data());
      double moved2 = 0;
      for (int i = 0; i < 3; ++i) {
        const float low = transform.min_value(i);
        const float value = p[static_cast<size_t>(i)];
        const float back = dequantizer.DequantizeFloat(quantizer.QuantizeFloat(value - low)) + low;
        const double moved = static_cast<double>(back) - static_cast<double>(value);
        moved2 += moved * moved;
      }
      most2 = std::max(most2, moved2);
    }
    quantised_ = std::sqrt(most2) * (1 + 1e-12);
  }

  FloatOrigin origin_kind() const override { return FloatOrigin::kDecimals; }
  const char* position_type() const override { return "quantised"; }
  void AddToReport(MeshWriteReport* report) const override {
    colours_.AddToReport("8 bits", report);
  }

  MeshWriteOptions options_;
  ColourReader colours_;
  NormalAttributes normals_;
  double quantised_ = 0;  // the farthest that quantisation moves a position
  std::vector<DracoColumns> columns_;
  draco::Mesh mesh_;
  uint32_t next_vertex_ = 0;
  uint32_t next_triangle_ = 0;
};

}  // namespace

Result<std::unique_ptr<MeshWriter>> CreateDracoWriter(const std::string& path,
                                                      const MeshWriteOptions& options) {
  if (options.draco_position_bits < 1 || options.draco_position_bits > 30) {
    return InvalidArgument("draco_position_bits: expected 1 to 30, found " +
                           std::to_string(options.draco_position_bits));
  }
  if (options.draco_level < 0 || options.draco_level > 10) {
    return InvalidArgument("draco_level: expected 0 to 10, found " +
                           std::to_string(options.draco_level));
  }
  return std::unique_ptr<MeshWriter>(std::make_unique<DracoWriter>(path, options));
}

}  // namespace mtdb::internal
