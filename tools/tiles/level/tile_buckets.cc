// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/level/tile_buckets.h"

#include <algorithm>
#include <cerrno>
#include <numeric>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "store/files/posix_file.h"

namespace mtdb {

TileBuckets::TileBuckets(std::string tmp_directory, size_t buffered_triangles)
    : tmp_directory_(std::move(tmp_directory)), most_(std::max<size_t>(buffered_triangles, 1024)) {}

TileBuckets::~TileBuckets() {
  if (file_ >= 0) ::close(file_);
}

Status TileBuckets::Add(uint32_t tile, const LevelTriangle& triangle) {
  buffer_.push_back({tile, triangle});
  return buffer_.size() < most_ ? Status::Ok() : Flush();
}

Status TileBuckets::Flush() {
  const auto failed = [&] {
    return Status(FileErrorCode(errno), tmp_directory_ + ": a temporary file cannot be written: " +
                                            std::generic_category().message(errno));
  };
  if (file_ < 0) file_ = OpenNamelessFile(tmp_directory_, "mtdb-tiles-");
  if (file_ < 0) return failed();
  // Sorted by counting.
  uint32_t tiles = 0;
  for (const Item& item : buffer_) tiles = std::max(tiles, item.tile + 1);
  std::vector<uint64_t> at(tiles + 1, 0);
  for (const Item& item : buffer_) ++at[item.tile + 1];
  std::partial_sum(at.begin(), at.end(), at.begin());
  for (uint32_t tile = 0; tile < tiles; ++tile) {
    if (at[tile + 1] > at[tile]) {
      stretches_.push_back({tile, written_ + at[tile], at[tile + 1] - at[tile]});
    }
  }
  std::vector<LevelTriangle> sorted(buffer_.size());
  for (const Item& item : buffer_) sorted[at[item.tile]++] = item.triangle;
  if (!WriteFully(file_, written_ * sizeof(LevelTriangle), sorted.data(),
                  sorted.size() * sizeof(LevelTriangle))) {
    return failed();
  }
  written_ += sorted.size();
  buffer_.clear();
  return Status::Ok();
}

Status TileBuckets::Finish() {
  MTDB_RETURN_IF_ERROR(Flush());
  buffer_ = {};
  std::stable_sort(stretches_.begin(), stretches_.end(),
                   [](const Stretch& a, const Stretch& b) { return a.tile < b.tile; });
  return Status::Ok();
}

std::vector<TileBuckets::Stretch>::const_iterator TileBuckets::First(uint32_t tile) const {
  return std::lower_bound(stretches_.begin(), stretches_.end(), tile,
                          [](const Stretch& s, uint32_t t) { return s.tile < t; });
}

uint64_t TileBuckets::Count(uint32_t tile) const {
  uint64_t count = 0;
  for (auto s = First(tile); s != stretches_.end() && s->tile == tile; ++s) count += s->count;
  return count;
}

Status TileBuckets::Read(uint32_t tile, std::vector<LevelTriangle>* triangles) const {
  triangles->resize(Count(tile));
  LevelTriangle* to = triangles->data();
  for (auto s = First(tile); s != stretches_.end() && s->tile == tile; ++s) {
    const size_t bytes = s->count * sizeof(LevelTriangle);
    const ssize_t n = ReadFully(file_, s->begin * sizeof(LevelTriangle), to, bytes);
    if (n != static_cast<ssize_t>(bytes)) {
      return IoError(tmp_directory_ + ": a temporary file cannot be read");
    }
    to += s->count;
  }
  return Status::Ok();
}

}  // namespace mtdb
