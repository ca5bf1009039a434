// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_packed.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <string_view>
#include <utility>

namespace mtdb::internal {

namespace {

std::optional<uint64_t> Number(std::string_view text) {
  uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

// Nullopt: not understood. A range without bytes: none of the file.
std::optional<ByteRange> ParseRange(std::string_view text, uint64_t size) {
  constexpr std::string_view kUnit = "bytes=";
  if (!text.starts_with(kUnit)) return std::nullopt;
  text.remove_prefix(kUnit.size());
  const size_t dash = text.find('-');
  if (dash == text.npos) return std::nullopt;
  const std::string_view first = text.substr(0, dash), last = text.substr(dash + 1);
  const std::optional<uint64_t> from = Number(first), to = Number(last);
  if ((!first.empty() && !from) || (!last.empty() && !to)) return std::nullopt;
  if (!from) {
    if (!to) return std::nullopt;
    const uint64_t bytes = std::min(*to, size);
    return ByteRange{size - bytes, bytes};
  }
  if (to && *to < *from) return std::nullopt;
  if (*from >= size) return ByteRange{};
  return ByteRange{*from, std::min(to.value_or(size - 1), size - 1) - *from + 1};
}

}  // namespace

Result<std::shared_ptr<const PackedImage>> PackedImages::Open(const Database& database,
                                                              const std::string& name) {
  MTDB_ASSIGN_OR_RETURN(const ObjectRecord record, database.Find(name));
  if (auto image = Find(record)) return image;
  MTDB_ASSIGN_OR_RETURN(const NamedLocks::Held opening, opening_.Take(name));
  if (auto image = Find(record)) return image;
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source, database.OpenObject(name, true));
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<const PackedImage> image,
                        PackedImage::Open(std::move(source)));
  std::vector<std::shared_ptr<const PackedImage>> dropped;  // outside of the lock
  const std::lock_guard lock(mutex_);
  const auto old = std::stable_partition(images_.begin(), images_.end(), [&](const auto& other) {
    return other->record().name != name && !IsSameObject(other->record(), record);
  });
  dropped.assign(old, images_.end());
  images_.erase(old, images_.end());
  if (images_.size() >= most_ && !images_.empty()) {
    dropped.push_back(std::move(images_.front()));
    images_.erase(images_.begin());
  }
  images_.push_back(image);
  return image;
}

void PackedImages::Clear() {
  std::vector<std::shared_ptr<const PackedImage>> dropped;  // outside of the lock
  const std::lock_guard lock(mutex_);
  dropped.swap(images_);
}

std::shared_ptr<const PackedImage> PackedImages::Find(const ObjectRecord& record) {
  const std::lock_guard lock(mutex_);
  const auto at = std::ranges::find_if(images_, [&](const auto& image) {
    // The file has the name.
    return image->record().name == record.name && IsSameObject(image->record(), record);
  });
  if (at == images_.end()) return nullptr;
  std::rotate(at, at + 1, images_.end());
  return images_.back();
}

RangedPart FindPart(const std::string& text, uint64_t size) {
  const std::optional<ByteRange> range = ParseRange(text, size);
  if (!range) return {200, {0, size}};
  if (range->bytes == 0) return {416, {}};
  return {206, *range};
}

RangedPart FindPackedPart(const PackedImage& image, const PackedRequest& request) {
  const std::string etag = '"' + image.content_hash() + '"';
  const bool other = (!request.hash.empty() && request.hash != image.content_hash()) ||
                     (!request.if_range.empty() && request.if_range != etag);
  if (other) return {412, {}};
  return FindPart(request.range, image.size());
}

}  // namespace mtdb::internal
