// SPDX-License-Identifier: Apache-2.0
// SentStream: what a sender knows of its client, and the record that it is writing.
#pragma once

#include <optional>

#include "codecs/stream/encode/key_table.h"
#include "codecs/stream/encode/whole_cut.h"
#include "codecs/stream/internal/update_coder.h"
#include "codecs/stream/mesh_update.h"

namespace mtdb::internal {

// The client's mesh with the sender's names for it, and the coder of the stream. What encodes
// updates (batch_encoder.h, delaunay_encoder.h, clip_encoder.h) works on it in turn.
struct SentStream {
  explicit SentStream(const ClientMeshOptions& settled);

  uint32_t TriangleOf(TriangleKey key) const;
  uint32_t VertexOf(VertexIndex key) const;
  void PutTriangle(TriangleKey key, uint32_t slot) {
    triangles.Put(key, slot);
    if (whole) whole->Link(key, slot);
  }
  void EraseTriangle(uint32_t slot) {
    if (whole) whole->Unlink(slot);
    triangles.Erase(slot);
  }
  // A vertex that travels.
  uint32_t AddVertex(VertexIndex key, Vec3i position, const std::byte* row);
  // A remembered one comes back.
  void RecallVertex(uint32_t vertex) {
    mesh.Recall(vertex);
    ++recalled;
  }

  // Ends the record if there is no room in it for so many updates more, or if it has enough.
  void MakeRoom(uint64_t updates, ByteWriter& out);
  void MakeRoomOrEnd(uint64_t updates, ByteWriter& out);
  bool has_enough() const { return record_updates >= std::min(kRecordUpdates, max_updates); }
  // Puts the record that is begun, if one is.
  void EndRecord(ByteWriter& out);
  void PutRecord(ByteWriter& out);

  // Records end at the first batch after so many updates.
  static constexpr uint64_t kRecordUpdates = 4096;

  const ClientMeshOptions options;
  const size_t row_bytes;
  // So many updates of a record stay well below kMaxRecordBytes.
  const uint64_t max_updates;
  ReplayedMesh mesh;
  UpdateModels models;
  RansEncoder coder;
  std::optional<WholeCut> whole;  // while the client is clipped
  KeyTable triangles;
  KeyTable vertices;            // remembered ones included
  uint64_t record_updates = 0;  // in the record that is begun
  RecordCost cost;              // likewise
  uint64_t sent = 0;
  uint64_t recalled = 0;
};

}  // namespace mtdb::internal
