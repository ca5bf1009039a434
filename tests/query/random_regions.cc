// SPDX-License-Identifier: Apache-2.0
#include "tests/query/random_regions.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mtdb::testing {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double Uniform(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

Vec3d PointIn(const Box3d& box, std::mt19937& random) {
  return {Uniform(random, box.min.x, box.max.x), Uniform(random, box.min.y, box.max.y),
          Uniform(random, box.min.z, box.max.z)};
}

Vec3d Direction(std::mt19937& random) {
  for (;;) {
    const Vec3d v{Uniform(random, -1, 1), Uniform(random, -1, 1), Uniform(random, -1, 1)};
    const double length = Length(v);
    if (length > 0.1 && length < 1) return v * (1 / length);
  }
}

// The nearest point of a convex polyhedron, by brute force: project onto every plane, every line
// of two planes and every corner of three, and keep what is in the polyhedron.
class NearestInConvex {
 public:
  explicit NearestInConvex(std::vector<HalfSpace> planes) : planes_(std::move(planes)) {
    for (HalfSpace& h : planes_) h.normal = h.normal * (1 / Length(h.normal));
  }

  double Height(size_t i, Vec3d p) const { return Dot(p - planes_[i].point, planes_[i].normal); }

  double Distance(Vec3d p) const {
    double best = Contains(p) ? 0 : kInfinity;
    const size_t n = planes_.size();
    for (size_t i = 0; best > 0 && i < n; ++i) {
      Try(p, p - planes_[i].normal * Height(i, p), best);
      for (size_t j = 0; j < i; ++j) {
        const Vec3d a = planes_[i].normal;
        const Vec3d b = planes_[j].normal;
        const double c = Dot(a, b);
        const double determinant = 1 - c * c;
        if (determinant < 1e-12) continue;
        const double ha = Height(i, p);
        const double hb = Height(j, p);
        const Vec3d on_line =
            p - a * ((ha - c * hb) / determinant) - b * ((hb - c * ha) / determinant);
        Try(p, on_line, best);
        const Vec3d along = Cross(a, b);
        for (size_t k = 0; k < j; ++k) {
          const double slope = Dot(along, planes_[k].normal);
          if (std::abs(slope) < 1e-9) continue;
          Try(p, on_line - along * (Height(k, on_line) / slope), best);
        }
      }
    }
    return best;
  }

  double Depth(Vec3d p) const {
    double depth = kInfinity;
    for (size_t i = 0; i < planes_.size(); ++i) depth = std::min(depth, -Height(i, p));
    return std::max(0.0, depth);
  }

 private:
  bool Contains(Vec3d p, double slack = 0) const {
    for (size_t i = 0; i < planes_.size(); ++i) {
      if (Height(i, p) > slack) return false;
    }
    return true;
  }
  void Try(Vec3d p, Vec3d candidate, double& best) const {
    const double slack = 1e-14 * (1 + std::abs(p.x) + std::abs(p.y) + std::abs(p.z));
    if (Contains(candidate, slack)) best = std::min(best, Length(p - candidate));
  }
  std::vector<HalfSpace> planes_;
};

RegionCase ConvexCase(const char* kind, RegionPtr region, std::vector<HalfSpace> planes) {
  const NearestInConvex nearest(std::move(planes));
  return {kind, std::move(region), [=](Vec3d p) { return nearest.Distance(p); },
          [=](Vec3d p) { return nearest.Depth(p); }};
}

// The planes of a frustum from its corners, not from angles.
std::vector<HalfSpace> FrustumPlanes(const Camera& camera) {
  const Camera::Axes a = camera.axes();
  const auto ray = [&](double x, double y) {
    return a.forward + a.right * (x * camera.tangent_x()) + a.up * (y * camera.tangent_y());
  };
  const Vec3d rays[4] = {ray(-1, -1), ray(1, -1), ray(1, 1), ray(-1, 1)};
  std::vector<HalfSpace> planes;
  for (size_t i = 0; i < 4; ++i) {
    planes.push_back({camera.eye, Cross(rays[i], rays[(i + 1) % 4])});
  }
  planes.push_back({camera.eye + a.forward * camera.near, a.forward * -1.0});
  if (std::isfinite(camera.far)) {
    planes.push_back({camera.eye + a.forward * camera.far, a.forward});
  }
  return planes;
}

using Polygon = std::vector<std::array<double, 2>>;

// From a point to a polygon in the plane, negative inside: by winding angles, and edge by edge.
double SignedDistance(const Polygon& polygon, double x, double y) {
  double turn = 0;
  double best = kInfinity;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const auto& a = polygon[i];
    const auto& b = polygon[(i + 1) % polygon.size()];
    best = std::min(best, SquaredDistancePointSegment({x, y, 0}, {a[0], a[1], 0}, {b[0], b[1], 0}));
    turn += std::remainder(std::atan2(b[1] - y, b[0] - x) - std::atan2(a[1] - y, a[0] - x),
                           2 * 3.14159265358979323846);
  }
  return std::abs(turn) > 3 ? -std::sqrt(best) : std::sqrt(best);
}

RegionCase PrismCase(const char* kind, RegionPtr region, const Polygon& polygon, double low,
                     double high) {
  const auto distance = [=](Vec3d p) {
    const double aside = std::max(0.0, SignedDistance(polygon, p.x, p.y));
    return std::hypot(aside, std::max({0.0, p.z - high, low - p.z}));
  };
  const auto depth = [=](Vec3d p) {
    return std::max(0.0, std::min({-SignedDistance(polygon, p.x, p.y), high - p.z, p.z - low}));
  };
  return {kind, std::move(region), distance, depth};
}

// A star around `centre`: simple, hardly ever convex.
Polygon RandomPolygon(Vec3d centre, double size, std::mt19937& random) {
  const int corners = 3 + static_cast<int>(random() % 12);
  Polygon polygon;
  for (int i = 0; i < corners; ++i) {
    const double angle = (i + Uniform(random, 0, 0.8)) * 2 * 3.14159265358979323846 / corners;
    const double radius = size * Uniform(random, 0.15, 1);
    polygon.push_back({centre.x + radius * std::cos(angle), centre.y + radius * std::sin(angle)});
  }
  if (random() % 2 == 0) std::reverse(polygon.begin(), polygon.end());
  return polygon;
}

RegionCase TubeCase(const char* kind, RegionPtr region, const std::vector<Vec3d>& line,
                    double radius) {
  const auto to_line = [=](Vec3d p) {
    double best = kInfinity;
    for (size_t i = 0; i == 0 || i + 1 < line.size(); ++i) {
      best = std::min(
          best, SquaredDistancePointSegment(p, line[i], line[std::min(i + 1, line.size() - 1)]));
    }
    return std::sqrt(best);
  };
  RegionCase result{kind, std::move(region),
                    [=](Vec3d p) { return std::max(0.0, to_line(p) - radius); },
                    // Where two segments meet, the depth is larger.
                    [=](Vec3d p) { return std::max(0.0, radius - to_line(p)); }};
  result.covers_is_exact = line.size() <= 2;
  return result;
}

}  // namespace

Camera RandomCamera(const Box3d& where, std::mt19937& random) {
  const double size = Diagonal(where);
  Camera camera;
  camera.eye = PointIn(where, random) - Direction(random) * (size * Uniform(random, 0, 0.4));
  camera.direction = PointIn(where, random) - camera.eye;
  if (Length(camera.direction) < 0.01 * size) camera.direction = {1, 0, 0};
  do {
    camera.up = Direction(random);
  } while (Length(Cross(camera.up, camera.direction)) < 0.1 * Length(camera.direction));
  camera.vertical_fov_rad = Uniform(random, 0.1, 2);
  camera.width_px = static_cast<int>(200 + random() % 1000);
  camera.height_px = static_cast<int>(200 + random() % 1000);
  if (random() % 2 == 0) camera.near = size * Uniform(random, 0, 0.2);
  if (random() % 2 == 0) camera.far = camera.near + size * Uniform(random, 0.1, 0.6);
  return camera;
}

RegionCase RandomRegion(int kind, const Box3d& where, std::mt19937& random) {
  const double size = Diagonal(where) / 3;
  const Vec3d centre = PointIn(where, random);
  const auto around = [&] { return centre + Direction(random) * (size * Uniform(random, 0, 1)); };
  switch (kind) {
    case 0: {
      Box3d box;
      box.Add(around());
      box.Add(around());
      const auto depth = [=](Vec3d p) {
        double least = kInfinity;
        for (int i = 0; i < 3; ++i) least = std::min({least, p[i] - box.min[i], box.max[i] - p[i]});
        return std::max(0.0, least);
      };
      return {"box", BoxRegion(box),
              [=](Vec3d p) { return std::sqrt(SquaredDistancePointBox(p, box)); }, depth};
    }
    case 1: {
      const double radius = size * Uniform(random, 0, 0.8);
      return TubeCase("sphere", SphereRegion(centre, radius), {centre}, radius);
    }
    case 2: {
      const HalfSpace h{centre, Direction(random) * Uniform(random, 0.1, 10)};
      return ConvexCase("half-space", HalfSpaceRegion(h), {h});
    }
    case 3: {  // bounded by planes that touch a ball, or not bounded
      std::vector<HalfSpace> planes;
      const int count = 2 + static_cast<int>(random() % 7);
      for (int i = 0; i < count; ++i) {
        const Vec3d n = Direction(random);
        planes.push_back({centre + n * (size * Uniform(random, 0.05, 0.8)), n});
      }
      return ConvexCase("convex polyhedron", ConvexRegion(planes), planes);
    }
    case 4: {  // a slab or a prism: planes along one line
      const Vec3d along = Direction(random);
      std::vector<HalfSpace> planes;
      const int count = 2 + static_cast<int>(random() % 3);
      for (int i = 0; i < count; ++i) {
        Vec3d n = Direction(random);
        n = n - along * Dot(n, along);
        if (i == 1 && random() % 2 == 0) n = planes[0].normal * -1.0;
        planes.push_back({centre + n * (size * Uniform(random, 0.05, 0.5)), n});
      }
      return ConvexCase("slab", ConvexRegion(planes), planes);
    }
    case 5: {
      const Camera camera = RandomCamera(where, random);
      return ConvexCase("frustum", FrustumRegion(camera), FrustumPlanes(camera));
    }
    case 6: {
      Wedge w;
      w.apex_x = centre.x;
      w.apex_y = centre.y;
      const double angle = Uniform(random, 0, 6.28);
      w.direction_x = 3 * std::cos(angle);
      w.direction_y = 3 * std::sin(angle);
      w.angle_rad = Uniform(random, 0.1, 3);
      if (random() % 2 == 0) w.near = size * Uniform(random, 0, 0.5);
      if (random() % 2 == 0) w.far = w.near + size * Uniform(random, 0.1, 1);
      const auto normal = [&](double at, double sign) {
        return Vec3d{std::cos(at + sign * 1.5707963267948966),
                     std::sin(at + sign * 1.5707963267948966), 0};
      };
      const Vec3d apex{centre.x, centre.y, 0};
      const Vec3d forward{std::cos(angle), std::sin(angle), 0};
      std::vector<HalfSpace> planes{{apex, normal(angle + w.angle_rad / 2, 1)},
                                    {apex, normal(angle - w.angle_rad / 2, -1)},
                                    {apex + forward * w.near, forward * -1.0}};
      if (std::isfinite(w.far)) planes.push_back({apex + forward * w.far, forward});
      return ConvexCase("wedge", WedgeRegion(w), planes);
    }
    case 7: {  // the convex hull of the frustum's corners in the plane, by brute force
      Camera camera = RandomCamera(where, random);
      if (!std::isfinite(camera.far)) camera.far = camera.near + size;
      if (random() % 4 == 0) camera.direction.z = 0;
      if (random() % 4 == 0) camera.up = {0, 0, 1};
      if (!camera.Validate().ok()) camera.up = {0.3, 0.4, 0.1};
      const Camera::Axes a = camera.axes();
      std::vector<Vec3d> corners;
      for (int i = 0; i < 8; ++i) {
        const Vec3d ray = a.forward + a.right * ((i & 1 ? 1 : -1) * camera.tangent_x()) +
                          a.up * ((i & 2 ? 1 : -1) * camera.tangent_y());
        Vec3d p = camera.eye + ray * (i & 4 ? camera.near : camera.far);
        p.z = 0;
        corners.push_back(p);
      }
      std::vector<HalfSpace> planes;
      for (const Vec3d& p : corners) {
        for (const Vec3d& q : corners) {
          const Vec3d n{q.y - p.y, p.x - q.x, 0};
          const double length = Length(n);
          if (length < 1e-9 * size) continue;
          const bool outermost = std::all_of(corners.begin(), corners.end(), [&](Vec3d r) {
            return Dot(r - p, n) <= 1e-9 * size * length;
          });
          if (outermost) planes.push_back({p, n});
        }
      }
      return ConvexCase("shadow of a frustum", FrustumShadowRegion(camera), planes);
    }
    case 8: {
      const Polygon polygon = RandomPolygon(centre, size, random);
      return PrismCase("prism", PrismRegion(polygon), polygon, -kInfinity, kInfinity);
    }
    case 9: {
      const Polygon polygon = RandomPolygon(centre, size, random);
      const double low = random() % 4 == 0 ? -kInfinity : centre.z - size * Uniform(random, 0, 0.3);
      const double high = centre.z + size * Uniform(random, 0, 0.3);
      return PrismCase("prism with lids", PrismRegion(polygon, low, high), polygon, low, high);
    }
    case 10: return TubeCase("point", PointRegion(centre), {centre}, 0);
    case 11: {
      const std::vector<Vec3d> line{around(), around()};
      return TubeCase("segment", SegmentRegion(line[0], line[1]), line, 0);
    }
    case 12: {
      const std::vector<Vec3d> line{around(), around()};
      const double radius = size * Uniform(random, 0.1, 0.5);
      return TubeCase("capsule", TubeRegion(line, radius), line, radius);
    }
    default: {
      std::vector<Vec3d> line{around()};
      const int points = 2 + static_cast<int>(random() % 12);
      while (static_cast<int>(line.size()) < points) {
        line.push_back(line.back() + Direction(random) * (0.3 * size));
      }
      const double radius = size * Uniform(random, 0.02, 0.4);
      return TubeCase("tube", TubeRegion(line, radius), line, radius);
    }
  }
}

RegionCase RandomCombination(const Box3d& where, std::mt19937& random) {
  const auto one = [&] {
    return RandomRegion(static_cast<int>(random() % kRegionKinds), where, random);
  };
  const auto convex = [&] {
    static constexpr int kConvex[] = {0, 2, 3, 5, 6};
    return RandomRegion(kConvex[random() % std::size(kConvex)], where, random);
  };
  const auto nothing = [](Vec3d) { return 0.0; };
  RegionCase result;
  switch (random() % 4) {
    case 0: {
      const RegionCase a = one();
      const RegionCase b = one();
      result = {"union", UnionRegion({a.region, b.region}),
                [=](Vec3d p) { return std::min(a.distance(p), b.distance(p)); }, nothing};
      result.covers_is_exact = false;
      break;
    }
    case 1: {
      const RegionCase a = one();
      const RegionCase b = one();
      result = {"intersection", IntersectionRegion({a.region, b.region}),
                [=](Vec3d p) { return a.Contains(p) && b.Contains(p) ? 0.0 : 1.0; },
                [=](Vec3d p) { return std::min(a.depth(p), b.depth(p)); }};
      result.within_is_exact = false;
      result.covers_is_exact = a.covers_is_exact && b.covers_is_exact;
      break;
    }
    case 2: {
      const RegionCase a = convex();
      const RegionCase b = convex();
      result = {"intersection of convex ones", IntersectionRegion({a.region, b.region}),
                [=](Vec3d p) { return a.Contains(p) && b.Contains(p) ? 0.0 : 1.0; },
                [=](Vec3d p) { return std::min(a.depth(p), b.depth(p)); }};
      result.within_is_exact = false;  // this oracle does not know how far it is
      break;
    }
    default: {
      const RegionCase a = one();
      result = {"complement", ComplementRegion(a.region), a.depth, a.distance};
      result.within_is_exact = a.covers_is_exact;
      result.covers_is_exact = a.within_is_exact;
    }
  }
  return result;
}

RegionCase AnyRegion(const Box3d& where, std::mt19937& random) {
  return random() % 3 == 0 ? RandomCombination(where, random)
                           : RandomRegion(static_cast<int>(random() % kRegionKinds), where, random);
}

}  // namespace mtdb::testing
