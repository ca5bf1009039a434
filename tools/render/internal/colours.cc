// SPDX-License-Identifier: Apache-2.0
#include "tools/render/internal/colours.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "store/base/vertex_meaning.h"

namespace mtdb {

namespace {

// From dark blue over green to yellow, about as bright as the value is large, also for the colour-
// blind and in grey.
constexpr Rgb kStops[] = {{68, 1, 84},    {71, 44, 122},  {59, 81, 139},
                          {44, 113, 142}, {33, 144, 141}, {39, 173, 129},
                          {92, 200, 99},  {170, 220, 50}, {253, 231, 37}};
// The tints of the viewer's map of that name.
constexpr Rgb kTints[] = {{59, 107, 79},   {111, 154, 95}, {169, 191, 118}, {220, 211, 154},
                          {201, 166, 115}, {169, 124, 90}, {148, 115, 95},  {179, 162, 154},
                          {216, 208, 204}, {255, 255, 255}};
constexpr Rgb kUnknown{128, 128, 128};

template <typename T>
double Read(const std::byte* at) {
  T value;
  std::memcpy(&value, at, sizeof(value));
  return static_cast<double>(value);
}

double ReadScalar(ScalarType type, const std::byte* at) {
  switch (type) {
    case ScalarType::kInt8: return Read<int8_t>(at);
    case ScalarType::kUint8: return Read<uint8_t>(at);
    case ScalarType::kInt16: return Read<int16_t>(at);
    case ScalarType::kUint16: return Read<uint16_t>(at);
    case ScalarType::kInt32: return Read<int32_t>(at);
    case ScalarType::kUint32: return Read<uint32_t>(at);
    case ScalarType::kFloat32: return Read<float>(at);
    case ScalarType::kFloat64: return Read<double>(at);
  }
  return 0;
}

// The colour at `t` of the stops, which lie at equal distances.
template <size_t kCount>
Rgb Between(const Rgb (&stops)[kCount], double t) {
  constexpr size_t kLast = kCount - 1;
  const double x = std::clamp(t, 0.0, 1.0) * static_cast<double>(kLast);
  const size_t i = std::min(static_cast<size_t>(x), kLast - 1);
  Rgb colour;
  for (size_t c = 0; c < 3; ++c) {
    const double part = x - static_cast<double>(i);
    colour[c] =
        static_cast<uint8_t>(std::lround(stops[i][c] * (1 - part) + stops[i + 1][c] * part));
  }
  return colour;
}

}  // namespace

Rgb ColourOfValue(double t) { return Between(kStops, t); }
Rgb TintOfHeight(double t) { return Between(kTints, t); }

namespace internal {

Status Colours::Load(const TriangleMesh& mesh, const RenderOptions& options) {
  by_ = options.colour;
  range_ = options.range;
  if (range_ && !((*range_)[0] <= (*range_)[1])) {
    return InvalidArgument("the range of the colours must go from a number to a larger one");
  }
  switch (by_) {
    case ColourBy::kNothing:
    case ColourBy::kNormal: range_.reset(); break;
    case ColourBy::kHeight:
      height_scale_ = options.height_scale;
      LoadHeights();
      break;
    case ColourBy::kOwn:
      range_.reset();
      LoadVertexColours(mesh);
      break;
    case ColourBy::kAttribute: return LoadAttribute(mesh, options.attribute);
    case ColourBy::kDistance:
      if (options.reference == nullptr) return InvalidArgument("distances need a reference");
      return reference_.Load(*options.reference, scene_.frame());
  }
  return Status::Ok();
}

Status Colours::LoadAttribute(const TriangleMesh& mesh, const std::string& name) {
  const std::vector<VertexAttribute>& attributes = mesh.header.attributes.attributes;
  const size_t row = mesh.header.attributes.row_bytes();
  size_t offset = 0;
  std::string known;
  for (const VertexAttribute& a : attributes) {
    known += (known.empty() ? "" : ", ") + a.name;
    if (a.name != name) {
      offset += ScalarSize(a.type);
      continue;
    }
    if (mesh.rows.size() < row * mesh.positions.size()) {
      return InvalidArgument("the mesh lacks rows of attributes");
    }
    values_.resize(mesh.positions.size());
    for (size_t v = 0; v < values_.size(); ++v) {
      values_[v] = ReadScalar(a.type, mesh.rows.data() + v * row + offset);
    }
    if (range_) return Status::Ok();
    double least = INFINITY, most = -INFINITY;
    scene_.ForEachVertex([&](uint32_t v) {
      if (!std::isfinite(values_[v])) return;
      least = std::min(least, values_[v]);
      most = std::max(most, values_[v]);
    });
    range_ = least <= most ? std::array{least, most} : std::array{0.0, 0.0};
    return Status::Ok();
  }
  return InvalidArgument("no attribute '" + name + "'; the object has " +
                         (known.empty() ? "none" : known));
}

void Colours::LoadHeights() {
  if (range_) return;
  double least = INFINITY, most = -INFINITY;
  scene_.ForEachCorner([&](Vec3d p) {
    least = std::min(least, p.z);
    most = std::max(most, p.z);
  });
  const auto height = [&](double z) {
    return (z / scene_.frame().scale + scene_.frame().centre.z) / height_scale_;
  };
  range_ = {height(least), height(most)};
}

void Colours::LoadVertexColours(const TriangleMesh& mesh) {
  const size_t row = mesh.header.attributes.row_bytes();
  const ColourAttributes found = FindColours(mesh.header.attributes);
  if (found.count == 0 || mesh.rows.size() < row * mesh.positions.size()) return;
  colours_.resize(mesh.positions.size());
  for (size_t v = 0; v < colours_.size(); ++v) {
    for (int c = 0; c < 3; ++c) {
      const std::byte* const at =
          mesh.rows.data() + v * row + found.offsets[static_cast<size_t>(c)];
      colours_[v][c] = std::pow(static_cast<float>(ColourPart(at, found.type)), 2.2f);
    }
  }
}

Vec3f Colours::Albedo(const Hit& hit) const {
  if (by_ == ColourBy::kHeight) {
    const double size = (*range_)[1] - (*range_)[0];
    const Rgb tint = TintOfHeight(size > 0 ? (Height(hit) - (*range_)[0]) / size : 0);
    Vec3f linear;
    for (int c = 0; c < 3; ++c) {
      linear[c] = std::pow(static_cast<float>(tint[static_cast<size_t>(c)]) / 255, 2.2f);
    }
    return linear;
  }
  if (colours_.empty()) return Vec3f{0.66f, 0.60f, 0.52f};
  return colours_[scene_.VertexOf(hit.triangle, 0)] * (1 - hit.u - hit.v) +
         colours_[scene_.VertexOf(hit.triangle, 1)] * hit.u +
         colours_[scene_.VertexOf(hit.triangle, 2)] * hit.v;
}

double Colours::Height(const Hit& hit) const {
  const auto corner = [&](size_t c) { return double{scene_.Vertex(hit.triangle, c).z}; };
  const double z = corner(0) * (1 - double{hit.u} - hit.v) + corner(1) * hit.u + corner(2) * hit.v;
  return (z / scene_.frame().scale + scene_.frame().centre.z) / height_scale_;
}

double Colours::Value(const Hit& hit, Vec3f at) const {
  if (by_ == ColourBy::kDistance) return reference_.DistanceTo(at) / scene_.frame().scale;
  const auto corner = [&](size_t c) { return values_[scene_.VertexOf(hit.triangle, c)]; };
  return corner(0) * (1 - double{hit.u} - hit.v) + corner(1) * hit.u + corner(2) * hit.v;
}

Rgb Colours::OfValue(double value) const {
  if (!std::isfinite(value) || !range_) return kUnknown;
  const double size = (*range_)[1] - (*range_)[0];
  return ColourOfValue(size > 0 ? (value - (*range_)[0]) / size : 0);
}

}  // namespace internal
}  // namespace mtdb
