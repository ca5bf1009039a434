// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/streams.h"

#include <memory>
#include <new>
#include <string_view>

#include "zstd.h"
#include "zstd_errors.h"

#include "store/base/out_of_memory.h"
#include "store/base/threading.h"

namespace mtdb::internal {

namespace {

constexpr int kZstdLevel = 6;

struct FreeCompressor {
  void operator()(ZSTD_CCtx* c) const { ZSTD_freeCCtx(c); }
};
struct FreeDecompressor {
  void operator()(ZSTD_DCtx* d) const { ZSTD_freeDCtx(d); }
};

// Contexts are costly to make and hold no state between calls; one per thread.
ZSTD_CCtx* ThreadCompressor() {
  MTDB_THREAD_LOCAL std::unique_ptr<ZSTD_CCtx, FreeCompressor> context;
  if (context == nullptr) context.reset(ZSTD_createCCtx());
  if (context == nullptr) ThrowOutOfMemory();
  return context.get();
}
ZSTD_DCtx* ThreadDecompressor() {
  MTDB_THREAD_LOCAL std::unique_ptr<ZSTD_DCtx, FreeDecompressor> context;
  if (context == nullptr) context.reset(ZSTD_createDCtx());
  if (context == nullptr) ThrowOutOfMemory();
  return context.get();
}

bool Known(StreamTag tag) { return std::string_view(StreamTagName(tag)) != "unknown"; }

}  // namespace

const char* StreamTagName(StreamTag tag) {
  switch (tag) {
    case StreamTag::kHead: return "head";
    case StreamTag::kTopology: return "topology";
    case StreamTag::kVertices: return "vertices";
    case StreamTag::kBits: return "bits";
    case StreamTag::kArcs: return "arcs";
    case StreamTag::kExplicitArcs: return "explicit_arcs";
    case StreamTag::kRootVertices: return "root_vertices";
    case StreamTag::kRootTriangles: return "root_triangles";
    case StreamTag::kTwoSided: return "two_sided";
    case StreamTag::kCrumbs: return "crumbs";
    case StreamTag::kCorners: return "corners";
    case StreamTag::kSeams: return "seams";
    case StreamTag::kAttributes: return "attributes";
    case StreamTag::kPadding: return "padding";
  }
  return "unknown";
}

Bytes StreamWriter::Finish() const {
  ByteWriter directory;
  ByteWriter body;
  uint64_t count = 0;
  const auto put = [&](StreamTag tag, size_t raw_bytes, size_t frame_bytes, ByteSpan bytes) {
    directory.Put<uint8_t>(static_cast<uint8_t>(tag));
    directory.PutVarint(raw_bytes);
    directory.PutVarint(frame_bytes);  // 0: stored as it is
    body.PutBytes(bytes);
    ++count;
  };
  for (const auto& [tag, writer] : streams_) {
    const Bytes& raw = writer.bytes();
    if (raw.empty()) continue;
    Bytes frame(ZSTD_compressBound(raw.size()));
    ZSTD_CCtx* context = ThreadCompressor();
    ZSTD_CCtx_reset(context, ZSTD_reset_session_and_parameters);
    ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, kZstdLevel);
    ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 0);
    ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 0);
    const size_t size = ZSTD_compress2(context, frame.data(), frame.size(), raw.data(), raw.size());
    if (ZSTD_getErrorCode(size) == ZSTD_error_memory_allocation) ThrowOutOfMemory();
    MTDB_CHECK(!ZSTD_isError(size), "zstd refuses to compress");
    // A reader refuses a frame that expands too far, so that hostile bytes cannot take much memory.
    const bool pays = size < raw.size() && raw.size() / StreamReader::kMaxExpansion < size;
    put(tag, raw.size(), pays ? size : 0, pays ? ByteSpan(frame).first(size) : ByteSpan(raw));
  }
  for (const auto& [tag, bytes] : coded_) {
    if (!bytes.empty()) put(tag, bytes.size(), 0, bytes);
  }
  ByteWriter payload;
  payload.PutVarint(count);
  payload.PutBytes(directory.bytes());
  payload.PutBytes(body.bytes());
  return payload.Take();
}

Result<StreamReader> StreamReader::Open(ByteSpan payload, const std::string& where) {
  const auto corrupt = [&](const std::string& what) {
    return Corrupt(where + ": stream directory: " + what);
  };
  ByteReader reader(payload);
  const uint64_t count = reader.GetVarint();
  if (count > reader.remaining()) return corrupt("more streams than bytes");
  struct Entry {
    uint8_t tag;
    uint64_t raw, coded;
  };
  std::vector<Entry> entries;
  for (uint64_t i = 0; i < count; ++i) {
    Entry e{reader.Get<uint8_t>(), reader.GetVarint(), reader.GetVarint()};
    if (reader.failed()) return corrupt("cut short");
    if (e.raw == 0) return corrupt("an empty stream is listed");
    if (e.coded != 0 && e.raw / kMaxExpansion >= e.coded) {
      return corrupt("a frame of " + std::to_string(e.coded) + " bytes cannot hold " +
                     std::to_string(e.raw));
    }
    entries.push_back(e);
  }
  StreamReader result;
  for (const Entry& e : entries) {
    const uint64_t stored = e.coded == 0 ? e.raw : e.coded;
    const ByteSpan bytes = reader.GetBytes(stored);
    if (reader.failed()) return corrupt("stream beyond the end of the payload");
    const auto tag = static_cast<StreamTag>(e.tag);
    if (!Known(tag)) {
      if (e.tag & 0x80) {
        return Status(StatusCode::kUnsupported,
                      where + ": stream " + std::to_string(e.tag) +
                          " must be understood, but is of a later version; use a newer mtdb");
      }
      continue;
    }
    if (!result.bytes(tag).empty()) return corrupt("a stream occurs twice");
    ByteSpan raw_bytes = bytes;
    if (e.coded != 0) {
      Bytes raw(e.raw);
      const size_t size = ZSTD_decompressDCtx(ThreadDecompressor(), raw.data(), raw.size(),
                                              bytes.data(), bytes.size());
      if (ZSTD_isError(size) || size != e.raw) {
        return corrupt(std::string("stream ") + StreamTagName(tag) + " does not decompress");
      }
      raw_bytes = result.expanded_.emplace_back(std::move(raw));
    }
    result.sizes_.push_back({tag, static_cast<uint32_t>(e.raw), static_cast<uint32_t>(stored)});
    result.streams_.push_back({tag, raw_bytes});
  }
  if (reader.remaining() != 0) return corrupt("bytes left over at the end");
  return result;
}

ByteSpan StreamReader::bytes(StreamTag tag) const {
  for (const Stream& s : streams_) {
    if (s.tag == tag) return s.bytes;
  }
  return {};
}

}  // namespace mtdb::internal
