// SPDX-License-Identifier: Apache-2.0
// The per-vertex values beside the position: colours, normals, scalars.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace mtdb {

enum class ScalarType : uint8_t {
  kInt8 = 0,
  kUint8 = 1,
  kInt16 = 2,
  kUint16 = 3,
  kInt32 = 4,
  kUint32 = 5,
  kFloat32 = 6,
  kFloat64 = 7,
};

constexpr size_t ScalarSize(ScalarType t) {
  switch (t) {
    case ScalarType::kInt8:
    case ScalarType::kUint8: return 1;
    case ScalarType::kInt16:
    case ScalarType::kUint16: return 2;
    case ScalarType::kInt32:
    case ScalarType::kUint32:
    case ScalarType::kFloat32: return 4;
    case ScalarType::kFloat64: return 8;
  }
  return 0;
}

// One scalar per vertex, named as in PLY: "red", "nx", "quality". `step` and `normal_bits` promise
// that its values lie on a grid, so that the codec needs fewer bits for them; the row holds the
// values in `type` all the same.
struct VertexAttribute {
  std::string name;
  ScalarType type = ScalarType::kFloat32;
  // When above 0 (floats only): each value is a multiple of the step, rounded to the type; see
  // ScalarCode.
  double step = 0;
  // When above 0, 4 to 16: this attribute and the next two, all float32, are a unit normal that is
  // stored with this many bits for each of its two coordinates on the octahedron; see
  // OctahedralCode. Set on the first of the three.
  uint8_t normal_bits = 0;
  friend bool operator==(const VertexAttribute&, const VertexAttribute&) = default;
};

// A mesh with more attributes is refused when it is read: a coder has some 3 KB of models for each.
inline constexpr size_t kMaxAttributes = 4096;

// The attributes of a mesh, at most kMaxAttributes. A vertex's row is their values, packed in this
// order, little-endian.
struct AttributeLayout {
  std::vector<VertexAttribute> attributes;
  size_t row_bytes() const {
    size_t n = 0;
    for (const VertexAttribute& a : attributes) n += ScalarSize(a.type);
    return n;
  }
  bool empty() const { return attributes.empty(); }
  friend bool operator==(const AttributeLayout&, const AttributeLayout&) = default;
};

}  // namespace mtdb
