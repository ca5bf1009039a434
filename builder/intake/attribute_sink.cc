// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/attribute_sink.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "store/base/attribute_grid.h"
#include "store/base/attribute_layout.h"

namespace mtdb::internal {

namespace {

// An eighth of a texel of the largest page, as a power of two.
double TextureStep(const BuildOptions& options, const std::vector<Texture>& textures) {
  if (options.texture_step) return *options.texture_step;
  if (options.mode == PositionMode::kLossless) return 0;
  constexpr double kTexels = 8;
  uint32_t most = 0;
  for (const Texture& texture : textures) most = std::max({most, texture.width, texture.height});
  if (most == 0) most = 4096;
  return std::exp2(-std::ceil(std::log2(kTexels * most)));
}

template <typename T>
T Load(const std::byte* p) {
  T v;
  std::memcpy(&v, p, sizeof(T));
  return v;
}

}  // namespace

Status AttributeSink::Begin(const MeshHeader& header) {
  MeshHeader rounded = header;
  std::vector<VertexAttribute>& all = rounded.attributes.attributes;
  for (VertexAttribute& a : all) {
    a.step = 0;
    a.normal_bits = 0;
  }
  if (all.size() > kMaxAttributes) {
    return BadInput("the vertices have " + std::to_string(all.size()) +
                    " attributes, but an object has at most " + std::to_string(kMaxAttributes) +
                    "; leave some out");
  }
  if (const std::string fault = AttributeNamesFault(header.attributes); !fault.empty()) {
    return BadInput(fault + "; give it another name");
  }
  textured_ = rounded.textured =
      header.textured && !options_->drop_texture && !options_->terrain && !options_->height_field;
  if (!textured_) rounded.textures.clear();
  if (textured_) rounded.texture_step = TextureStep(*options_, header.textures);
  if (rounded.textures.size() > kMostPages) {
    return BadInput(std::to_string(header.textures.size()) + " pages of texture, but at most " +
                    std::to_string(kMostPages) + " are supported; leave the texture out");
  }
  if (options_->normal_bits) {
    constexpr const char* kNames[] = {"nx", "ny", "nz"};
    const auto first = std::ranges::find(all, kNames[0], &VertexAttribute::name);
    for (std::ptrdiff_t i = 0; i < 3; ++i) {
      if (all.end() - first <= i || first[i].name != kNames[i] ||
          first[i].type != ScalarType::kFloat32) {
        return InvalidArgument(
            "normals: the input has no nx, ny, nz of float32 side by side; leave them lossless");
      }
    }
    first->normal_bits = static_cast<uint8_t>(*options_->normal_bits);
  }
  for (const AttributeStep& step : options_->attribute_steps) {
    const auto found = std::ranges::find(all, step.name, &VertexAttribute::name);
    if (found == all.end() || found->type < ScalarType::kFloat32) {
      return InvalidArgument("attribute " + step.name +
                             (found == all.end() ? ": the input has none of that name"
                                                 : ": steps are for floats, it has integers") +
                             "; leave out its step");
    }
    if (found->step != 0) return InvalidArgument("attribute " + step.name + ": two steps for it");
    found->step = step.step;
  }
  if (!IsValidLayout(rounded.attributes)) {
    return InvalidArgument("normals: as points of the octahedron they can have no step as well");
  }
  row_bytes_ = 0;
  for (const VertexAttribute& a : all) {
    if (a.step > 0 || a.normal_bits > 0) rounded_.push_back({a, row_bytes_});
    row_bytes_ += ScalarSize(a.type);
  }
  if (on_header_) MTDB_RETURN_IF_ERROR(on_header_(rounded));
  return sink_->Begin(rounded);
}

Status AttributeSink::Round(const Rounded& what, uint64_t vertex, std::byte* value) const {
  const VertexAttribute& a = what.attribute;
  const auto refuse = [&](const std::string& problem) {
    return BadInput("vertex " + std::to_string(vertex) + ": " + a.name + ": " + problem);
  };
  if (a.normal_bits > 0) {
    const Vec3d normal{Load<float>(value), Load<float>(value + 4), Load<float>(value + 8)};
    if (!std::isfinite(normal.x) || !std::isfinite(normal.y) || !std::isfinite(normal.z)) {
      return refuse("a normal that is not finite; leave normals lossless");
    }
    const Vec3d unit = DecodeOctahedral(EncodeOctahedral(normal, a.normal_bits), a.normal_bits);
    for (int i = 0; i < 3; ++i) {
      const auto c = static_cast<float>(unit[i]);
      std::memcpy(value + sizeof(float) * static_cast<size_t>(i), &c, sizeof(float));
    }
    return Status::Ok();
  }
  const bool is_float = a.type == ScalarType::kFloat32;
  const double v = is_float ? Load<float>(value) : Load<double>(value);
  if (!(std::abs(v / a.step) <= static_cast<double>(MaxScalarCode(a.type)))) {
    return refuse("a value that is not finite, or more than " +
                  std::to_string(MaxScalarCode(a.type)) +
                  " steps from 0; choose a larger step, or leave it lossless");
  }
  const int64_t code = ScalarCode(v, a.step);
  if (is_float) {
    const float f = Float32OfCode(code, a.step);
    std::memcpy(value, &f, sizeof(f));
  } else {
    const double d = Float64OfCode(code, a.step);
    std::memcpy(value, &d, sizeof(d));
  }
  return Status::Ok();
}

Status AttributeSink::AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
  if (rounded_.empty()) return sink_->AddVertices(positions, rows);
  rows_.assign(rows.begin(), rows.end());
  for (size_t i = 0; i < positions.size(); ++i) {
    for (const Rounded& what : rounded_) {
      MTDB_RETURN_IF_ERROR(Round(what, vertices_ + i, rows_.data() + i * row_bytes_ + what.offset));
    }
  }
  vertices_ += positions.size();
  return sink_->AddVertices(positions, rows_);
}

}  // namespace mtdb::internal
