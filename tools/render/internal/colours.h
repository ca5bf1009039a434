// SPDX-License-Identifier: Apache-2.0
// What colour each place of a mesh has.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "tools/render/internal/scene.h"
#include "tools/render/render.h"

namespace mtdb::internal {

// The colours that options ask for. Both meshes and the scenes must outlive it. Safe for many
// threads once it is loaded.
class Colours {
 public:
  explicit Colours(const Scene& scene) : scene_(scene) {}
  // Errors: kInvalidArgument, and those of the reference's scene.
  Status Load(const TriangleMesh& mesh, const RenderOptions& options);

  // Colours stand for values: light must not change their hue.
  bool plain() const { return by_ >= ColourBy::kNormal && by_ != ColourBy::kHeight; }
  ColourBy by() const { return by_; }
  bool vertex_colours() const { return !colours_.empty(); }
  const std::optional<std::array<double, 2>>& range() const { return range_; }
  void set_range(std::array<double, 2> range) { range_ = range; }

  // Of light, linear, where plain() is false.
  Vec3f Albedo(const Hit& hit) const;
  // kAttribute and kDistance: the value at a hit, in its own units.
  double Value(const Hit& hit, Vec3f at) const;
  // kHeight: of a hit.
  double Height(const Hit& hit) const;
  // Where values are colours; values that are not finite are grey.
  Rgb OfValue(double value) const;

 private:
  Status LoadAttribute(const TriangleMesh& mesh, const std::string& name);
  void LoadHeights();
  void LoadVertexColours(const TriangleMesh& mesh);

  const Scene& scene_;
  ColourBy by_ = ColourBy::kNothing;
  std::vector<Vec3f> colours_;  // linear
  std::vector<double> values_;
  Scene reference_;
  std::optional<std::array<double, 2>> range_;
  double height_scale_ = 1;
};

}  // namespace mtdb::internal
