// SPDX-License-Identifier: Apache-2.0
// Gradient noise and the integer hash under it: lattice gradients come from a hash of the lattice
// point, so that there is no table, no period and no state. After Perlin, "Improving Noise"
// (SIGGRAPH 2002); we replace his permutation table by a hash. Only + - * and integer operations:
// the same bits on every machine.
#pragma once

#include <bit>
#include <cstdint>

#include "store/base/float4.h"

// A function with this attribute is compiled twice on x86-64, and the processor's abilities choose
// when the program starts: the baseline lacks 32-bit multiplication and selection of lanes.
// Neither version fuses operations, so that results are the same. Clang does not take the attribute
// on the definition of a member; ThreadSanitizer is not awake yet when the choice is made.
#if defined(__x86_64__) && defined(__ELF__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define MTDB_SIMD_CLONES __attribute__((target_clones("sse4.1", "default")))
#else
#define MTDB_SIMD_CLONES
#endif

namespace mtdb {

inline constexpr int kLanes = 4;

// A bound of |GradientNoise3| and of the length of its gradient, over all choices of lattice
// gradients (maximised numerically over the cell and rounded up).
inline constexpr float kNoise3Bound = 1.04f;
inline constexpr float kNoise3Lipschitz = 4.0f;

// A well-mixed 64-bit hash (the finaliser of splitmix64).
constexpr uint64_t MixBits(uint64_t x) {
  x += 0x9e3779b97f4a7c15ull;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

// The seed of stream `stream` of a generator seeded with `seed`.
constexpr uint32_t StreamSeed(uint64_t seed, uint64_t stream) {
  return static_cast<uint32_t>(MixBits(MixBits(seed) + stream) >> 32);
}

// A number in [0, 1).
constexpr float UnitFloat(uint32_t bits) { return static_cast<float>(bits >> 8) * 0x1p-24f; }

namespace noise_internal {

inline constexpr uint32_t kPrimeX = 0x8da6b343u;
inline constexpr uint32_t kPrimeY = 0xd8163841u;
inline constexpr uint32_t kPrimeZ = 0xcb1ab31fu;

// The four top bits of a hash, of a number or of a vector of them.
template <typename T>
inline T Scramble(T h) {
  h *= 0x9e3779b1u;
  h ^= h >> 15;
  h *= 0x85ebca6bu;
  return h >> 28;
}

inline int32_t Floor(float x) {
  const auto i = static_cast<int32_t>(x);
  return i - static_cast<int32_t>(x < static_cast<float>(i));
}

template <typename T>
inline T Fade(T t) {
  return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f);
}
inline float FadeSlope(float t) { return 30.0f * t * t * (t * (t - 2.0f) + 1.0f); }
template <typename T>
inline T Lerp(T a, T b, T t) {
  return a + (b - a) * t;
}

// `value` with its sign flipped when `bit` (0 or 1) is set.
inline float FlipSign(float value, uint32_t bit) {
  return std::bit_cast<float>(std::bit_cast<uint32_t>(value) ^ (bit << 31));
}

// One of the twelve vectors from the centre of a cube to its edges, times (x, y, z).
[[gnu::always_inline]] inline Float4 DotGradient(Word4 h, Float4 x, Float4 y, Float4 z) {
  const Float4 u = h < 8u ? x : y;
  const Float4 v = h < 4u ? y : (h & 13u) == 12u ? x : z;
  return std::bit_cast<Float4>(std::bit_cast<Word4>(u) ^ (h << 31)) +
         std::bit_cast<Float4>(std::bit_cast<Word4>(v) ^ (h >> 1 << 31));
}

}  // namespace noise_internal

// Noise at four points (x, y, z), lattice spacing 1, |coordinates| below 2^30.
[[gnu::always_inline]] inline Float4 GradientNoise3(Float4 x, Float4 y, Float4 z, uint32_t seed) {
  using namespace noise_internal;
  const Int4 xi = Floor4(x), yi = Floor4(y), zi = Floor4(z);
  const Float4 fx = x - ToFloat(xi), fy = y - ToFloat(yi), fz = z - ToFloat(zi);
  const Float4 gx = fx - 1.0f, gy = fy - 1.0f, gz = fz - 1.0f;
  const Word4 px = std::bit_cast<Word4>(xi) * kPrimeX;
  const Word4 x0 = px ^ seed, x1 = (px + kPrimeX) ^ seed;
  const Word4 y0 = std::bit_cast<Word4>(yi) * kPrimeY, y1 = y0 + kPrimeY;
  const Word4 z0 = std::bit_cast<Word4>(zi) * kPrimeZ, z1 = z0 + kPrimeZ;
  const Float4 n000 = DotGradient(Scramble(x0 ^ y0 ^ z0), fx, fy, fz);
  const Float4 n100 = DotGradient(Scramble(x1 ^ y0 ^ z0), gx, fy, fz);
  const Float4 n010 = DotGradient(Scramble(x0 ^ y1 ^ z0), fx, gy, fz);
  const Float4 n110 = DotGradient(Scramble(x1 ^ y1 ^ z0), gx, gy, fz);
  const Float4 n001 = DotGradient(Scramble(x0 ^ y0 ^ z1), fx, fy, gz);
  const Float4 n101 = DotGradient(Scramble(x1 ^ y0 ^ z1), gx, fy, gz);
  const Float4 n011 = DotGradient(Scramble(x0 ^ y1 ^ z1), fx, gy, gz);
  const Float4 n111 = DotGradient(Scramble(x1 ^ y1 ^ z1), gx, gy, gz);
  const Float4 u = Fade(fx), v = Fade(fy), w = Fade(fz);
  return Lerp(Lerp(Lerp(n000, n100, u), Lerp(n010, n110, u), v),
              Lerp(Lerp(n001, n101, u), Lerp(n011, n111, u), v), w);
}

// Noise in the plane with its derivatives.
struct NoiseSample2 {
  float value = 0, dx = 0, dy = 0;
};

// Noise at (x, y), lattice spacing 1, |coordinates| below 2^30; |value| below 1.1.
inline NoiseSample2 GradientNoise2(float x, float y, uint32_t seed) {
  using namespace noise_internal;
  const int32_t xi = Floor(x), yi = Floor(y);
  const float fx = x - static_cast<float>(xi);
  const float fy = y - static_cast<float>(yi);
  float value[4], slope_x[4], slope_y[4];
  for (uint32_t c = 0; c < 4; ++c) {
    const uint32_t cx = c & 1u, cy = c >> 1;
    const uint32_t h = Scramble(((static_cast<uint32_t>(xi) + cx) * kPrimeX ^ seed) ^
                                ((static_cast<uint32_t>(yi) + cy) * kPrimeY));
    // Eight directions, 22.5 degrees off the axes.
    const float major = FlipSign(1.306563f, h & 1u), minor = FlipSign(0.541196f, (h >> 1) & 1u);
    slope_x[c] = (h & 4u) != 0 ? major : minor;
    slope_y[c] = (h & 4u) != 0 ? minor : major;
    value[c] =
        slope_x[c] * (fx - static_cast<float>(cx)) + slope_y[c] * (fy - static_cast<float>(cy));
  }
  const float u = Fade(fx), v = Fade(fy);
  const float a = Lerp(value[0], value[1], u), b = Lerp(value[2], value[3], u);
  const float da = Lerp(slope_x[0], slope_x[1], u) + (value[1] - value[0]) * FadeSlope(fx);
  const float db = Lerp(slope_x[2], slope_x[3], u) + (value[3] - value[2]) * FadeSlope(fx);
  NoiseSample2 out;
  out.value = Lerp(a, b, v);
  out.dx = Lerp(da, db, v);
  out.dy = Lerp(Lerp(slope_y[0], slope_y[1], u), Lerp(slope_y[2], slope_y[3], u), v) +
           (b - a) * FadeSlope(fy);
  return out;
}

}  // namespace mtdb
