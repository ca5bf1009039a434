// SPDX-License-Identifier: Apache-2.0
#include "query/answer/kept_triangles.h"

#ifdef __wasm__  // A page has no files.

namespace mtdb::internal {

void KeptTriangles::Begin(std::shared_ptr<SpillFile>, size_t, uint64_t) {}
bool KeptTriangles::open() const { return false; }
bool KeptTriangles::Keep(size_t, std::span<const TriangleVertices>) { return false; }
size_t KeptTriangles::size(size_t) const { return 0; }
bool KeptTriangles::Read(size_t, TriangleVertices*) { return false; }

}  // namespace mtdb::internal

#else

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <optional>

#include "store/base/hash.h"

namespace mtdb::internal {
namespace {

using Narrow = std::array<uint32_t, 3>;
constexpr size_t kHead = sizeof(uint64_t);

uint64_t Checksum(ByteSpan image) { return Hash64(image.subspan(kHead)); }

}  // namespace

void KeptTriangles::Begin(std::shared_ptr<SpillFile> file, size_t lists, uint64_t vertices) {
  if (file == nullptr || file != file_) lists_.clear();
  file_ = std::move(file);
  narrow_ = vertices <= std::numeric_limits<uint32_t>::max();
  for (List& list : lists_) list.bytes = 0;
  if (file_ != nullptr) lists_.resize(std::max(lists, lists_.size()));
}

bool KeptTriangles::open() const { return file_ != nullptr && file_->open(); }

size_t KeptTriangles::size(size_t list) const {
  return (lists_[list].bytes - kHead) / (narrow_ ? sizeof(Narrow) : sizeof(TriangleVertices));
}

bool KeptTriangles::Keep(size_t list, std::span<const TriangleVertices> triangles) {
  image_.resize(kHead + triangles.size() * (narrow_ ? sizeof(Narrow) : sizeof(TriangleVertices)));
  std::byte* const numbers = image_.data() + kHead;
  if (narrow_) {
    for (size_t i = 0; i < triangles.size(); ++i) {
      const TriangleVertices& t = triangles[i];
      const Narrow packed{static_cast<uint32_t>(t[0]), static_cast<uint32_t>(t[1]),
                          static_cast<uint32_t>(t[2])};
      std::memcpy(numbers + i * sizeof(packed), &packed, sizeof(packed));
    }
  } else if (!triangles.empty()) {
    std::memcpy(numbers, triangles.data(), triangles.size_bytes());
  }
  const uint64_t checksum = Checksum(image_);
  std::memcpy(image_.data(), &checksum, kHead);
  List& kept = lists_[list];
  kept.bytes = 0;
  if (image_.size() > kept.room.bytes) {
    const std::optional<SpillPlace> room = file_->Write(image_);
    if (!room) return false;
    kept.room = *room;
  } else if (!file_->Rewrite(kept.room, image_)) {
    return false;
  }
  kept.bytes = image_.size();
  return true;
}

bool KeptTriangles::Read(size_t list, TriangleVertices* triangles) {
  const size_t count = size(list);
  List& kept = lists_[list];
  image_.resize(kept.bytes);
  uint64_t checksum = 0;
  const bool read = file_->Read({kept.room.offset, kept.bytes}, image_);
  std::memcpy(&checksum, image_.data(), kHead);
  if (!read || checksum != Checksum(image_)) {
    kept.bytes = 0;
    return false;
  }
  const std::byte* const numbers = image_.data() + kHead;
  if (!narrow_) {
    if (count > 0) std::memcpy(triangles, numbers, count * sizeof(TriangleVertices));
    return true;
  }
  for (size_t i = 0; i < count; ++i) {
    Narrow packed;
    std::memcpy(&packed, numbers + i * sizeof(packed), sizeof(packed));
    triangles[i] = {packed[0], packed[1], packed[2]};
  }
  return true;
}

}  // namespace mtdb::internal

#endif
