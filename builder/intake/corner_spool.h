// SPDX-License-Identifier: Apache-2.0
// CornerSpool: the texture coordinates of triangles' corners, on disk, in the triangles' order.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "builder/disk/spool.h"
#include "store/base/attribute_grid.h"
#include "store/base/coordinate_limit.h"
#include "store/base/status.h"
#include "store/base/texture.h"

namespace mtdb::internal {

using TriangleCorners = std::array<TextureCorner, 3>;

// Takes corners in, and rounds them to a step when they are read. Triangles that are dropped later
// are dropped here, too.
class CornerSpool {
 public:
  CornerSpool() = default;
  // `pages`: how many there are. `step` 0: u and v stay as they are.
  CornerSpool(const SpoolSpace* space, size_t memory_bytes, double step, size_t pages)
      : space_(space), memory_bytes_(memory_bytes), step_(step), pages_(pages) {
    spool_ = Spool(space, memory_bytes);
  }

  // `triangle`: its number in the input, for messages. kBadInput: it is not what a corner may be.
  Status Add(TriangleCorners corners, uint64_t triangle) {
    for (TextureCorner& corner : corners) {
      const auto refuse = [&](const std::string& what) {
        return BadInput("triangle " + std::to_string(triangle) + ": " + what);
      };
      if (corner.page != corners[0].page) return refuse("its corners are on different pages");
      if (corner.page >= pages_ && corner.page != TextureCorner::kNoPage) {
        return refuse("page " + std::to_string(corner.page) + " of " + std::to_string(pages_));
      }
      if (corner.page == TextureCorner::kNoPage) corner.u = corner.v = 0;
      if (!(std::abs(corner.u) <= kMostTextureCoordinate &&
            std::abs(corner.v) <= kMostTextureCoordinate)) {
        return refuse("texture coordinates are not numbers from -2^24 to 2^24");
      }
      // -0 is 0: corners are compared by their bytes.
      corner.u += 0.0f;
      corner.v += 0.0f;
      largest_ = std::max({largest_, std::abs(corner.u), std::abs(corner.v)});
    }
    return spool_.Append(corners.data(), sizeof(corners));
  }
  // Where coordinates are too many steps from 0 the step grows, unless it was `given`.
  Status Finish(bool given) {
    const double codes = static_cast<double>(MaxScalarCode(ScalarType::kFloat32));
    if (given && step_ > 0 && largest_ / step_ > codes) {
      return BadInput("texture coordinates up to " + std::to_string(largest_) +
                      " are too many steps from 0; choose a larger --texture-step, or 0 to keep "
                      "them as they are");
    }
    while (step_ > 0 && largest_ / step_ > codes) step_ *= 2;
    return spool_.Finish();
  }
  double step() const { return step_; }
  // What is read from the spool, rounded to the step.
  void Round(TriangleCorners& corners) const {
    if (step_ == 0) return;
    for (TextureCorner& corner : corners) {
      corner.u = Float32OfCode(ScalarCode(corner.u, step_), step_) + 0.0f;
      corner.v = Float32OfCode(ScalarCode(corner.v, step_), step_) + 0.0f;
    }
  }
  uint64_t triangles() const { return spool_.size() / sizeof(TriangleCorners); }
  // The farthest that rounding moves (u, v).
  double rounding() const { return step_ * 0.7072; }
  const Spool& spool() const { return spool_; }

  // Begins to change what is there: Keep() for each triangle, in their order, then EndKeeping().
  void BeginKeeping() {
    old_ = std::exchange(spool_, Spool(space_, memory_bytes_));
    reader_.emplace(&*old_);
  }
  // `turned`: the triangle was turned over, which exchanges its last two corners.
  Status Keep(bool stays, bool turned = false) {
    TriangleCorners corners;
    if (!reader_->Get(&corners)) return reader_->status();
    if (turned) std::swap(corners[1], corners[2]);
    return stays ? spool_.Append(corners.data(), sizeof(corners)) : Status::Ok();
  }
  Status EndKeeping() {
    reader_.reset();
    old_.reset();
    return spool_.Finish();
  }
  // Instead of all of that: all stay.
  void KeepAll() {
    if (!old_) return;
    reader_.reset();
    spool_ = *std::exchange(old_, std::nullopt);
  }

 private:
  const SpoolSpace* space_ = nullptr;
  size_t memory_bytes_ = 0;
  double step_ = 0;
  size_t pages_ = 0;
  float largest_ = 0;
  Spool spool_{nullptr, 0};
  std::optional<Spool> old_;
  std::optional<SpoolReader> reader_;
};

}  // namespace mtdb::internal
