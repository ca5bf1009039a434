// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/internal/sculpture_field.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/generate/noise.h"

namespace mtdb::internal {
namespace {

// The coarsest octave's wavelength and amplitude, and the factor from octave to octave: a little
// above 1/2, so that slopes stay about the same at all scales.
constexpr double kWavelength = 0.70;
constexpr float kAmplitude = 0.078f;
constexpr float kGain = 0.55f;
constexpr double kFinestWavelengthCells = 3.0;
// A weight never falls below this: where coarse noise is low the stone is smoother.
constexpr float kLeastWeight = 0.45f;
// A bound of the speed at which the foot of a point moves with the point, near the surface.
constexpr float kFootLipschitz = 1.8f;
// Octaves are independent: their sum is bounded by so many standard deviations. The walker notices
// when a bound is broken.
constexpr float kSlopeDeviation = 0.7f;  // of the noise, along a line
constexpr float kSafeDeviations = 8;
// The largest curvature of the undisplaced surface.
constexpr double kBaseCurvature = 12;
// Radius of the smooth union.
constexpr float kBlend = 0.24f;

struct Ring {
  float cx, cy, cz;  // centre
  float nx, ny, nz;  // axis, unit length
  float major, minor;
};

constexpr Ring kRings[] = {
    {0.00f, 0.00f, -0.30f, 0.16f, 0.96f, -0.2298f, 0.66f, 0.25f},
    {0.26f, 0.06f, 0.80f, 0.60f, -0.7642f, 0.2366f, 0.46f, 0.19f},
    {-0.62f, -0.10f, 0.60f, 0.36f, 0.80f, 0.48f, 0.42f, 0.18f},
    {0.10f, 0.02f, -1.04f, 0.10f, 0.05f, 0.99373f, 0.56f, 0.22f},
};

// The value of the smooth union and its gradient, at four points.
struct Base {
  Float4 value, gx, gy, gz;
};

inline Base RingDistance(const Ring& r, Float4 x, Float4 y, Float4 z) {
  const Float4 dx = x - r.cx, dy = y - r.cy, dz = z - r.cz;
  const Float4 along = dx * r.nx + dy * r.ny + dz * r.nz;
  const Float4 ex = dx - along * r.nx, ey = dy - along * r.ny, ez = dz - along * r.nz;
  const Float4 radial = Sqrt4(ex * ex + ey * ey + ez * ez) + 1e-6f;
  const Float4 out = radial - r.major;
  const Float4 distance = Sqrt4(out * out + along * along) + 1e-6f;
  const Float4 to_ring = out / (distance * radial), to_axis = along / distance;
  return {distance - r.minor, ex * to_ring + r.nx * to_axis, ey * to_ring + r.ny * to_axis,
          ez * to_ring + r.nz * to_axis};
}

// The polynomial smooth minimum. Its gradient is a convex combination of the two: the union keeps
// the Lipschitz constant 1 of exact distances.
inline Base SmoothUnion(const Base& a, const Base& b) {
  const Float4 difference = a.value - b.value;
  const Float4 h = Max4(kBlend - Abs4(difference), Float4{}) * (0.5f / kBlend);
  const Float4 share_a = difference < 0.0f ? 1.0f - h : h;
  const Float4 share_b = 1.0f - share_a;
  return {Min4(a.value, b.value) - h * h * kBlend, a.gx * share_a + b.gx * share_b,
          a.gy * share_a + b.gy * share_b, a.gz * share_a + b.gz * share_b};
}

}  // namespace

SculptureField::SculptureField(uint64_t seed, double cell_size) {
  float amplitude = kAmplitude;
  double finest_ratio = kWavelength / (kFinestWavelengthCells * cell_size);
  for (size_t k = 0; k < kMaxOctaves && finest_ratio > 1; ++k, finest_ratio *= 0.5) {
    Octave o;
    o.amplitude = amplitude * static_cast<float>(std::min(1.0, finest_ratio - 1));
    o.ridge = k == 0 ? 0.0f : k < 4 ? 0.7f : 0.35f;
    o.seed = StreamSeed(seed, k);
    o.wavelength = std::ldexp(kWavelength, -static_cast<int>(k));
    for (int i = 0; i < 3; ++i) {
      o.offset[i] = 16 * UnitFloat(StreamSeed(seed, 1000 + 4 * k + static_cast<uint64_t>(i)));
    }
    octaves_.push_back(o);
    amplitude *= kGain;
  }
  float slope_bound = 0, slope_variance = 0;
  const auto lipschitz = [&] {
    return 1 + std::min(slope_bound, kSafeDeviations * std::sqrt(slope_variance));
  };
  for (Octave& o : octaves_) {
    o.lipschitz = lipschitz();
    // The weight, a clamped function of the octave before, changes at up to half its frequency.
    const float steepness =
        kFootLipschitz * o.amplitude * (1 + o.ridge + 0.6f) / static_cast<float>(o.wavelength);
    slope_bound += steepness * kNoise3Lipschitz;
    slope_variance += steepness * steepness * kSlopeDeviation * kSlopeDeviation;
  }
  lipschitz_after_last_ = lipschitz();
  float rest = 0;
  for (size_t k = octaves_.size(); k-- > 0;) {
    rest += octaves_[k].amplitude * kNoise3Bound;
    octaves_[k].rest = rest;
  }
}

Box3d SculptureField::Bounds() {
  Box3d box;
  for (const Ring& r : kRings) {
    const float n[3] = {r.nx, r.ny, r.nz}, c[3] = {r.cx, r.cy, r.cz};
    Vec3d low, high;
    for (int i = 0; i < 3; ++i) {
      const double reach = r.major * std::sqrt(std::max(0.0, 1.0 - n[i] * n[i])) + r.minor +
                           kBlend / 4 + kAmplitude * kNoise3Bound / (1 - kGain);
      low[i] = c[i] - reach;
      high[i] = c[i] + reach;
    }
    box.Add(low);
    box.Add(high);
  }
  return box;
}

void SculptureField::EvaluateSigns(double margin, FieldBatch* batch) {
  for (size_t k = 0; k < octaves_.size(); ++k) {
    give_up_[k] = octaves_[k].rest + static_cast<float>(margin);
  }
  Evaluate(batch);
}

void SculptureField::EvaluateAll(FieldBatch* batch) {
  give_up_.fill(std::numeric_limits<float>::infinity());
  Evaluate(batch);
}

void SculptureField::EvaluateNearness(double radius, FieldBatch* batch) {
  const auto r = static_cast<float>(radius);
  // The bound on the foot's speed holds near the surface only.
  const bool use_octaves = radius < 0.04;
  for (size_t k = 0; k < octaves_.size(); ++k) {
    give_up_[k] = k == 0 || use_octaves ? octaves_[k].rest + octaves_[k].lipschitz * r
                                        : std::numeric_limits<float>::infinity();
  }
  Evaluate(batch);
  if (!use_octaves) return;
  for (size_t i = 0; i < batch->size(); ++i) {
    if (std::abs(batch->value[i]) > lipschitz_after_last_ * r) batch->complete[i] = 0;
  }
}

double SculptureField::DeviationWithinCube(double edge) const {
  // Interpolation error: the second derivative times edge^2 / 8 along each axis; for octaves finer
  // than the cube their range.
  double squares = 0;
  for (const Octave& o : octaves_) {
    const double ratio = edge / o.wavelength;
    const double deviation = o.amplitude * std::min(1.5, 10 * ratio * ratio);
    squares += deviation * deviation;
  }
  return 1.5 * std::sqrt(squares) + kBaseCurvature * edge * edge / 8;
}

void SculptureField::Evaluate(FieldBatch* batch) {
  const size_t n = batch->size();
  batch->value.resize(n);
  batch->complete.assign(n, 1);
  if (place_.size() < n) {
    // Loops over groups of lanes may read and write past the last point.
    const size_t padded = n + kLanes;
    for (std::vector<float>* v : {&qx_, &qy_, &qz_, &value_, &weight_}) v->resize(padded);
    place_.resize(n);
  }
  for (size_t i = 0; i < n; ++i) place_[i] = static_cast<uint32_t>(i);
  EvaluateBase(*batch);
  size_t left = n;
  for (size_t k = 0; k < octaves_.size(); ++k) {
    left = Compact(left, give_up_[k], batch);
    AddOctave(octaves_[k], left);
  }
  for (size_t i = 0; i < left; ++i) batch->value[place_[i]] = value_[i];
}

MTDB_SIMD_CLONES void SculptureField::EvaluateBase(const FieldBatch& batch) {
  const size_t n = batch.size();
  std::copy(batch.x.begin(), batch.x.end(), qx_.begin());
  std::copy(batch.y.begin(), batch.y.end(), qy_.begin());
  std::copy(batch.z.begin(), batch.z.end(), qz_.begin());
  std::fill_n(weight_.begin(), n, 1.0f);
  constexpr auto kScale = static_cast<float>(1 / kWavelength);
  for (size_t i = 0; i < n; i += kLanes) {
    const Float4 x = Load4<Float4>(&qx_[i]), y = Load4<Float4>(&qy_[i]), z = Load4<Float4>(&qz_[i]);
    const Base ab = SmoothUnion(RingDistance(kRings[0], x, y, z), RingDistance(kRings[1], x, y, z));
    const Base cd = SmoothUnion(RingDistance(kRings[2], x, y, z), RingDistance(kRings[3], x, y, z));
    const Base base = SmoothUnion(ab, cd);
    const Float4 squared = base.gx * base.gx + base.gy * base.gy + base.gz * base.gz;
    const Float4 step = base.value / Max4(squared, Splat4(0.4f));
    Store4(&qx_[i], (x - step * base.gx) * kScale);
    Store4(&qy_[i], (y - step * base.gy) * kScale);
    Store4(&qz_[i], (z - step * base.gz) * kScale);
    Store4(&value_[i], base.value);
  }
}

MTDB_SIMD_CLONES void SculptureField::AddOctave(const Octave& octave, size_t count) {
  constexpr float kTwoThirds = 2.0f / 3.0f, kFourThirds = 4.0f / 3.0f;
  for (size_t i = 0; i < count; i += kLanes) {
    const Float4 x = Load4<Float4>(&qx_[i]), y = Load4<Float4>(&qy_[i]), z = Load4<Float4>(&qz_[i]);
    const Float4 noise = GradientNoise3(x + octave.offset[0], y + octave.offset[1],
                                        z + octave.offset[2], octave.seed);
    const Float4 ridged = 0.5f - 2.0f * Min4(Abs4(noise), Splat4(0.75f));
    const Float4 shaped = noise + octave.ridge * (ridged - noise);
    Store4(&value_[i],
           Load4<Float4>(&value_[i]) - octave.amplitude * Load4<Float4>(&weight_[i]) * shaped);
    Store4(&weight_[i], Min4(Max4(0.75f - 0.6f * noise, Splat4(kLeastWeight)), Splat4(1.0f)));
    // Twice the frequency, and a rotation (exact thirds), so that lattices of octaves never align.
    Store4(&qx_[i], kFourThirds * (x + z) - kTwoThirds * y);
    Store4(&qy_[i], kFourThirds * (x + y) - kTwoThirds * z);
    Store4(&qz_[i], kFourThirds * (y + z) - kTwoThirds * x);
  }
}

size_t SculptureField::Compact(size_t count, float give_up, FieldBatch* batch) {
  if (give_up == std::numeric_limits<float>::infinity()) return count;
  size_t kept = 0;
  for (size_t i = 0; i < count; ++i) {
    const bool keep = std::abs(value_[i]) <= give_up;
    if (!keep) {
      batch->value[place_[i]] = value_[i];
      batch->complete[place_[i]] = 0;
    }
    place_[kept] = place_[i];
    qx_[kept] = qx_[i];
    qy_[kept] = qy_[i];
    qz_[kept] = qz_[i];
    value_[kept] = value_[i];
    weight_[kept] = weight_[i];
    kept += keep;
  }
  return kept;
}

}  // namespace mtdb::internal
