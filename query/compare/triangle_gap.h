// SPDX-License-Identifier: Apache-2.0
// TriangleGap: the largest distance of the points of a triangle from many others, from both sides.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "query/compare/doubt.h"
#include "query/compare/goals.h"
#include "query/compare/triangle_tree.h"
#include "store/base/geometry.h"

namespace mtdb::internal {

// What the triangles of a cut are asked. What it points to outlives it.
struct GapQuestion {
  const TriangleTree* tree = nullptr;  // of the other surface's cut
  Asking asking;
  double answer_bound = 0;  // of that cut
  // The tree has all triangles that are so near to a point that asks: what is farther away is
  // unknown.
  double known = 0;
  // What is proved already of all that ask.
  double high = 0;
  double accuracy = 0;    // parts whose distance is known so well are not cut again
  double resolution = 0;  // nor are those that are so small, where they exceed the tolerance
  size_t most_parts = 0;  // of one triangle
};

// Of a part of a triangle, rounded outwards and the bounds of both cuts included.
struct GapPart {
  Box3d box;                  // around it, and what it stands for
  DistanceInterval distance;  // of the farthest point
  Vec3d point;                // at distance.low
};

// What a triangle answered.
struct GapAnswer {
  double met_high = 0;            // of the parts that met the goals
  std::vector<GapPart> doubts;    // the others
  std::vector<GapPart> excesses;  // that exceed the tolerance
};

// A part of the triangle is compared with one triangle of the tree at a time: the distance from
// this one is a convex function, so that it is largest at a corner of the part. The part that lies
// above or below of it is cut out and stays with it; the rest is asked which triangle is its own.
// Branch and bound by upper and lower limits of parts is that of Tang, Lee, Kim, "Interactive
// Hausdorff distance computation for general polygonal models" (2009), and of Bartoň, Hanniel,
// Elber, Kim, "Precise Hausdorff distance computation between polygonal meshes" (2010); to cut by
// the other surface's triangles, instead of in halves only, is ours. One thread.
class TriangleGap {
 public:
  TriangleGap(const GapQuestion& question, Goals* goals) : question_(question), goals_(goals) {}

  GapAnswer Find(const Triangle3d& t);

 private:
  struct Part {
    Triangle3d corners;
    uint32_t other = 0;  // a triangle of the tree
    bool home = false;   // which is the nearest for some of it, as far as is known
    double high = 0;     // of its distance
    size_t cuts = 0;     // that led to it
    bool operator<(const Part& other_part) const { return high < other_part.high; }
  };

  double High(const Triangle3d& corners, uint32_t other) const;
  double TotalHigh(double high) const;
  double TotalLow(double low) const;
  // Looks at the tree from one point of the part. True when the part need not be cut.
  bool Settle(Part& part, GapAnswer* answer);
  // Whether all of the part, `point` of which is so far away, exceeds the tolerance, or it is
  // small.
  bool IsPlace(const Part& part, Vec3d point, double low) const;
  void Leave(const Part& part, double low, Vec3d point, GapAnswer* answer) const;
  void Push(Part part);
  Part Pop();
  void Cut(const Part& part);
  bool CutAtHome(const Part& part);
  void Halve(const Part& part);

  const GapQuestion& question_;
  Goals* const goals_;
  uint32_t hint_ = 0;
  std::vector<Part> parts_;  // a heap: the largest gap first
};

}  // namespace mtdb::internal
