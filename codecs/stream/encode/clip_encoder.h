// SPDX-License-Identifier: Apache-2.0
// ClipEncoder: what a region that moves asks of a clipped client: triangles that it drops, and that
// are attached.
#pragma once

#include <vector>

#include "codecs/stream/encode/sent_stream.h"
#include "codecs/stream/internal/clip_coder.h"

namespace mtdb::internal {

class ClipEncoder {
 public:
  explicit ClipEncoder(SentStream& stream) : s_(stream) {}

  // The client, which holds the whole cut, is clipped from now on.
  void Begin();
  // Drops what is not chosen of the whole cut, and attaches what is.
  void Encode(ByteWriter& out);

 private:
  std::vector<uint32_t> Coming() const;
  void EncodeDrops(const std::vector<uint32_t>& leaving, std::vector<uint32_t>* left_over);

  SentStream& s_;
  DropScratch scratch_;
};

}  // namespace mtdb::internal
