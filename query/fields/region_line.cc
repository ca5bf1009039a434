// SPDX-License-Identifier: Apache-2.0
// Regions around lines and over polygons.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "query/fields/rounding.h"
#include "query/fields/segment_tree.h"
#include "query/fields/split.h"
#include "query/region.h"
#include "store/base/check.h"

namespace mtdb {

using namespace internal;

namespace {

using Segment = SegmentTree::Segment;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double Scale(const Box3d& box) {
  return std::max(LargestCoordinate(box.min), LargestCoordinate(box.max));
}

// The farthest that an end of a segment moves, and with it each of its points.
double LargestStep(const std::vector<Segment>& from, const std::vector<Segment>& to) {
  if (from.size() != to.size()) return kInfinity;
  double step = 0;
  for (size_t i = 0; i < from.size(); ++i) {
    for (size_t end = 0; end < 2; ++end) step = std::max(step, Length(to[i][end] - from[i][end]));
  }
  return step;
}

class Tube final : public SplittingRegion {
 public:
  Tube(std::vector<Segment> segments, double radius)
      : line_(segments),
        segments_(std::move(segments)),
        radius_(radius),
        scale_(std::max(Scale(segments_.bounds()), radius)) {}

  bool Within(const Triangle3d& t, double distance) const override {
    const double limit = radius_ + distance + Rounding(t, distance, scale_);
    return segments_.AnyNear(t, limit, [&](const Segment& s) {
      return SquaredDistanceSegmentTriangle(s[0], s[1], t) <= limit * limit;
    });
  }

  bool Covers(const Triangle3d& t, double distance) const override {
    const double limit = radius_ - distance - Rounding(t, distance, scale_);
    const auto covers = [&](const Triangle3d& part) { return AroundOne(part, limit); };
    return limit > 0 && HoldsForAll(t, covers, splits() ? kSplits : 0);
  }

  bool BoxWithin(const Box3d& box, double distance) const override {
    if (box.empty()) return false;
    const double limit = radius_ + distance + Rounding(box, distance, scale_);
    return segments_.AnyNear(box, limit, [&](const Segment& s) {
      return SquaredDistanceTriangleBox({s[0], s[1], s[1]}, box) <= limit * limit;
    });
  }

  bool BoxCovers(const Box3d& box, double distance) const override {
    const double limit = radius_ - distance - Rounding(box, distance, scale_);
    if (box.empty() || !(limit > 0)) return false;
    std::array<Vec3d, 8> corners;
    for (int i = 0; i < 8; ++i) corners[static_cast<size_t>(i)] = Corner(box, i);
    return AroundOne(corners, limit);
  }

  bool splits() const override { return segments_.size() > 1; }

  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const Tube*>(&to);
    if (other == nullptr || !(radius_ >= 0) || !(other->radius_ >= 0)) {
      return Region::Shift(to, within);
    }
    const double step = LargestStep(line_, other->line_) + std::abs(other->radius_ - radius_);
    if (step == 0) return 0;
    return step + 16 * Rounding(within, 0, std::max(scale_, other->scale_));
  }

 private:
  // Whether all corners are less than `limit` away from the same segment.
  template <typename Corners>
  bool AroundOne(const Corners& corners, double limit) const {
    return segments_.AnyNear(corners, limit, [&](const Segment& s) {
      return std::all_of(corners.begin(), corners.end(), [&](Vec3d p) {
        return SquaredDistancePointSegment(p, s[0], s[1]) < limit * limit;
      });
    });
  }

  const std::vector<Segment> line_;
  SegmentTree segments_;
  double radius_;
  double scale_;
};

// A triangle cut by horizontal planes.
struct Slice {
  std::array<Vec3d, 5> corners;
  size_t count = 0;

  explicit Slice(const Triangle3d& t) : corners{t[0], t[1], t[2]}, count(3) {}

  // Keeps what is at or above `z`; with side -1 what is at or below.
  void Cut(double z, double side) {
    std::array<Vec3d, 5> kept;
    size_t kept_count = 0;
    for (size_t i = 0; i < count; ++i) {
      const Vec3d a = corners[i];
      const Vec3d b = corners[(i + 1) % count];
      const bool a_in = (a.z - z) * side >= 0;
      const bool b_in = (b.z - z) * side >= 0;
      if (a_in) kept[kept_count++] = a;
      if (a_in == b_in) continue;
      Vec3d crossing = a + (b - a) * ((z - a.z) / (b.z - a.z));
      crossing.z = z;
      kept[kept_count++] = crossing;
    }
    corners = kept;
    count = kept_count;
  }
};

// The walls and lids of the prism are made of points over the polygon's edges and over its inside.
// So a triangle is cut where the lids' planes are: what is between them is near the prism when its
// shadow on the plane is near the polygon; what is above (below) when it is near the lid.
class Prism final : public Region {
 public:
  Prism(std::vector<Segment> edges, double min_z, double max_z)
      : polygon_(edges),
        edges_(std::move(edges)),
        min_z_(min_z),
        max_z_(max_z),
        scale_(Scale(edges_.bounds())) {
    for (const double z : {min_z, max_z}) {
      if (std::isfinite(z)) scale_ = std::max(scale_, std::abs(z));
    }
  }

  bool Within(const Triangle3d& t, double distance) const override {
    const double limit = distance + Rounding(t, distance, scale_);
    const Box3d around = Around(t);
    if (min_z_ > max_z_ || around.min.z > max_z_ + limit || around.max.z < min_z_ - limit) {
      return false;
    }
    Slice between(t);
    if (around.max.z > max_z_) {
      Slice above(t);
      above.Cut(max_z_, 1);
      for (Vec3d& p : above.corners) p.z -= max_z_;
      if (NearPolygon(above, limit)) return true;
      between.Cut(max_z_, -1);
    }
    if (around.min.z < min_z_) {
      Slice below(t);
      below.Cut(min_z_, -1);
      for (Vec3d& p : below.corners) p.z -= min_z_;
      if (NearPolygon(below, limit)) return true;
      between.Cut(min_z_, 1);
    }
    for (Vec3d& p : between.corners) p.z = 0;
    return NearPolygon(between, limit);
  }

  bool Covers(const Triangle3d& t, double distance) const override {
    const double limit = distance + Rounding(t, distance, scale_);
    const Box3d around = Around(t);
    if (!BetweenLids(around, limit) || !OverPolygon(t[0])) return false;
    const Triangle3d shadow = {Vec3d{t[0].x, t[0].y, 0}, Vec3d{t[1].x, t[1].y, 0},
                               Vec3d{t[2].x, t[2].y, 0}};
    return !edges_.AnyNear(shadow, limit, [&](const Segment& s) {
      return SquaredDistanceSegmentTriangle(s[0], s[1], shadow) <= limit * limit;
    });
  }

  bool BoxWithin(const Box3d& box, double distance) const override {
    if (box.empty() || min_z_ > max_z_) return false;
    const double limit = distance + Rounding(box, distance, scale_);
    if (box.min.z > max_z_ + limit || box.max.z < min_z_ - limit) return false;
    return OverPolygon(box.min) || NearEdge(Flat(box), limit);
  }

  bool BoxCovers(const Box3d& box, double distance) const override {
    if (box.empty()) return false;
    const double limit = distance + Rounding(box, distance, scale_);
    return BetweenLids(box, limit) && OverPolygon(box.min) && !NearEdge(Flat(box), limit);
  }

  // While its corners go straight, no border passes by what is farther from it than any corner
  // goes.
  double Shift(const Region& to, const Box3d& within) const override {
    const auto* const other = dynamic_cast<const Prism*>(&to);
    if (other == nullptr || min_z_ > max_z_ || other->min_z_ > other->max_z_) {
      return Region::Shift(to, within);
    }
    const auto lid = [](double from, double into) {
      return from == into ? 0 : std::abs(into - from);
    };
    const double step = std::max({LargestStep(polygon_, other->polygon_),
                                  lid(min_z_, other->min_z_), lid(max_z_, other->max_z_)});
    if (step == 0) return 0;
    return step + 16 * Rounding(within, 0, std::max(scale_, other->scale_));
  }

 private:
  static Box3d Flat(const Box3d& box) {
    return {{box.min.x, box.min.y, 0}, {box.max.x, box.max.y, 0}};
  }

  bool BetweenLids(const Box3d& box, double limit) const {
    return box.min.z - limit > min_z_ && box.max.z + limit < max_z_;
  }

  // By the number of edges that a ray along x crosses.
  bool OverPolygon(Vec3d p) const { return edges_.CrossesOdd(p); }

  // Of the polygon in the plane z = 0.
  bool NearPolygon(const Slice& slice, double limit) const {
    if (slice.count == 0) return false;
    Vec3d lowest = slice.corners[0];
    for (size_t i = 0; i < slice.count; ++i) {
      const Vec3d p = slice.corners[i];
      if (std::abs(p.z) < std::abs(lowest.z)) lowest = p;
    }
    // Where no edge is near, all that is near the plane is over the polygon or nothing is.
    if (std::abs(lowest.z) <= limit && OverPolygon(lowest)) return true;
    return edges_.AnyNear(
        std::span(slice.corners).first(slice.count), limit, [&](const Segment& s) {
          for (size_t i = 1; i < std::max<size_t>(slice.count, 2); ++i) {
            const Triangle3d part{slice.corners[0], slice.corners[std::min(i, slice.count - 1)],
                                  slice.corners[std::min(i + 1, slice.count - 1)]};
            if (SquaredDistanceSegmentTriangle(s[0], s[1], part) <= limit * limit) return true;
          }
          return false;
        });
  }

  bool NearEdge(const Box3d& flat, double limit) const {
    return edges_.AnyNear(flat, limit, [&](const Segment& s) {
      return SquaredDistanceTriangleBox({s[0], s[1], s[1]}, flat) <= limit * limit;
    });
  }

  const std::vector<Segment> polygon_;
  SegmentTree edges_;  // at z = 0
  double min_z_, max_z_;
  double scale_;
};

}  // namespace

RegionPtr PointRegion(Vec3d point) { return TubeRegion({point}, 0); }

RegionPtr SegmentRegion(Vec3d from, Vec3d to) { return TubeRegion({from, to}, 0); }

RegionPtr TubeRegion(const std::vector<Vec3d>& line, double radius) {
  MTDB_CHECK(!line.empty(), "a tube needs a line of at least one point");
  std::vector<Segment> segments;
  if (radius >= 0) {
    for (size_t i = 0; i == 0 || i + 1 < line.size(); ++i) {
      segments.push_back({line[i], line[std::min(i + 1, line.size() - 1)]});
    }
  }
  return std::make_shared<Tube>(std::move(segments), radius);
}

RegionPtr PrismRegion(const std::vector<std::array<double, 2>>& polygon, double min_z,
                      double max_z) {
  MTDB_CHECK(polygon.size() >= 3, "a polygon has at least 3 corners");
  std::vector<Segment> edges;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const auto& a = polygon[i];
    const auto& b = polygon[(i + 1) % polygon.size()];
    edges.push_back({Vec3d{a[0], a[1], 0}, Vec3d{b[0], b[1], 0}});
  }
  return std::make_shared<Prism>(std::move(edges), min_z, max_z);
}

}  // namespace mtdb
