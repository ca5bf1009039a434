// SPDX-License-Identifier: Apache-2.0
#include "builder/tiles/round_level.h"

#include <algorithm>
#include <cmath>

#include "store/base/hash.h"
#include "store/base/hilbert.h"

namespace mtdb::internal {

namespace {
// docs/notes/2026-11-levels-of-rounds.md has the measurements behind these.
constexpr double kFirstLevel = 3.3;          // of the sample's upper quartile of first guesses
constexpr double kGrowth = 0.93;             // the error grows like this power of 1 / triangles
constexpr uint64_t kCellTriangles = 1000;    // of a cell of the sample, about
constexpr double kLeastLevel = 1.0 / 65536;  // of the largest error that removals may have
}  // namespace

RoundLevel::RoundLevel(uint64_t triangles, uint32_t reduction, uint32_t degree_limit)
    : reduction_(reduction), degree_limit_(degree_limit), wanted_(static_cast<double>(triangles)) {
  // The mesh takes half of the curve's cube (RoundCurve), and a cell of level l, 2^-l of its side,
  // some 4^-l of a surface.
  int level = 1;
  while (level < kHilbertBits && triangles >> (2 * level) > kCellTriangles) ++level;
  cell_shift_ = 3 * (kHilbertBits - level);
  chosen_ =
      triangles <= kSampleTriangles ? ~uint64_t{0} : ~uint64_t{0} / triangles * kSampleTriangles;
}

void RoundLevel::Sample(const TileTriangle& triangle, uint64_t code) {
  if (sample_.size() < 2 * kSampleTriangles && Mix64(code >> cell_shift_) <= chosen_) {
    sample_.push_back(triangle);
  }
}

void RoundLevel::Begin(TileDecimator& decimator, const Grid& grid, double largest_error) {
  largest_error_ = largest_error;
  error_ = kLeastLevel * largest_error;
  std::vector<double> guesses = decimator.FirstGuesses(sample_, grid);
  std::vector<TileTriangle>().swap(sample_);
  if (!guesses.empty()) {
    const auto quartile = guesses.begin() + static_cast<std::ptrdiff_t>(guesses.size() * 3 / 4);
    std::nth_element(guesses.begin(), quartile, guesses.end());
    error_ = std::max(error_, kFirstLevel * *quartile);
  }
  wanted_ /= reduction_;
}

void RoundLevel::Next(uint64_t left, bool hindered) {
  if (hindered && static_cast<double>(left) > wanted_ * std::sqrt(reduction_)) return;
  wanted_ /= reduction_;
  const double ratio = std::clamp(static_cast<double>(left) / wanted_, std::sqrt(reduction_),
                                  reduction_ * reduction_);
  error_ = std::min(largest_error_, error_ * std::pow(ratio, kGrowth));
}

double RoundLevel::MostLeft(double reduction) { return 1 / std::sqrt(reduction); }

RemovalLimits RoundLevel::Limits(size_t tile_triangles, bool alone) const {
  const auto triangles = static_cast<double>(tile_triangles);
  RemovalLimits limits;
  limits.largest_error = largest_error_;
  limits.degree_limit = degree_limit_;
  limits.crumb_error = error_;
  if (alone) {
    limits.target_triangles = static_cast<uint32_t>(triangles / reduction_);
  } else {
    limits.target_triangles = static_cast<uint32_t>(triangles / (reduction_ * reduction_));
    limits.level_error = error_;
    limits.level_triangles = static_cast<uint32_t>(triangles * MostLeft(reduction_));
  }
  return limits;
}

}  // namespace mtdb::internal
