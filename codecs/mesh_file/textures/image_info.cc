// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/image_info.h"

#include <algorithm>
#include <array>
#include <string_view>

namespace mtdb::internal {
namespace {

constexpr std::array<std::array<std::string_view, 2>, 4> kSuffixes{{{"image/jpeg", ".jpg"},
                                                                    {"image/png", ".png"},
                                                                    {"image/webp", ".webp"},
                                                                    {"image/tiff", ".tif"}}};

// Numbers of a part of a file; 0 behind its end.
class Part {
 public:
  Part(const ReadImagePart& read, uint64_t offset) { size_ = read(offset, bytes_); }
  size_t size() const { return size_; }
  std::string_view text(size_t at, size_t size) const {
    return AsString(ByteSpan(bytes_).first(size_)).substr(std::min(at, size_), size);
  }
  uint32_t Byte(size_t at) const { return at < size_ ? static_cast<uint32_t>(bytes_[at]) : 0; }
  uint32_t Big(size_t at, size_t size) const {
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) value = value << 8 | Byte(at + i);
    return value;
  }
  uint32_t Little(size_t at, size_t size) const {
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) value |= Byte(at + i) << (8 * i);
    return value;
  }

 private:
  std::array<std::byte, 32> bytes_{};
  size_t size_ = 0;
};

// Segments, each with its length, until the one that begins a frame.
void LookAtJpeg(const ReadImagePart& read, ImageInfo* info) {
  constexpr int kMostSegments = 4096;
  uint64_t at = 2;
  for (int i = 0; i < kMostSegments; ++i) {
    const Part segment(read, at);
    if (segment.size() < 9 || segment.Byte(0) != 0xff) return;
    const uint32_t kind = segment.Byte(1);
    if (kind == 0xff) {  // a fill byte
      ++at;
      continue;
    }
    const bool is_frame =
        kind >= 0xc0 && kind <= 0xcf && kind != 0xc4 && kind != 0xc8 && kind != 0xcc;
    if (is_frame) {
      info->height = segment.Big(5, 2);
      info->width = segment.Big(7, 2);
      return;
    }
    if (kind == 0xd9 || kind == 0xda) return;  // the end, or the image's data
    const bool is_lone = kind == 0x01 || (kind >= 0xd0 && kind <= 0xd8);
    at += is_lone ? 2 : 2 + std::max<uint64_t>(2, segment.Big(2, 2));
  }
}

void LookAtWebp(const Part& start, ImageInfo* info) {
  const std::string_view kind = start.text(12, 4);
  if (kind == "VP8X") {
    info->width = start.Little(24, 3) + 1;
    info->height = start.Little(27, 3) + 1;
  } else if (kind == "VP8L" && start.Byte(20) == 0x2f) {
    const uint32_t bits = start.Little(21, 4);
    info->width = (bits & 0x3fff) + 1;
    info->height = (bits >> 14 & 0x3fff) + 1;
  } else if (kind == "VP8 " && start.Big(23, 3) == 0x9d012a) {
    info->width = start.Little(26, 2) & 0x3fff;
    info->height = start.Little(28, 2) & 0x3fff;
  }
}

// The first directory of a classical TIFF.
void LookAtTiff(const ReadImagePart& read, const Part& start, ImageInfo* info) {
  const bool little = start.Byte(0) == 'I';
  const auto number = [little](const Part& part, size_t at, size_t size) {
    return little ? part.Little(at, size) : part.Big(at, size);
  };
  constexpr uint64_t kEntryBytes = 12;
  const uint64_t directory = number(start, 4, 4);
  const uint32_t entries = number(Part(read, directory), 0, 2);
  for (uint32_t i = 0; i < entries; ++i) {
    const Part entry(read, directory + 2 + i * kEntryBytes);
    const uint32_t tag = number(entry, 0, 2);
    if (entry.size() < kEntryBytes || tag > 257) return;
    constexpr uint32_t kShort = 3;
    const uint32_t value = number(entry, 8, number(entry, 2, 2) == kShort ? 2 : 4);
    if (tag == 256) info->width = value;
    if (tag == 257) info->height = value;
  }
}

}  // namespace

ImageInfo LookAtImage(const ReadImagePart& read) {
  ImageInfo info;
  const Part start(read, 0);
  const std::string_view head = start.text(0, 12);
  if (head.starts_with("\xff\xd8\xff")) {
    info.media_type = "image/jpeg";
    LookAtJpeg(read, &info);
  } else if (head.starts_with("\x89PNG\r\n\x1a\n")) {
    info.media_type = "image/png";
    info.width = start.Big(16, 4);
    info.height = start.Big(20, 4);
  } else if (head.starts_with("RIFF") && start.text(8, 4) == "WEBP") {
    info.media_type = "image/webp";
    LookAtWebp(start, &info);
  } else if (head.starts_with(std::string_view("II*\0", 4)) ||
             head.starts_with(std::string_view("MM\0*", 4))) {
    info.media_type = "image/tiff";
    LookAtTiff(read, start, &info);
  }
  return info;
}

ImageInfo LookAtImage(ByteSpan file) {
  return LookAtImage([file](uint64_t offset, std::span<std::byte> out) {
    const size_t begin = static_cast<size_t>(std::min<uint64_t>(offset, file.size()));
    const size_t size = std::min(out.size(), file.size() - begin);
    std::copy_n(file.data() + begin, size, out.data());
    return size;
  });
}

std::string SuffixOfImage(const std::string& media_type) {
  for (const auto& entry : kSuffixes) {
    if (entry[0] == media_type) return std::string(entry[1]);
  }
  return "";
}

}  // namespace mtdb::internal
