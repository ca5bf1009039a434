// SPDX-License-Identifier: Apache-2.0
// Stream directory of a payload: named byte streams, each stored as it is or as a zstd frame.
// Layout in codecs/FORMAT.md.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Tags of the streams of a payload. A reader that meets an unknown tag with the must-understand bit
// (0x80) refuses the payload; without it, it skips the stream.
enum class StreamTag : uint8_t {
  kHead = 0x80,
  kTopology = 0x81,
  kVertices = 0x82,
  kBits = 0x83,
  kArcs = 0x84,
  kExplicitArcs = 0x85,
  kRootVertices = 0x86,
  kRootTriangles = 0x87,
  kTwoSided = 0x88,
  kCrumbs = 0x89,
  kCorners = 0x8a,
  kSeams = 0x8b,
  kAttributes = 0x10,
  kPadding = 0x11,
};
const char* StreamTagName(StreamTag tag);

class StreamWriter {
 public:
  // A stream of plain bytes: stored as they are or as a zstd frame, whichever is shorter.
  ByteWriter& stream(StreamTag tag) { return streams_[tag]; }
  // A stream whose bytes are coded already.
  void AddCoded(StreamTag tag, Bytes bytes) { coded_[tag] = std::move(bytes); }
  // Empty streams are left out.
  Bytes Finish() const;

 private:
  std::map<StreamTag, ByteWriter> streams_;
  std::map<StreamTag, Bytes> coded_;
};

class StreamReader {
 public:
  StreamReader(StreamReader&&) = default;
  StreamReader& operator=(StreamReader&&) = default;
  // Decodes all streams; those stored as they are stay in `payload`, which must outlive the reader.
  // Bounded: a frame expands to at most kMaxExpansion times its length.
  static constexpr uint64_t kMaxExpansion = 256;
  static Result<StreamReader> Open(ByteSpan payload, const std::string& where);
  // Empty when absent.
  ByteSpan bytes(StreamTag tag) const;
  ByteReader stream(StreamTag tag) const { return ByteReader(bytes(tag)); }

  struct Size {
    StreamTag tag;
    uint32_t raw_bytes;
    uint32_t coded_bytes;
  };
  const std::vector<Size>& sizes() const { return sizes_; }

 private:
  StreamReader() = default;
  struct Stream {
    StreamTag tag;
    ByteSpan bytes;
  };
  std::vector<Stream> streams_;
  std::vector<Bytes> expanded_;
  std::vector<Size> sizes_;
};

}  // namespace mtdb::internal
