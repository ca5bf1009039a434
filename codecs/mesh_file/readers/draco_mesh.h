// SPDX-License-Identifier: Apache-2.0
// DracoMesh: a mesh that Draco has compressed, decoded in memory; and the only way to Draco's
// decoder.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb::internal {

enum class DracoKind { kPosition, kNormal, kColour, kTexture, kGeneric };

// An attribute; values are those of points, which are the mesh's vertices.
struct DracoAttribute {
  int index = 0;           // for Values()
  uint32_t unique_id = 0;  // by which glTF names it
  DracoKind kind = DracoKind::kGeneric;
  ScalarType type = ScalarType::kFloat32;
  int components = 0;
  std::string name;  // of its metadata; mostly empty
};

class DracoMesh {
 public:
  // `where` begins messages. Errors: kBadInput (bytes that are no such mesh, or that promise more
  // than kMostPerByte triangles or points for each byte), kNoSpace (memory).
  static Result<std::unique_ptr<DracoMesh>> Decode(ByteSpan bytes, const std::string& where);
  virtual ~DracoMesh() = default;

  virtual uint32_t points() const = 0;
  virtual uint32_t triangles() const = 0;
  virtual TriangleVertices triangle(uint32_t index) const = 0;
  virtual std::vector<DracoAttribute> attributes() const = 0;
  // The value of a point, as many numbers as the attribute has components, up to 4.
  virtual std::array<double, 4> Value(int attribute, uint32_t point) const = 0;
  // What mtdb's writer subtracted from the positions.
  virtual Vec3d origin() const = 0;

  // Regular meshes take little more than nothing, so that this is no more than a bound on what
  // hostile bytes can make the decoder take.
  static constexpr uint64_t kMostPerByte = 256;
};

}  // namespace mtdb::internal
