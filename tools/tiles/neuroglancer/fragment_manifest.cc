// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/neuroglancer/fragment_manifest.h"

#include <algorithm>
#include <map>
#include <utility>

namespace mtdb {

namespace {

constexpr size_t kMostLevels = 32;
constexpr size_t kBytesOfLevel = 20, kBytesOfFragment = 16;

struct OnCurve {
  bool operator()(const FragmentCell& a, const FragmentCell& b) const {
    return IsBeforeOnCurve(a, b);
  }
};
using Cells = std::map<FragmentCell, uint32_t, OnCurve>;  // and bytes

}  // namespace

// The axis in which they differ in the highest bit decides, of two such the later one.
bool IsBeforeOnCurve(const FragmentCell& a, const FragmentCell& b) {
  size_t axis = 2;
  for (const size_t other : {size_t{1}, size_t{0}}) {
    const uint32_t most = a[axis] ^ b[axis], here = a[other] ^ b[other];
    if (most < here && most < (most ^ here)) axis = other;
  }
  return a[axis] < b[axis];
}

void CompleteManifest(FragmentManifest* manifest,
                      const std::vector<std::vector<FragmentCell>>& parts) {
  std::vector<Cells> levels(manifest->levels.size());
  for (size_t l = 0; l < levels.size(); ++l) {
    for (const ManifestFragment& f : manifest->levels[l].fragments) levels[l][f.cell] = f.bytes;
    for (const FragmentCell& cell : parts[l]) levels[l].emplace(cell, 0);
    if (l == 0) continue;
    for (const auto& [cell, bytes] : levels[l - 1]) {
      levels[l].emplace(FragmentCell{cell[0] / 2, cell[1] / 2, cell[2] / 2}, 0);
    }
  }
  for (size_t l = 0; l < levels.size(); ++l) {
    manifest->levels[l].fragments.clear();
    for (const auto& [cell, bytes] : levels[l]) {
      manifest->levels[l].fragments.push_back({cell, bytes});
    }
  }
}

Bytes EncodeManifest(const FragmentManifest& manifest) {
  ByteWriter to;
  for (const float v : manifest.chunk) to.Put(v);
  for (const float v : manifest.origin) to.Put(v);
  to.Put(static_cast<uint32_t>(manifest.levels.size()));
  for (const ManifestLevel& level : manifest.levels) to.Put(level.scale);
  for (size_t i = 0; i < 3 * manifest.levels.size(); ++i) to.Put(0.0F);  // offsets of vertices
  for (const ManifestLevel& level : manifest.levels) {
    to.Put(static_cast<uint32_t>(level.fragments.size()));
  }
  for (const ManifestLevel& level : manifest.levels) {
    for (size_t axis = 0; axis < 3; ++axis) {
      for (const ManifestFragment& f : level.fragments) to.Put(f.cell[axis]);
    }
    for (const ManifestFragment& f : level.fragments) to.Put(f.bytes);
  }
  return to.Take();
}

Result<FragmentManifest> DecodeManifest(ByteSpan bytes) {
  ByteReader from(bytes);
  FragmentManifest manifest;
  for (float& v : manifest.chunk) v = from.Get<float>();
  for (float& v : manifest.origin) v = from.Get<float>();
  const auto count = from.Get<uint32_t>();
  if (from.failed() || count > kMostLevels || from.remaining() < count * kBytesOfLevel) {
    return Corrupt("is too short, or has more than 32 levels");
  }
  manifest.levels.resize(count);
  for (ManifestLevel& level : manifest.levels) level.scale = from.Get<float>();
  for (size_t i = 0; i < 3 * size_t{count}; ++i) {
    if (from.Get<float>() != 0) return Corrupt("moves the vertices of a level");
  }
  uint64_t all = 0;
  std::vector<uint32_t> counts;
  for (size_t l = 0; l < count; ++l) all += counts.emplace_back(from.Get<uint32_t>());
  if (from.remaining() != all * kBytesOfFragment) {
    return Corrupt("is of another size than its " + std::to_string(all) + " fragments need");
  }
  for (size_t l = 0; l < count; ++l) {
    std::vector<ManifestFragment>& fragments = manifest.levels[l].fragments;
    fragments.resize(counts[l]);
    for (size_t axis = 0; axis < 3; ++axis) {
      for (ManifestFragment& f : fragments) f.cell[axis] = from.Get<uint32_t>();
    }
    for (ManifestFragment& f : fragments) f.bytes = from.Get<uint32_t>();
    for (size_t i = 1; i < fragments.size(); ++i) {
      if (IsBeforeOnCurve(fragments[i - 1].cell, fragments[i].cell)) continue;
      return Corrupt("has fragments that are not in order");
    }
  }
  return manifest;
}

}  // namespace mtdb
