// SPDX-License-Identifier: Apache-2.0
// What decode_dump writes and decode_digest reads: the payloads of a store's clusters and root
// pieces, with zstd's frames expanded and with the triangles that clusters start from. Numbers are
// varints, positions zigzag.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

#include "codecs/cluster/cluster.h"
#include "store/base/bytes.h"

namespace mtdb {

// What comes next of an object.
inline constexpr uint8_t kNothing = 0;
inline constexpr uint8_t kClusterPayload = 1;  // nodes, payload, in-patch
inline constexpr uint8_t kRootPayload = 2;     // root vertices, payload

inline void PutBlob(ByteWriter& out, ByteSpan bytes) {
  out.PutVarint(bytes.size());
  out.PutBytes(bytes);
}
inline ByteSpan GetBlob(ByteReader& in) { return in.GetBytes(in.GetVarint()); }

inline void PutInPatch(ByteWriter& out, const InPatch& patch) {
  out.PutVarint(patch.triangles.size());
  for (const auto& t : patch.triangles) {
    for (const uint32_t v : t) out.PutVarint(v);
  }
  out.PutVarint(patch.vertices.size());
  for (const VertexIndex v : patch.vertices) out.PutVarint(v);
  for (const Vec3i p : patch.positions) {
    for (int c = 0; c < 3; ++c) out.PutSignedVarint(p[c]);
  }
  PutBlob(out, patch.rows);
}
inline InPatch GetInPatch(ByteReader& in) {
  InPatch patch;
  patch.triangles.resize(in.GetVarint());
  for (auto& t : patch.triangles) {
    for (uint32_t& v : t) v = static_cast<uint32_t>(in.GetVarint());
  }
  patch.vertices.resize(in.GetVarint());
  for (VertexIndex& v : patch.vertices) v = in.GetVarint();
  patch.positions.resize(patch.vertices.size());
  for (Vec3i& p : patch.positions) {
    for (int c = 0; c < 3; ++c) p[c] = static_cast<int32_t>(in.GetSignedVarint());
  }
  const ByteSpan rows = GetBlob(in);
  patch.rows.assign(rows.begin(), rows.end());
  return patch;
}

}  // namespace mtdb
