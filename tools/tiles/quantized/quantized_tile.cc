// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/quantized/quantized_tile.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/tiles/places/geodesy.h"

namespace mtdb {

namespace {

constexpr uint8_t kNormalsExtension = 1;
constexpr size_t kMostShortVertices = 65536;
constexpr double kNeverHidden =
    1e6;  // of the point that tells whether the tile is behind the globe

uint16_t Zigzag(int32_t value) {
  return static_cast<uint16_t>(static_cast<uint32_t>(value) << 1 ^
                               static_cast<uint32_t>(value >> 31));
}

uint16_t UnitsOf(double part) {
  return static_cast<uint16_t>(std::clamp(part, 0.0, 1.0) * kTileUnits + 0.5);
}

uint64_t HashOfUnits(const std::array<uint16_t, 3>& u) {
  return internal::HashOfNumber(u[0] | uint64_t{u[1]} << 16 | uint64_t{u[2]} << 32);
}

// Sines and cosines of the places from one side of a tile to the other: most vertices share theirs
// with others, as they were samples of a raster.
class DirectionTable {
 public:
  DirectionTable(double low, double high) : low_(low), high_(high), entries_(kEntries) {}
  const GlobeDirection& At(uint16_t units) {
    Entry& entry = entries_[units % kEntries];
    if (entry.units != units) {
      const double part = static_cast<double>(units) / kTileUnits;
      entry = {units, GlobeDirection(low_ + (high_ - low_) * part)};
    }
    return entry.direction;
  }

 private:
  static constexpr size_t kEntries = 512;
  struct Entry {
    uint32_t units = kNone32;
    GlobeDirection direction;
  };
  double low_, high_;
  std::vector<Entry> entries_;
};

// A direction in two bytes, on an octahedron that is unfolded.
std::array<uint8_t, 2> Octahedral(Vec3d n) {
  const double sum = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
  if (!(sum > 0)) return {128, 128};
  double x = n.x / sum, y = n.y / sum;
  if (n.z < 0) {
    const double folded = (1 - std::abs(y)) * (x < 0 ? -1 : 1);
    y = (1 - std::abs(x)) * (y < 0 ? -1 : 1);
    x = folded;
  }
  const auto byte = [](double v) {
    return static_cast<uint8_t>(std::lround((std::clamp(v, -1.0, 1.0) * 0.5 + 0.5) * 255));
  };
  return {byte(x), byte(y)};
}

struct Sphere {
  Vec3d centre;
  double radius = 0;
};

Sphere SphereAround(const std::vector<Vec3d>& points) {
  Box3d box;
  for (const Vec3d& p : points) box.Add(p);
  if (points.empty()) box.Add(Vec3d{});
  Sphere sphere{(box.min + box.max) * 0.5, 0};
  for (const Vec3d& p : points) {
    sphere.radius = std::max(sphere.radius, Length(p - sphere.centre));
  }
  return sphere;
}

// In a space where the ellipsoid is the unit sphere: the nearest point of the ray through the
// sphere's centre that is hidden only where all `points` are.
Vec3d HorizonPoint(const std::vector<Vec3d>& points, Vec3d centre) {
  constexpr double kPolar = kEarthRadius * (1 - kEarthFlattening);
  const auto scaled = [](Vec3d p) {
    return Vec3d{p.x / kEarthRadius, p.y / kEarthRadius, p.z / kPolar};
  };
  Vec3d direction = scaled(centre);
  const double length = Length(direction);
  direction = length > 0 ? direction * (1 / length) : Vec3d{1, 0, 0};
  double farthest = 1;
  for (const Vec3d& point : points) {
    const Vec3d p = scaled(point);
    const double from_centre = Length(p), height = std::max(from_centre, 1.0);
    const Vec3d d = p * (1 / from_centre);
    const double cos_alpha = Dot(d, direction), sin_alpha = Length(Cross(d, direction));
    const double cos_beta = 1 / height;
    const double sin_beta = std::sqrt(height * height - 1) * cos_beta;
    const double reach = cos_alpha * cos_beta - sin_alpha * sin_beta;
    farthest = std::max(farthest, reach > 1 / kNeverHidden ? 1 / reach : kNeverHidden);
  }
  return direction * farthest;
}

struct Header {
  Vec3d centre;
  float low = 0, high = 0;
  Vec3d sphere;
  double radius = 0;
  Vec3d horizon;
};
static_assert(sizeof(Header) == 88);

}  // namespace

std::array<uint16_t, 3> QuantizedTile::UnitsAt(Vec3d p) const {
  const double height = std::clamp((p.z - low_) / step_ + 0.5, 0.0, kTileUnits + 0.5);
  return {UnitsOf((p.x - rectangle_.west) / (rectangle_.east - rectangle_.west)),
          UnitsOf((p.y - rectangle_.south) / (rectangle_.north - rectangle_.south)),
          static_cast<uint16_t>(height)};
}

uint32_t QuantizedTile::NumberOf(const Vertex& vertex) {
  if (2 * vertices_.size() >= numbers_.size()) {
    numbers_.Resize(std::max<size_t>(2 * numbers_.size(), 256),
                    [this](uint32_t number) { return HashOf(number); });
  }
  uint32_t& number = numbers_.Find(HashOfUnits(vertex.units), [&](uint32_t other) {
    return vertices_[other].units == vertex.units;
  });
  if (number == kNone32) {
    number = static_cast<uint32_t>(vertices_.size());
    vertices_.push_back(vertex);
  }
  return number;
}

uint64_t QuantizedTile::HashOf(uint32_t number) const {
  return HashOfUnits(vertices_[number].units);
}

void QuantizedTile::Add(const ClipPolygon& polygon) {
  std::array<Vertex, 8> corners;
  for (size_t i = 0; i < polygon.count; ++i) {
    corners[i] = {UnitsAt(polygon.corners[i].position), polygon.corners[i].normal};
  }
  const Vertex& a = corners[0];
  for (size_t i = 1; i + 1 < polygon.count; ++i) {
    const Vertex& b = corners[i];
    const Vertex& c = corners[i + 1];
    if (a.units == b.units || b.units == c.units || c.units == a.units) continue;
    // Vertices are numbered in the order in which triangles name them.
    const uint32_t first = NumberOf(a), second = NumberOf(b), third = NumberOf(c);
    triangles_.push_back({first, second, third});
  }
}

Bytes QuantizedTile::Encode() const {
  std::vector<Vec3d> points;
  std::vector<std::array<uint8_t, 2>> normals;
  points.reserve(vertices_.size());
  normals.reserve(vertices_.size());
  DirectionTable longitudes(rectangle_.west, rectangle_.east);
  DirectionTable latitudes(rectangle_.south, rectangle_.north);
  for (const Vertex& v : vertices_) {
    const LocalFrame frame(longitudes.At(v.units[0]), latitudes.At(v.units[1]),
                           low_ + step_ * v.units[2]);
    points.push_back(frame.origin);
    normals.push_back(Octahedral(frame.ToEarth(v.normal)));
  }
  const Sphere sphere = SphereAround(points);
  ByteWriter out;
  const Header header{sphere.centre,
                      static_cast<float>(low_),
                      static_cast<float>(low_ + step_ * kTileUnits),
                      sphere.centre,
                      sphere.radius,
                      HorizonPoint(points, sphere.centre)};
  out.PutBytes({reinterpret_cast<const std::byte*>(&header), sizeof(header)});
  out.Put(static_cast<uint32_t>(vertices_.size()));
  for (size_t c = 0; c < 3; ++c) {
    int32_t last = 0;
    for (const Vertex& v : vertices_) {
      out.Put(Zigzag(v.units[c] - last));
      last = v.units[c];
    }
  }
  PutIndices(&out);
  out.Put(kNormalsExtension);
  out.Put(static_cast<uint32_t>(2 * vertices_.size()));
  for (const std::array<uint8_t, 2>& normal : normals) {
    for (const uint8_t byte : normal) out.Put(byte);
  }
  return out.Take();
}

void QuantizedTile::PutIndices(ByteWriter* to) const {
  ByteWriter& out = *to;
  const bool is_long = vertices_.size() > kMostShortVertices;
  const auto put = [&](uint32_t index) {
    is_long ? out.Put(index) : out.Put(static_cast<uint16_t>(index));
  };
  while (is_long && out.size() % sizeof(uint32_t) != 0) out.Put(uint8_t{0});
  out.Put(static_cast<uint32_t>(triangles_.size()));
  uint32_t highest = 0;
  for (const auto& triangle : triangles_) {
    for (const uint32_t v : triangle) {
      put(highest - v);
      if (v == highest) ++highest;
    }
  }
  // West, south, east, north: in order along the side.
  const std::array<std::array<size_t, 2>, 4> sides{{{0, 0}, {1, 0}, {0, 1}, {1, 1}}};
  for (const auto& [axis, is_high] : sides) {
    std::vector<uint32_t> side;
    for (uint32_t v = 0; v < vertices_.size(); ++v) {
      if (vertices_[v].units[axis] == (is_high != 0 ? kTileUnits : 0)) side.push_back(v);
    }
    std::sort(side.begin(), side.end(), [&, along = 1 - axis](uint32_t a, uint32_t b) {
      return std::pair(vertices_[a].units[along], a) < std::pair(vertices_[b].units[along], b);
    });
    out.Put(static_cast<uint32_t>(side.size()));
    for (const uint32_t v : side) put(v);
  }
}

Result<std::vector<Triangle3d>> DecodeQuantizedTile(ByteSpan bytes,
                                                    const GlobeRectangle& rectangle) {
  ByteReader in(bytes);
  in.GetBytes(sizeof(Vec3d));
  const double low = in.Get<float>(), high = in.Get<float>();
  in.GetBytes(sizeof(Header) - sizeof(Vec3d) - 2 * sizeof(float));
  const auto count = in.Get<uint32_t>();
  if (in.failed() || count > in.remaining() / (3 * sizeof(uint16_t))) {
    return Corrupt("has fewer bytes than it says, or is not there");
  }
  std::vector<Vec3d> positions(count);
  for (int c = 0; c < 3; ++c) {
    const double first = c == 0 ? rectangle.west : c == 1 ? rectangle.south : low;
    const double last = c == 0 ? rectangle.east : c == 1 ? rectangle.north : high;
    int32_t units = 0;
    for (Vec3d& p : positions) {
      const auto code = in.Get<uint16_t>();
      units += code >> 1 ^ -(code & 1);
      if (units < 0 || units > kTileUnits) return Corrupt("a vertex is outside of the tile");
      p[c] = first + (last - first) * units / kTileUnits;
    }
  }
  const bool is_long = count > kMostShortVertices;
  while (is_long && in.position() % sizeof(uint32_t) != 0) in.Get<uint8_t>();
  const auto triangles = in.Get<uint32_t>();
  if (in.failed() || triangles > in.remaining() / (3 * (is_long ? 4 : 2))) {
    return Corrupt("has fewer triangles than it says");
  }
  std::vector<Triangle3d> corners(triangles);
  uint32_t highest = 0;
  for (Triangle3d& t : corners) {
    for (Vec3d& corner : t) {
      const uint32_t code = is_long ? in.Get<uint32_t>() : in.Get<uint16_t>();
      if (code > highest || highest - code >= count) return Corrupt("an index is wrong");
      corner = positions[highest - code];
      if (code == 0) ++highest;
    }
  }
  return corners;
}

}  // namespace mtdb
