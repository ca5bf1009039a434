// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/texture_parts.h"

#include <algorithm>
#include <string_view>
#include <unordered_set>
#include <utility>

#include "store/records/page_parts.h"
#include "store/texture_pages.h"

namespace mtdb::internal {

Status TextureParts::Add(uint32_t number, ByteSpan bytes) {
  const auto place = [&] {
    return "object " + object_ + ": file " + std::to_string(number) + " of its texture: ";
  };
  if (number > kMostPages) {
    return InvalidArgument(place() + "expected at most " + std::to_string(kMostPages) + " pages");
  }
  if (!files_.empty() && number < files_.back().number) {
    return InvalidArgument(place() + "expected files in ascending order, found file " +
                           std::to_string(files_.back().number) + " before it");
  }
  if (bytes.empty()) return Status::Ok();
  if (files_.empty() || files_.back().number != number) {
    MTDB_RETURN_IF_ERROR(Finish());
    files_.push_back({number, 0, 0});
    hash_.emplace();
    parts_ = 0;
  }
  File& file = files_.back();
  if (bytes.size() > kMostTileBytes - file.bytes) {
    return InvalidArgument(place() + "it has more than " + std::to_string(kMostTileBytes) +
                           " bytes");
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
  return put_(files_.back().number, parts_++, std::exchange(waiting_, {}));
}

Status TextureParts::Finish() {
  if (!hash_) return Status::Ok();
  files_.back().checksum = hash_->value();
  hash_.reset();
  return waiting_.empty() ? Status::Ok() : PutWaiting();
}

Status TextureParts::Check(const ObjectRecord& record) const {
  const uint32_t files = record.texture ? record.texture->files() : 0;
  auto file = files_.begin();
  std::unordered_set<std::string_view> names;
  for (uint32_t i = 0; i < files; ++i) {
    const auto place = [&] { return "object " + object_ + ": " + TextureFileLabel(record, i); };
    const bool image = i < record.texture->pages.size();
    if (image && !names.insert(record.texture->pages[i].name).second) {
      return InvalidArgument(place() + ": another page has this name; give each its own");
    }
    const bool added = file != files_.end() && file->number == i;
    const TextureRecord::File found =
        added ? TextureRecord::File{file->bytes, file->checksum} : TextureRecord::File{};
    if (added) ++file;
    if (image && found.bytes > kMostPageBytes) {
      return InvalidArgument(place() + ": its file has more than " +
                             std::to_string(kMostPageBytes) + " bytes; make the image smaller");
    }
    const TextureRecord::File expected = record.texture->file(i);
    if (expected == found) continue;
    return InvalidArgument(place() + ": the record says " + std::to_string(expected.bytes) +
                           " bytes of checksum " + std::to_string(expected.checksum) + ", " +
                           std::to_string(found.bytes) + " of checksum " +
                           std::to_string(found.checksum) + " were added");
  }
  if (file == files_.end()) return Status::Ok();
  return InvalidArgument("object " + object_ + ": file " + std::to_string(file->number) +
                         " of a texture was added, but the record has " + std::to_string(files) +
                         " files");
}

}  // namespace mtdb::internal
