// SPDX-License-Identifier: Apache-2.0
#include "query/terrain/cell_change.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "query/compare/box_tree.h"
#include "query/terrain/linear_integral.h"

namespace mtdb::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// By what part of all lengths that enter a corner of an overlay may be moved by rounding.
constexpr double kMoved = 0x1p-46;

// Seen from above.
Box3d PlaneBox(std::span<const Vec3d> corners) {
  Box3d box;
  for (const Vec3d& p : corners) box.Add(Vec3d{p.x, p.y, 0});
  return box;
}

bool Meet(const Box3d& a, const Box3d& b) {
  return a.min.x <= b.max.x && b.min.x <= a.max.x && a.min.y <= b.max.y && b.min.y <= a.max.y;
}

// Coordinates along x and y are those within the window, so that they are small.
class CellMeter {
 public:
  CellMeter(const PlaneWindow& window, const TerrainPatch& a, const TerrainPatch& b)
      : window_{0, 0, window.max_x - window.min_x, window.max_y - window.min_y},
        origin_{window.min_x, window.min_y, 0},
        a_(a),
        b_(b),
        error_(a.error + b.error) {
    cell_.window = window;
    cell_.triangles = a.triangles.size() + b.triangles.size();
    cell_.rise = cell_.fall = {-kInfinity, -kInfinity, {}};
  }

  CellChange Measure() {
    std::vector<PlaneTriangle> others;
    std::vector<Box3d> boxes;
    for (const Triangle3d& t : b_.triangles) {
      others.emplace_back(Moved(t));
      boxes.push_back(PlaneBox(others.back().corners()));
      area_b_ += PartArea(others.back());
    }
    const BoxTree tree(boxes);
    for (const Triangle3d& t : a_.triangles) {
      const PlaneTriangle own(Moved(t));
      PlanePolygon part(own);
      part.ClipTo(window_);
      if (part.empty()) continue;
      AddArea(own, part.area(), &area_a_);
      const Box3d around = PlaneBox(part.corners());
      const auto meets = [&](const Box3d& box) { return Meet(box, around); };
      tree.Any(meets, [&](uint32_t place) {
        const uint32_t i = tree.order()[place];
        if (meets(boxes[i])) AddPair(own, part, others[i]);
        return false;
      });
    }
    Close();
    return cell_;
  }

 private:
  Triangle3d Moved(const Triangle3d& t) const {
    return {t[0] - origin_, t[1] - origin_, t[2] - origin_};
  }
  double Extent() const { return window_.max_x + window_.max_y; }
  static double Around(const PlaneTriangle& t) {
    const Box3d box = PlaneBox(t.corners());
    return box.max.x - box.min.x + box.max.y - box.min.y;
  }
  void AddArea(const PlaneTriangle& t, double area, double* sum) {
    *sum += area;
    area_slack_ += kMoved * (Extent() + Around(t)) * 2 * Around(t);
  }
  double PartArea(const PlaneTriangle& t) {
    PlanePolygon part(t);
    part.ClipTo(window_);
    double area = 0;
    if (!part.empty()) AddArea(t, part.area(), &area);
    return area;
  }

  // `part` is that of `own` within the window.
  void AddPair(const PlaneTriangle& own, PlanePolygon part, const PlaneTriangle& other) {
    part.ClipTo(other);
    if (part.empty()) return;
    const double around = 2 * std::min(Around(own), Around(other));
    const double moved = kMoved * (Extent() + Around(own) + Around(other));
    const std::span<const Vec3d> corners = part.corners();
    std::array<double, 16> change{};
    double largest = 0, height_slack = 0;
    for (size_t i = 0; i < corners.size(); ++i) {
      const double from = own.HeightAt(corners[i].x, corners[i].y);
      const double to = other.HeightAt(corners[i].x, corners[i].y);
      const double slack = own.HeightSlack(moved) + other.HeightSlack(moved) +
                           0x1p-50 * (std::abs(from) + std::abs(to));
      change[i] = to - from;
      largest = std::max(largest, std::abs(change[i]) + slack);
      const Vec3d at{corners[i].x + origin_.x, corners[i].y + origin_.y, to};
      Raise(change[i], slack + error_, at, &cell_.rise);
      Raise(-change[i], slack + error_, at, &cell_.fall);
      height_slack = std::max(height_slack, slack);
    }
    double area = 0;
    for (size_t i = 2; i < corners.size(); ++i) {
      area += AddTriangle({corners[0], corners[i - 1], corners[i]},
                          {change[0], change[i - 1], change[i]});
    }
    both_ += area;
    both_slack_ += moved * around;
    volume_slack_ += moved * around * (largest + error_) + height_slack * area;
  }
  double AddTriangle(const Triangle3d& t, const std::array<double, 3>& change) {
    const double area = std::max(
        0.0, ((t[1].x - t[0].x) * (t[2].y - t[0].y) - (t[1].y - t[0].y) * (t[2].x - t[0].x)) / 2);
    const auto plus = [&](double by, double sign) {
      return PositivePart({sign * change[0] + by, sign * change[1] + by, sign * change[2] + by},
                          area);
    };
    cell_.fill.low += plus(-error_, 1);
    cell_.fill.high += plus(error_, 1);
    cell_.cut.low += plus(-error_, -1);
    cell_.cut.high += plus(error_, -1);
    net_ += area * (change[0] + change[1] + change[2]) / 3;
    return area;
  }
  static void Raise(double change, double slack, Vec3d at, CellExtreme* extreme) {
    extreme->high = std::max(extreme->high, change + slack);
    if (change - slack <= extreme->low) return;
    extreme->low = change - slack;
    extreme->point = at;
  }

  // Sums become intervals.
  void Close() {
    const double whole = window_.area();
    const auto around = [](double value, double slack) {
      return ValueInterval{std::max(0.0, value - slack), value + slack};
    };
    const double slack = both_slack_ + 0x1p-44 * both_;
    const double area_slack = area_slack_ + slack + 0x1p-44 * (area_a_ + area_b_);
    cell_.area_both = around(both_, slack);
    const auto widen = [&](ValueInterval* v) {
      v->low = std::max(0.0, v->low * (1 - 0x1p-44) - volume_slack_);
      v->high = v->high * (1 + 0x1p-44) + volume_slack_;
    };
    const double net_slack =
        error_ * (both_ + slack) + volume_slack_ + 0x1p-44 * (cell_.fill.high + cell_.cut.high);
    cell_.net = {net_ - net_slack, net_ + net_slack};
    widen(&cell_.fill);
    widen(&cell_.cut);
    cell_.common = both_ > 0 || cell_.rise.high > -kInfinity;
    const double more_a = a_.may_cover_more ? std::max(0.0, whole - area_a_) + area_slack : 0;
    const double more_b = b_.may_cover_more ? std::max(0.0, whole - area_b_) + area_slack : 0;
    cell_.area_a = around(area_a_ - both_, area_slack);
    cell_.area_b = around(area_b_ - both_, area_slack);
    if (more_a + more_b == 0 || a_.triangles.empty() || b_.triangles.empty()) {
      cell_.area_a.high += more_a;
      cell_.area_b.high += more_b;
      return;
    }
    AddDoubt(more_a, more_b, std::min(more_a + more_b, whole));
  }

  // Both may be where one of the cuts is not, on an area of up to `more`.
  void AddDoubt(double more_a, double more_b, double more) {
    const double highest = b_.largest_height - a_.least_height;
    const double lowest = b_.least_height - a_.largest_height;
    cell_.common = true;
    cell_.rise.high = std::max(cell_.rise.high, highest);
    cell_.fall.high = std::max(cell_.fall.high, -lowest);
    cell_.fill.high += more * std::max(0.0, highest);
    cell_.cut.high += more * std::max(0.0, -lowest);
    cell_.net.low += more * std::min(0.0, lowest);
    cell_.net.high += more * std::max(0.0, highest);
    cell_.area_both.high += more;
    cell_.area_a = {std::max(0.0, cell_.area_a.low - more), cell_.area_a.high + more_a};
    cell_.area_b = {std::max(0.0, cell_.area_b.low - more), cell_.area_b.high + more_b};
  }

  const PlaneWindow window_;
  const Vec3d origin_;
  const TerrainPatch &a_, &b_;
  const double error_;
  CellChange cell_;
  double area_a_ = 0, area_b_ = 0, both_ = 0, net_ = 0;
  double area_slack_ = 0, both_slack_ = 0, volume_slack_ = 0;
};

}  // namespace

CellChange MeasureCell(const PlaneWindow& window, const TerrainPatch& a, const TerrainPatch& b) {
  return CellMeter(window, a, b).Measure();
}

}  // namespace mtdb::internal
