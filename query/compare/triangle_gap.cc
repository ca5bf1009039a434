// SPDX-License-Identifier: Apache-2.0
#include "query/compare/triangle_gap.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "query/compare/outward.h"
#include "query/fields/rounding.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMostCuts = 120;  // outward.h counts on it

Vec3d Middle(const Triangle3d& t) { return (t[0] + t[1] + t[2]) * (1.0 / 3); }

double Radius(const Triangle3d& t, Vec3d around) {
  return std::max({Length(t[0] - around), Length(t[1] - around), Length(t[2] - around)});
}

double LongestSide2(const Triangle3d& t) {
  return std::max(
      {SquaredLength(t[1] - t[0]), SquaredLength(t[2] - t[1]), SquaredLength(t[0] - t[2])});
}

// A convex polygon: a triangle that up to three planes have cut.
struct Polygon {
  std::array<Vec3d, 8> corners;
  size_t size = 0;
  void Add(Vec3d p) { corners[size++] = p; }
};

// Both parts of the polygon get the same new corners.
struct Halves {
  Polygon inside, outside;
};

Halves CutByPlane(const Polygon& polygon, Vec3d origin, Vec3d normal) {
  Halves halves;
  std::array<double, 8> heights{};
  double slack = 0;
  for (size_t i = 0; i < polygon.size; ++i) {
    heights[i] = Dot(polygon.corners[i] - origin, normal);
    slack = std::max(slack, std::abs(heights[i]));
  }
  // Slivers would be of no use.
  slack *= 1e-9;
  const auto [lowest, highest] =
      std::minmax_element(heights.begin(), heights.begin() + polygon.size);
  if (*highest <= slack) return {polygon, {}};
  if (*lowest >= -slack) return {{}, polygon};
  for (size_t i = 0; i < polygon.size; ++i) {
    const size_t next = i + 1 == polygon.size ? 0 : i + 1;
    const double h = heights[i], k = heights[next];
    if (h <= slack) halves.inside.Add(polygon.corners[i]);
    if (h >= -slack) halves.outside.Add(polygon.corners[i]);
    if ((h > slack && k < -slack) || (h < -slack && k > slack)) {
      const Vec3d p =
          polygon.corners[i] + (polygon.corners[next] - polygon.corners[i]) * (h / (h - k));
      halves.inside.Add(p);
      halves.outside.Add(p);
    }
  }
  return halves;
}

// Calls f(triangle) for a fan of triangles that make up the polygon.
template <typename F>
void ForEachTriangleOf(const Polygon& polygon, F&& f) {
  for (size_t i = 2; i < polygon.size; ++i) {
    f(Triangle3d{polygon.corners[0], polygon.corners[i - 1], polygon.corners[i]});
  }
}

}  // namespace

double TriangleGap::High(const Triangle3d& corners, uint32_t other) const {
  double high = 0;
  for (const Vec3d& p : corners) high = std::max(high, question_.tree->High(p, other));
  return high;
}

double TriangleGap::TotalHigh(double high) const {
  return std::min(question_.high, Up(high + question_.asking.bound + question_.answer_bound));
}

// The nearest point of the other surface has a counterpart in its cut within the bound of that, and
// so has what the asking point stands for.
double TriangleGap::TotalLow(double low) const {
  const double answer = std::min(low - question_.answer_bound, question_.known);
  const double total = answer - question_.asking.bound;
  return total > 0 ? total * (1 - 0x1p-48) : 0;
}

void TriangleGap::Push(Part part) {
  parts_.push_back(part);
  std::ranges::push_heap(parts_, std::less<>());
}

TriangleGap::Part TriangleGap::Pop() {
  std::ranges::pop_heap(parts_, std::less<>());
  const Part part = parts_.back();
  parts_.pop_back();
  return part;
}

GapAnswer TriangleGap::Find(const Triangle3d& t) {
  GapAnswer answer;
  Push({t, hint_, false, std::numeric_limits<double>::infinity(), 0});
  for (size_t left = question_.most_parts; !parts_.empty();) {
    Part part = Pop();
    const double high = TotalHigh(part.high);
    if (goals_->Met(0, high)) {
      answer.met_high = std::max(answer.met_high, high);
    } else if (!question_.asking.Meets(part.corners)) {
      continue;
    } else if (left == 0) {
      Leave(part, 0, part.corners[0], &answer);
    } else if (--left; !Settle(part, &answer)) {
      Cut(part);
    }
  }
  return answer;
}

// At home the corner that is farthest away from there says most; elsewhere the middle finds a home.
bool TriangleGap::Settle(Part& part, GapAnswer* answer) {
  Vec3d point = Middle(part.corners);
  if (part.home) {
    point = *std::ranges::max_element(part.corners, {},
                                      [&](Vec3d p) { return question_.tree->High(p, part.other); });
  }
  TriangleTree::Near near = question_.tree->Nearest(point, part.other);
  const double known = question_.known + question_.answer_bound;
  const bool blind = near.low >= known;
  near.low = std::min(near.low, known);
  if (!part.home || near.triangle != part.other) {
    part.high = std::min({part.high, High(part.corners, near.triangle),
                          Up(near.high + Radius(part.corners, point))});
    if (!part.home) part.other = hint_ = near.triangle;
  }
  const double low = question_.asking.Covers(point) ? TotalLow(near.low) : 0;
  if (low > 0) goals_->Raise(low, point);
  const bool enough =
      blind || part.high - near.low <= question_.accuracy || goals_->Met(low, TotalHigh(part.high));
  const bool placed = !goals_->Exceeds(low) || IsPlace(part, point, near.low);
  if (!(enough && placed) && part.cuts < kMostCuts) return false;
  Leave(part, low, point, answer);
  return true;
}

bool TriangleGap::IsPlace(const Part& part, Vec3d point, double low) const {
  const double radius = Radius(part.corners, point);
  return radius <= question_.resolution || goals_->Exceeds(TotalLow(low - radius));
}

void TriangleGap::Leave(const Part& part, double low, Vec3d point, GapAnswer* answer) const {
  const Box3d box = Grown(Around(part.corners), question_.asking.bound);
  const GapPart left{box, {low, TotalHigh(part.high)}, point};
  if (goals_->Exceeds(low)) answer->excesses.push_back(left);
  if (goals_->Met(low, left.distance.high)) {
    answer->met_high = std::max(answer->met_high, left.distance.high);
  } else {
    answer->doubts.push_back(left);
  }
}

// What is much larger than that triangle would lose little of itself to it.
void TriangleGap::Cut(const Part& part) {
  constexpr double kMuchLarger2 = 16;
  if (part.home || question_.tree->empty() ||
      LongestSide2(part.corners) >
          kMuchLarger2 * LongestSide2(question_.tree->triangle(part.other))) {
    Halve(part);
  } else if (!CutAtHome(part)) {
    // It is nearest to an edge or a corner of that triangle, perhaps all of it.
    Part again = part;
    again.home = true;
    Push(again);
  }
}

// False when nothing of the part is at home at its triangle.
bool TriangleGap::CutAtHome(const Part& part) {
  const Triangle3d& home = question_.tree->triangle(part.other);
  const Vec3d normal = Cross(home[1] - home[0], home[2] - home[0]);
  Polygon inside;
  for (const Vec3d& p : part.corners) inside.Add(p);
  std::array<Polygon, 3> outside;
  for (size_t i = 0; i < 3; ++i) {
    const Vec3d side = Cross(home[(i + 1) % 3] - home[i], normal);
    if (SquaredLength(side) == 0) return false;
    const Halves halves = CutByPlane(inside, home[i], side);
    inside = halves.inside;
    outside[i] = halves.outside;
    if (inside.size < 3) return false;
  }
  const size_t cuts = part.cuts + 3;
  ForEachTriangleOf(inside, [&](const Triangle3d& t) {
    Push({t, part.other, true, std::min(part.high, High(t, part.other)), cuts});
  });
  for (const Polygon& polygon : outside) {
    ForEachTriangleOf(polygon, [&](const Triangle3d& t) {
      Push({t, part.other, false, std::min(part.high, High(t, part.other)), cuts});
    });
  }
  return true;
}

void TriangleGap::Halve(const Part& part) {
  size_t longest = 0;
  double length2 = -1;
  for (size_t i = 0; i < 3; ++i) {
    const double l2 = SquaredLength(part.corners[(i + 1) % 3] - part.corners[i]);
    if (l2 > length2) {
      length2 = l2;
      longest = i;
    }
  }
  const Vec3d a = part.corners[longest], b = part.corners[(longest + 1) % 3];
  const Vec3d c = part.corners[(longest + 2) % 3], middle = (a + b) * 0.5;
  for (const Triangle3d& t : {Triangle3d{a, middle, c}, Triangle3d{middle, b, c}}) {
    Push({t, part.other, false, std::min(part.high, High(t, part.other)), part.cuts + 1});
  }
}

}  // namespace mtdb::internal
