// SPDX-License-Identifier: Apache-2.0
#include "store/base/attribute_layout.h"

#include <algorithm>
#include <set>
#include <string>
#include <string_view>

#include "store/base/attribute_grid.h"

namespace mtdb {
namespace {

// Beside the scalar type.
constexpr uint8_t kTypeMask = 0x07;
constexpr uint8_t kStepped = 0x10;
constexpr uint8_t kNormal = 0x20;

constexpr size_t kMinAttributeBytes = 3;  // a name of one byte and a type

// The bytes of the character of UTF-8 at `at`; 0 where there is none, or a control character.
size_t CharacterBytes(std::string_view text, size_t at) {
  const auto byte = [&](size_t i) {
    return i < text.size() ? static_cast<uint8_t>(text[i]) : uint8_t{0};
  };
  const uint8_t first = byte(at);
  if (first < 0x80) return first >= 0x20 && first != 0x7f ? 1 : 0;
  const size_t size = first >= 0xf5   ? 0
                      : first >= 0xf0 ? 4
                      : first >= 0xe0 ? 3
                      : first >= 0xc2 ? 2
                                      : 0;
  uint32_t code = first & (0xffu >> (size + 1));
  for (size_t i = 1; i < size; ++i) {
    if ((byte(at + i) & 0xc0) != 0x80) return 0;
    code = code << 6 | (byte(at + i) & 0x3fu);
  }
  const bool overlong = (size == 3 && code < 0x800) || (size == 4 && code < 0x10000);
  const bool control = code < 0xa0 || code == 0x2028 || code == 0x2029;  // lines end there
  if (size == 0 || overlong || control || code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) {
    return 0;
  }
  return size;
}

bool IsCoordinateName(std::string_view name) { return name == "x" || name == "y" || name == "z"; }

// The fault of a name by itself.
std::string NameFault(const std::string& name) {
  if (name.empty()) return "it has no name";
  if (name.size() > kMaxAttributeNameBytes) {
    return "a name of " + std::to_string(name.size()) + " bytes, at most " +
           std::to_string(kMaxAttributeNameBytes) + " are possible";
  }
  for (size_t i = 0; i < name.size();) {
    const size_t bytes = CharacterBytes(name, i);
    if (bytes == 0) return "byte " + std::to_string(i) + " of its name is no printable UTF-8";
    i += bytes;
  }
  if (name.front() == ' ' || name.back() == ' ') {
    return "its name '" + name + "' begins or ends with a space";
  }
  if (IsCoordinateName(name)) return "its name '" + name + "' is that of a coordinate";
  return "";
}

}  // namespace

std::string AttributeNamesFault(const AttributeLayout& layout) {
  std::set<std::string_view> names;
  for (size_t i = 0; i < layout.attributes.size(); ++i) {
    const std::string& name = layout.attributes[i].name;
    std::string fault = NameFault(name);
    if (fault.empty() && !names.insert(name).second) {
      fault = "its name '" + name + "' is that of another one";
    }
    if (!fault.empty()) return "attribute " + std::to_string(i) + ": " + fault;
  }
  return "";
}

std::string UsableAttributeName(const std::string& name, const AttributeLayout& layout) {
  constexpr size_t kRoom = 16;  // for a number
  std::string usable;
  for (size_t i = 0; i < name.size() && usable.size() + kRoom < kMaxAttributeNameBytes;) {
    const size_t bytes = CharacterBytes(name, i);
    usable += bytes == 0 ? "_" : name.substr(i, bytes);
    i += bytes == 0 ? 1 : bytes;
  }
  if (usable.empty()) usable = "_";
  if (usable.front() == ' ') usable.front() = '_';
  if (usable.back() == ' ') usable.back() = '_';
  std::set<std::string_view> taken;
  for (const VertexAttribute& a : layout.attributes) taken.insert(a.name);
  const auto is_taken = [&](const std::string& wanted) {
    return IsCoordinateName(wanted) || taken.contains(wanted);
  };
  std::string unique = usable;
  for (int i = 2; is_taken(unique); ++i) unique = usable + "_" + std::to_string(i);
  return unique;
}

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
  if (const std::string fault = AttributeNamesFault(layout); !fault.empty()) return Corrupt(fault);
  return layout;
}

}  // namespace mtdb
