// SPDX-License-Identifier: Apache-2.0
// UpdateSender: the sender of an update stream. Its parts work on one SentStream.
#pragma once

#include <span>

#include "codecs/stream/encode/batch_encoder.h"
#include "codecs/stream/encode/clip_encoder.h"
#include "codecs/stream/encode/delaunay_encoder.h"
#include "codecs/stream/encode/sent_stream.h"
#include "codecs/stream/update_stream.h"

namespace mtdb::internal {

// See UpdateEncoder.
class UpdateSender {
 public:
  UpdateSender(const ClientMeshOptions& options, const BaseMesh& base, const MeetsRegion& region);
  Bytes Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region);
  size_t memory_bytes() const;
  const SentStream& stream() const { return s_; }
  const Bytes& start() const { return start_; }
  uint64_t listed() const { return batches_.listed(); }

 private:
  void WriteStart(const BaseMesh& base, Vec3d origin);
  // By the Delaunay rule, when all is there that it takes.
  bool NotesLawful(std::span<const UpdateBatch> batches);
  void EncodeBatches(std::span<const UpdateBatch> batches, const MeetsRegion& region,
                     ByteWriter& out);

  SentStream s_;
  Bytes start_;
  BatchEncoder batches_{s_};
  ClipEncoder clips_{s_};
  DelaunayEncoder rule_{s_};
  bool lawful_ = false;  // the client holds the whole cut, and the rule tells its triangles
};

}  // namespace mtdb::internal
