// SPDX-License-Identifier: Apache-2.0
// What the first bytes of an image file say: its kind and its size.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "store/base/bytes.h"

namespace mtdb::internal {

struct ImageInfo {
  std::string media_type;          // of JPEG, PNG, WebP and TIFF; empty: none of these
  uint32_t width = 0, height = 0;  // pixels; 0: not found
};

// Reads bytes of the file from `offset` on; returns how many there were.
using ReadImagePart = std::function<size_t(uint64_t offset, std::span<std::byte> out)>;

// Reads some bytes here and there, and trusts none.
ImageInfo LookAtImage(const ReadImagePart& read);
ImageInfo LookAtImage(ByteSpan file);
// ".jpg" of "image/jpeg"; empty where the type is not one of the four.
std::string SuffixOfImage(const std::string& media_type);

}  // namespace mtdb::internal
