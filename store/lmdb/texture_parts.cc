// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/texture_parts.h"

#include <algorithm>
#include <string_view>
#include <unordered_set>
#include <utility>

#include "store/records/page_parts.h"
#include "store/texture_pages.h"

namespace mtdb::internal {

Status TextureParts::Add(uint32_t page, ByteSpan bytes) {
  const auto place = [&] { return "object " + object_ + ": page " + std::to_string(page) + ": "; };
  if (page >= kMostPages) {
    return InvalidArgument(place() + "expected pages below " + std::to_string(kMostPages));
  }
  if (!files_.empty() && page < files_.back().page) {
    return InvalidArgument(place() + "expected pages in ascending order, found page " +
                           std::to_string(files_.back().page) + " before it");
  }
  if (bytes.empty()) return Status::Ok();
  if (files_.empty() || files_.back().page != page) {
    MTDB_RETURN_IF_ERROR(Finish());
    files_.push_back({page, 0, 0});
    hash_.emplace();
    parts_ = 0;
  }
  File& file = files_.back();
  if (bytes.size() > kMostPageBytes - file.bytes) {
    return InvalidArgument(place() + "its file has more than " + std::to_string(kMostPageBytes) +
                           " bytes; make the image smaller");
  }
  hash_->Add(bytes);
  file.bytes += bytes.size();
  while (!bytes.empty()) {
    const size_t taken = std::min<size_t>(bytes.size(), kPagePartBytes - waiting_.size());
    waiting_.insert(waiting_.end(), bytes.begin(), bytes.begin() + static_cast<ptrdiff_t>(taken));
    bytes = bytes.subspan(taken);
    if (waiting_.size() == kPagePartBytes) MTDB_RETURN_IF_ERROR(PutWaiting());
  }
  return Status::Ok();
}

Status TextureParts::PutWaiting() {
  return put_(files_.back().page, parts_++, std::exchange(waiting_, {}));
}

Status TextureParts::Finish() {
  if (!hash_) return Status::Ok();
  files_.back().checksum = hash_->value();
  hash_.reset();
  return waiting_.empty() ? Status::Ok() : PutWaiting();
}

Status TextureParts::Check(const ObjectRecord& record) const {
  const size_t pages = record.texture ? record.texture->pages.size() : 0;
  auto file = files_.begin();
  std::unordered_set<std::string_view> names;
  for (uint32_t i = 0; i < pages; ++i) {
    const TextureRecord::Page& page = record.texture->pages[i];
    if (!names.insert(page.name).second) {
      return InvalidArgument("object " + object_ + ": " + PageLabel(record, i) +
                             ": another page has this name; give each its own");
    }
    const bool added = file != files_.end() && file->page == i;
    const uint64_t bytes = added ? file->bytes : 0;
    const uint64_t checksum = added ? file->checksum : 0;
    if (added) ++file;
    if (page.bytes == bytes && page.checksum == checksum) continue;
    return InvalidArgument(
        "object " + object_ + ": " + PageLabel(record, i) + ": the record says " +
        std::to_string(page.bytes) + " bytes of checksum " + std::to_string(page.checksum) + ", " +
        std::to_string(bytes) + " of checksum " + std::to_string(checksum) + " were added");
  }
  if (file == files_.end()) return Status::Ok();
  return InvalidArgument("object " + object_ + ": page " + std::to_string(file->page) +
                         " was added, but the record has " + std::to_string(pages) +
                         " pages of a texture");
}

}  // namespace mtdb::internal
