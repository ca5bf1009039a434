// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/archive/gzip.h"

#include <algorithm>
#include <zlib.h>

namespace mtdb {

namespace {

constexpr int kGzipWindow = 15 + 16;  // the largest window, and gzip's header
constexpr size_t kFirstRoom = 1 << 16;

Bytef* In(ByteSpan bytes) {
  return const_cast<Bytef*>(reinterpret_cast<const Bytef*>(bytes.data()));
}

}  // namespace

Result<Bytes> Gzip(ByteSpan bytes) {
  z_stream stream{};
  if (deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, kGzipWindow, 8, Z_DEFAULT_STRATEGY) !=
      Z_OK) {
    return Status(StatusCode::kNoSpace, "zlib cannot take memory");
  }
  Bytes packed(deflateBound(&stream, static_cast<uLong>(bytes.size())));
  stream.next_in = In(bytes);
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  const int result = deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  if (result != Z_STREAM_END) return Status(StatusCode::kNoSpace, "zlib cannot compress");
  return packed;
}

Result<Bytes> Gunzip(ByteSpan packed, uint64_t most_bytes) {
  z_stream stream{};
  if (inflateInit2(&stream, kGzipWindow) != Z_OK) {
    return Status(StatusCode::kNoSpace, "zlib cannot take memory");
  }
  Bytes bytes(std::min<uint64_t>(kFirstRoom, most_bytes));
  stream.next_in = In(packed);
  stream.avail_in = static_cast<uInt>(packed.size());
  int result = Z_OK;
  while (result == Z_OK) {
    if (stream.total_out == bytes.size()) {
      if (bytes.size() >= most_bytes) break;
      bytes.resize(std::min<uint64_t>(2 * bytes.size(), most_bytes));
    }
    stream.next_out = reinterpret_cast<Bytef*>(bytes.data()) + stream.total_out;
    stream.avail_out = static_cast<uInt>(bytes.size() - stream.total_out);
    result = inflate(&stream, Z_NO_FLUSH);
  }
  bytes.resize(stream.total_out);
  inflateEnd(&stream);
  if (result != Z_STREAM_END) return Corrupt("is not gzip, not whole, or too large");
  return bytes;
}

}  // namespace mtdb
