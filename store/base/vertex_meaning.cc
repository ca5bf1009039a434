// SPDX-License-Identifier: Apache-2.0
#include "store/base/vertex_meaning.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <string_view>

namespace mtdb {

namespace {

bool IsNamed(const std::string& name, std::string_view small) {
  return std::ranges::equal(
      name, small, [](char a, char b) { return std::tolower(static_cast<unsigned char>(a)) == b; });
}

struct Place {
  ScalarType type;
  size_t offset;
  size_t index;
};

std::optional<Place> Find(const AttributeLayout& layout, std::string_view name) {
  size_t offset = 0;
  for (size_t i = 0; i < layout.attributes.size(); ++i) {
    const VertexAttribute& a = layout.attributes[i];
    if (IsNamed(a.name, name)) return Place{a.type, offset, i};
    offset += ScalarSize(a.type);
  }
  return std::nullopt;
}

// How many of the names are there, one after the other, of the first one's type.
template <typename Found>
size_t Match(const AttributeLayout& layout, std::span<const std::string_view> names, Found* found) {
  size_t count = 0;
  for (const std::string_view name : names) {
    const std::optional<Place> place = Find(layout, name);
    if (!place || (count > 0 && place->type != found->type)) break;
    found->type = place->type;
    found->offsets[count] = place->offset;
    found->indices[count++] = place->index;
  }
  return count;
}

// As a part of what means all of the colour.
double RawPart(const std::byte* value, ScalarType type) {
  const auto as = [&]<typename T>(T number) {
    std::memcpy(&number, value, sizeof(number));
    return static_cast<double>(number);
  };
  switch (type) {
    case ScalarType::kInt8: return as(int8_t{}) / 255;
    case ScalarType::kUint8: return as(uint8_t{}) / 255;
    case ScalarType::kInt16: return as(int16_t{}) / 255;
    case ScalarType::kUint16: return as(uint16_t{}) / 65535;
    case ScalarType::kInt32: return as(int32_t{}) / 255;
    case ScalarType::kUint32: return as(uint32_t{}) / 255;
    case ScalarType::kFloat32: return as(float{});
    case ScalarType::kFloat64: return as(double{});
  }
  return 0;
}

}  // namespace

ColourAttributes FindColours(const AttributeLayout& layout) {
  static constexpr std::array<std::array<std::string_view, 4>, 3> kNames{
      {{"red", "green", "blue", "alpha"},
       {"diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"},
       {"r", "g", "b", "a"}}};
  for (const auto& names : kNames) {
    ColourAttributes colours;
    const size_t count = Match(layout, names, &colours);
    if (count < 3 || colours.type == ScalarType::kInt8) continue;
    colours.count = static_cast<int>(count);
    return colours;
  }
  return {};
}

double ColourPart(const std::byte* value, ScalarType type) {
  const double part = RawPart(value, type);
  return std::isnan(part) ? 0 : std::clamp(part, 0.0, 1.0);
}

bool IsCutColour(const std::byte* value, ScalarType type) {
  const double part = RawPart(value, type);
  return !(part >= 0 && part <= 1);
}

uint8_t ColourByte(const std::byte* value, ScalarType type) {
  if (type == ScalarType::kUint8) return std::to_integer<uint8_t>(*value);
  return static_cast<uint8_t>(std::lround(255 * ColourPart(value, type)));
}

NormalAttributes FindNormals(const AttributeLayout& layout) {
  static constexpr std::array<std::array<std::string_view, 3>, 3> kNames{
      {{"nx", "ny", "nz"}, {"normal_x", "normal_y", "normal_z"}, {"n_x", "n_y", "n_z"}}};
  for (const auto& names : kNames) {
    NormalAttributes normals;
    if (Match(layout, names, &normals) < 3 || normals.type < ScalarType::kFloat32) continue;
    normals.found = true;
    return normals;
  }
  return {};
}

Vec3d NormalIn(const std::byte* row, const NormalAttributes& normals) {
  Vec3d normal;
  for (int i = 0; i < 3; ++i) {
    const std::byte* const at = row + normals.offsets[static_cast<size_t>(i)];
    if (normals.type == ScalarType::kFloat64) {
      std::memcpy(&normal[i], at, sizeof(double));
    } else {
      float value = 0;
      std::memcpy(&value, at, sizeof(value));
      normal[i] = static_cast<double>(value);
    }
  }
  return normal;
}

double LinearOfSrgb(double value) {
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

double SrgbOfLinear(double value) {
  return value <= 0.0031308 ? 12.92 * value : 1.055 * std::pow(value, 1 / 2.4) - 0.055;
}

}  // namespace mtdb
