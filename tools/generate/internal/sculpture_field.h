// SPDX-License-Identifier: Apache-2.0
// The implicit function of the sculpture: a smooth union of rings, displaced along its normals by
// many octaves of noise. Negative inside.
//
// The noise is read at the foot of a point on the undisplaced surface. So it hardly changes along a
// normal, the function grows along normals however rough the stone is, and islands do not split
// off, as they do where noise is added in space.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb::internal {

// Points and what is known of the function there.
struct FieldBatch {
  std::vector<float> x, y, z;
  // The function's value; for points that were given up early, a value of the right sign.
  std::vector<float> value;
  std::vector<uint8_t> complete;  // 1: all octaves went into the value

  void Clear() {
    x.clear();
    y.clear();
    z.clear();
  }
  void Add(Vec3d p) {
    x.push_back(static_cast<float>(p.x));
    y.push_back(static_cast<float>(p.y));
    z.push_back(static_cast<float>(p.z));
  }
  size_t size() const { return x.size(); }
};

// Deterministic: a point's value depends on the point, the seed and the cell size only, not on its
// batch. Not thread-safe (scratch space).
class SculptureField {
 public:
  // Octaves go down to features of some three cells. The finest fades in, so that the shape changes
  // continuously with the cell size; the coarser ones do not depend on it.
  SculptureField(uint64_t seed, double cell_size);

  // Holds the surface, with a margin.
  static Box3d Bounds();

  // Exact signs; exact values for points within `margin` of the surface.
  void EvaluateSigns(double margin, FieldBatch* batch);
  // Exact values.
  void EvaluateAll(FieldBatch* batch);
  // complete[i] = 1 when the surface may come within `radius` of point i.
  void EvaluateNearness(double radius, FieldBatch* batch);
  // The most by which the function differs, within a cube of this edge, from the range of its
  // values at the corners. This and EvaluateNearness take independent octaves to stay within six
  // to eight standard deviations of their sum; the walker checks that nothing was missed.
  double DeviationWithinCube(double edge) const;

 private:
  struct Octave {
    float amplitude = 0;
    float ridge = 0;      // share of the ridged variant, 0..1
    float rest = 0;       // the most that this and all later octaves can add
    float lipschitz = 0;  // of the function with all earlier octaves
    double wavelength = 0;
    float offset[3] = {};  // of the lattice
    uint32_t seed = 0;
  };
  static constexpr size_t kMaxOctaves = 24;

  // Gives a point up before octave k when |value| > give_up_[k].
  void Evaluate(FieldBatch* batch);
  void EvaluateBase(const FieldBatch& batch);
  void AddOctave(const Octave& octave, size_t count);
  // Moves the undecided points to the front; returns their number.
  size_t Compact(size_t count, float give_up, FieldBatch* batch);

  std::vector<Octave> octaves_;
  float lipschitz_after_last_ = 0;
  std::array<float, kMaxOctaves + 1> give_up_{};
  // Scratch, one element per undecided point: its place in the batch, its foot in the lattice of
  // the current octave, value, and the weight of the next octave.
  std::vector<uint32_t> place_;
  std::vector<float> qx_, qy_, qz_, value_, weight_;
};

}  // namespace mtdb::internal
