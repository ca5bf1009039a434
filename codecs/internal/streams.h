// Stream directory of a payload: named byte streams, each stored raw or as a zstd frame,
// whichever is shorter. Layout in codecs/FORMAT.md.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Tags of the streams of a payload. A reader that meets an unknown tag with the must-understand bit
// (0x80) refuses the payload; without it, it skips the stream.
enum class StreamTag : uint8_t {
  kHead = 0x80,
  kAnchors = 0x81,
  kHoles = 0x82,
  kErrors = 0x83,
  kResidualLow = 0x84,
  kResidualMid = 0x85,
  kResidualHigh = 0x86,
  kArcs = 0x87,
  kBoundary = 0x88,
  kExplicitArcs = 0x89,
  kRootVertices = 0x8a,
  kRootTriangles = 0x8b,
  kAttributes = 0x10,
};
const char* StreamTagName(StreamTag tag);

class StreamWriter {
 public:
  ByteWriter& stream(StreamTag tag) { return streams_[tag]; }
  // Empty streams are left out.
  Bytes Finish() const;

 private:
  std::map<StreamTag, ByteWriter> streams_;
};

class StreamReader {
 public:
  // Decodes all streams. Bounded: the raw lengths together may be at most
  // kMaxExpansion * payload.size() + 64 KiB.
  static constexpr uint64_t kMaxExpansion = 4096;
  static Result<StreamReader> Open(ByteSpan payload, const std::string& where);
  // Empty when absent.
  ByteReader stream(StreamTag tag) const;

  struct Size {
    StreamTag tag;
    uint32_t raw_bytes;
    uint32_t coded_bytes;
  };
  const std::vector<Size>& sizes() const { return sizes_; }

 private:
  std::map<StreamTag, Bytes> streams_;
  std::vector<Size> sizes_;
};

}  // namespace mtdb
