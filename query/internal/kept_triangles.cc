// SPDX-License-Identifier: Apache-2.0
#include "query/internal/kept_triangles.h"

#ifdef __wasm__  // A page has no files.

namespace mtdb::internal {

KeptTriangles::KeptTriangles(std::shared_ptr<SpillFile>, size_t, uint64_t) {}
bool KeptTriangles::open() const { return false; }
bool KeptTriangles::Keep(size_t, std::span<const TriangleVertices>) { return false; }
size_t KeptTriangles::size(size_t) const { return 0; }
bool KeptTriangles::Read(size_t, TriangleVertices*) { return false; }

}  // namespace mtdb::internal

#else

#include <array>
#include <cstring>
#include <limits>

#include "store/base/hash.h"

namespace mtdb::internal {
namespace {

using Narrow = std::array<uint32_t, 3>;
constexpr size_t kHead = sizeof(uint64_t);

uint64_t Checksum(ByteSpan image) { return Hash64(image.subspan(kHead)); }

}  // namespace

KeptTriangles::KeptTriangles(std::shared_ptr<SpillFile> file, size_t lists, uint64_t vertices)
    : file_(std::move(file)),
      narrow_(vertices <= std::numeric_limits<uint32_t>::max()),
      places_(lists) {}

bool KeptTriangles::open() const { return file_ != nullptr && file_->open(); }

size_t KeptTriangles::size(size_t list) const {
  return (places_[list]->bytes - kHead) / (narrow_ ? sizeof(Narrow) : sizeof(TriangleVertices));
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
  places_[list] = file_->Write(image_);
  return Has(list);
}

bool KeptTriangles::Read(size_t list, TriangleVertices* triangles) {
  const size_t count = size(list);
  image_.resize(places_[list]->bytes);
  uint64_t checksum = 0;
  const bool read = file_->Read(*places_[list], image_);
  std::memcpy(&checksum, image_.data(), kHead);
  if (!read || checksum != Checksum(image_)) {
    places_[list].reset();
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
