// SPDX-License-Identifier: Apache-2.0
#include "store/base/attribute_layout.h"

#include <string>

#include "store/base/attribute_grid.h"

namespace mtdb {
namespace {

// Beside the scalar type.
constexpr uint8_t kTypeMask = 0x07;
constexpr uint8_t kStepped = 0x10;
constexpr uint8_t kNormal = 0x20;

constexpr size_t kMinAttributeBytes = 2;  // an empty name and a type

}  // namespace

void PutAttributeLayout(const AttributeLayout& layout, ByteWriter* writer) {
  writer->PutVarint(layout.attributes.size());
  for (const VertexAttribute& a : layout.attributes) {
    writer->PutString(a.name);
    const bool stepped = a.step != 0;
    const bool normal = a.normal_bits != 0;
    writer->Put(static_cast<uint8_t>(static_cast<uint8_t>(a.type) | (stepped ? kStepped : 0) |
                                     (normal ? kNormal : 0)));
    if (stepped) writer->Put(a.step);
    if (normal) writer->Put(a.normal_bits);
  }
}

Result<AttributeLayout> GetAttributeLayout(ByteReader* reader) {
  const uint64_t count = reader->GetVarint();
  if (count > kMaxAttributes || count > reader->remaining() / kMinAttributeBytes) {
    return Corrupt("attributes: " + std::to_string(count) + ", but at most " +
                   std::to_string(kMaxAttributes) + " that fit the " +
                   std::to_string(reader->remaining()) + " bytes that remain are possible");
  }
  AttributeLayout layout;
  for (uint64_t i = 0; i < count; ++i) {
    VertexAttribute a;
    a.name = reader->GetString();
    const auto type = reader->Get<uint8_t>();
    if ((type & ~(kTypeMask | kStepped | kNormal)) != 0) {
      return Corrupt("attribute " + std::to_string(i) + ": type " + std::to_string(type) +
                     " is unknown");
    }
    a.type = static_cast<ScalarType>(type & kTypeMask);
    if (type & kStepped) a.step = reader->Get<double>();
    if (type & kNormal) a.normal_bits = reader->Get<uint8_t>();
    if (((type & kStepped) && a.step == 0) || ((type & kNormal) && a.normal_bits == 0)) {
      return Corrupt("attribute " + std::to_string(i) + ": a step or bits of 0");
    }
    layout.attributes.push_back(std::move(a));
  }
  if (reader->failed()) return Corrupt("attributes: cut short");
  if (!IsValidLayout(layout)) return Corrupt("attributes: steps or normals of no use");
  return layout;
}

}  // namespace mtdb
