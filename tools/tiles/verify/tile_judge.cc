// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/verify/tile_judge.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

#include "query/heights.h"
#include "query/probe.h"

namespace mtdb {

namespace {

constexpr size_t kMostFailures = 100;

}  // namespace

TileJudge::TileJudge(const Surface& surface, CheckReport* report)
    : surface_(surface), report_(*report), placement_(surface.record(), std::nullopt) {}

void TileJudge::Fail(const std::string& file, const std::string& what) {
  if (report_.failures.size() < kMostFailures) report_.failures.push_back(file + ": " + what);
}

bool TileJudge::HasEnough() const { return report_.failures.size() >= kMostFailures; }

void TileJudge::Judge(const std::string& name, double distance, double slack, double bound) {
  ++points_;
  if (bound > slack) largest_part_ = std::max(largest_part_, distance / bound);
  if (distance <= bound + slack) return;
  char line[160];
  std::snprintf(line, sizeof(line), "a point is %.9g off, but the tile states %.9g", distance,
                bound);
  Fail(name, line);
}

Status TileJudge::MeasureDistances(const std::string& name, const std::vector<Vec3d>& points,
                                   double unit, double bound) {
  const double slack = kJudgeSlack * Diagonal(record().bounds) * unit;
  for (const Vec3d& p : points) {
    MTDB_ASSIGN_OR_RETURN(const ProbeAnswer answer, FindClosestPoint(surface_, p));
    if (answer.hit) Judge(name, answer.hit->distance * unit, slack, bound);
  }
  return Status::Ok();
}

Status TileJudge::MeasureHeights(const std::string& name, const std::vector<Vec3d>& points,
                                 double bound, std::array<double, 2> near) {
  const double metres = placement_.metres();
  const double slack = kJudgeSlack * Diagonal(record().bounds) * metres;
  std::vector<std::array<double, 2>> places;
  places.reserve(points.size());
  for (const Vec3d& p : points) places.push_back({p.x, p.y});
  HeightCost cost;
  MTDB_ASSIGN_OR_RETURN(const std::vector<HeightAnswer> answers,
                        FindHeights(surface_, places, {}, &cost));
  for (size_t k = 0; k < points.size(); ++k) {
    const Vec3d& p = points[k];
    if (!answers[k].height) continue;
    double distance = std::abs(*answers[k].height - p.z);
    for (int i = 0; i < 9 && near[1] > 0 && distance * metres > bound; ++i) {
      MTDB_ASSIGN_OR_RETURN(const double beside,
                            HeightDistance(p, {(i % 3 - 1) * near[0], (i / 3 - 1) * near[1]}));
      distance = std::min(distance, beside);
    }
    Judge(name, distance * metres, slack, bound);
  }
  return Status::Ok();
}

Result<double> TileJudge::HeightDistance(Vec3d p, std::array<double, 2> beside) {
  HeightCost cost;
  MTDB_ASSIGN_OR_RETURN(const std::vector<HeightAnswer> answers,
                        FindHeights(surface_,
                                    std::vector<std::array<double, 2>>{
                                        {p.x, p.y}, {p.x + beside[0], p.y + beside[1]}},
                                    {}, &cost));
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const HeightAnswer& answer : answers) {
    if (!answer.height) continue;
    low = std::min(low, *answer.height);
    high = std::max(high, *answer.height);
  }
  if (low > high) return low;
  return std::max({low - p.z, p.z - high, 0.0});
}

void TileJudge::Conclude(const std::string& what) {
  report_.checks.push_back(std::to_string(tiles_) + " tiles " + what);
  char line[160];
  std::snprintf(line, sizeof(line),
                "%zu points of them are within what they state; the farthest at %.3f of it",
                points_, largest_part_);
  report_.checks.emplace_back(line);
}

}  // namespace mtdb
