// SPDX-License-Identifier: Apache-2.0
// A mesh with attributes of each kind that an object can have: lossless ones of every type,
// colours, rounded normals and scalars, all at once; and positions that are lossless or doubles.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

struct AttributeKind {
  std::string name;
  TriangleMesh mesh;
  // How it is to be stored.
  bool lossless_positions = false;
  std::optional<int> normal_bits;
  std::vector<std::pair<std::string, double>> steps;
};

namespace kinds_internal {

enum AttributeParts : unsigned {
  kTypes = 1,  // one of each scalar type, floats with NaN and infinity
  kColours = 2,
  kNormals = 4,
  kScalars = 8,  // a float and a double that vary smoothly
};

inline void AddAttributes(unsigned parts, TriangleMesh* mesh) {
  std::vector<VertexAttribute>& all = mesh->header.attributes.attributes;
  if (parts & kTypes) {
    for (uint8_t type = 0; type < 8; ++type) {
      all.push_back(
          {std::string("type") + static_cast<char>('0' + type), static_cast<ScalarType>(type)});
    }
  }
  if (parts & kColours) {
    for (const char* name : {"red", "green", "blue"}) all.push_back({name, ScalarType::kUint8});
  }
  if (parts & kNormals) {
    for (const char* name : {"nx", "ny", "nz"}) all.push_back({name, ScalarType::kFloat32});
  }
  if (parts & kScalars) {
    all.push_back({"quality", ScalarType::kFloat32});
    all.push_back({"time", ScalarType::kFloat64});
  }
  std::mt19937 random(9);
  const auto noise = [&] { return static_cast<double>(random() % 1000) * 1e-3 - 0.5; };
  const Vec3d first = mesh->positions.empty() ? Vec3d{} : mesh->positions.front();
  ByteWriter w;
  for (const Vec3d& at : mesh->positions) {
    const Vec3d p = at - first;
    if (parts & kTypes) {
      const uint32_t any = random();
      w.Put(static_cast<int8_t>(any));
      w.Put(static_cast<uint8_t>(any >> 8));
      w.Put(static_cast<int16_t>(40 * p.x));
      w.Put(static_cast<uint16_t>(any >> 16));
      w.Put(static_cast<int32_t>(1e6 * p.y));
      w.Put(any);
      const float specials[] = {std::numeric_limits<float>::quiet_NaN(),
                                -std::numeric_limits<float>::infinity(), -0.0f, 3e38f};
      w.Put(any % 9 < 4 ? specials[any % 9] : static_cast<float>(p.z));
      w.Put(any % 7 == 0 ? std::numeric_limits<double>::quiet_NaN() : 1e200 * p.x);
    }
    for (int i = 0; i < 3 && (parts & kColours); ++i) {
      w.Put(static_cast<uint8_t>(static_cast<int>(100 * (p.x + p.y) + 9 * noise()) & 255));
    }
    if (parts & kNormals) {
      const Vec3d n{std::sin(5 * p.x) + 0.1 * noise(), std::cos(5 * p.y), std::sin(3 * p.z) + 0.01};
      for (int i = 0; i < 3; ++i) w.Put(static_cast<float>(n[i] / Length(n)));
    }
    if (parts & kScalars) {
      w.Put(static_cast<float>(100 * p.x + noise()));
      w.Put(1e6 + 7 * p.y + 0.01 * noise());
    }
  }
  mesh->rows = w.Take();
}

}  // namespace kinds_internal

// `base` has no attributes; its positions are of a size of about 1.
inline std::vector<AttributeKind> AttributeKinds(const TriangleMesh& base) {
  using namespace kinds_internal;
  const std::vector<std::pair<std::string, double>> steps{{"quality", 0.25}, {"time", 1e-3}};
  std::vector<AttributeKind> kinds;
  const auto add = [&](const std::string& name, unsigned parts) -> AttributeKind& {
    AttributeKind& kind = kinds.emplace_back();
    kind.name = name;
    kind.mesh = base;
    AddAttributes(parts, &kind.mesh);
    return kind;
  };
  add("none", 0);
  add("every type, lossless", kTypes);
  add("colours", kColours);
  add("normals and scalars, lossless", kNormals | kScalars);
  add("rounded scalars", kScalars).steps = steps;
  for (const int bits : {4, 10, 16}) {
    add("normals of " + std::to_string(bits) + " bits", kNormals).normal_bits = bits;
  }
  AttributeKind& mixed = add("mixed", kTypes | kColours | kNormals | kScalars);
  mixed.normal_bits = 12;
  mixed.steps = steps;
  AttributeKind& lossless = add("mixed, lossless positions", kColours | kNormals | kScalars);
  lossless.normal_bits = 9;
  lossless.steps = {steps[1]};
  lossless.lossless_positions = true;
  for (Vec3d& p : lossless.mesh.positions) {
    for (int i = 0; i < 3; ++i) {
      volatile auto rounded = static_cast<float>(p[i]);  // see RoundToFloat32
      p[i] = rounded;
    }
  }
  lossless.mesh.header.double_positions = false;
  AttributeKind& doubles = add("mixed, double positions", kColours | kNormals | kScalars);
  doubles.normal_bits = 9;
  doubles.steps = {steps[0]};
  for (Vec3d& p : doubles.mesh.positions) p += Vec3d{512345.25, 5412345.5, 321.125};
  doubles.mesh.header.double_positions = true;
  return kinds;
}

}  // namespace mtdb::testing
