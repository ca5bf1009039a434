// SPDX-License-Identifier: Apache-2.0
#include "store/object_name.h"

#include <cstdint>
#include <optional>

#include "store/records/keys.h"

namespace mtdb {

using namespace internal;

namespace {

// Where `text` is not UTF-8 (RFC 3629), or a control character; none when it is fine.
std::optional<size_t> FirstBadByte(const std::string& text) {
  for (size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const size_t size = lead < 0x80 ? 1 : lead < 0xe0 ? 2 : lead < 0xf0 ? 3 : 4;
    constexpr uint32_t kLeast[] = {0, 0, 0x80, 0x800, 0x10000};
    if (lead < 0x20 || lead == 0x7f || (lead >= 0x80 && lead < 0xc2) || lead > 0xf4) return i;
    if (size > text.size() - i) return i;
    uint32_t code = size == 1 ? lead : lead & (0x7fu >> size);
    for (size_t k = 1; k < size; ++k) {
      const auto next = static_cast<unsigned char>(text[i + k]);
      if ((next & 0xc0) != 0x80) return i + k;
      code = code << 6 | (next & 0x3fu);
    }
    if (code < kLeast[size] || code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) return i;
    if (code >= 0x80 && code < 0xa0) return i;  // control characters, as terminals take them
    i += size;
  }
  return std::nullopt;
}

}  // namespace

Status CheckObjectName(const std::string& name) {
  if (name.empty() || name.size() > kMaxNameBytes) {
    return InvalidArgument("object name: expected 1 to " + std::to_string(kMaxNameBytes) +
                           " bytes, found " + std::to_string(name.size()));
  }
  if (name == "." || name == "..") {
    return InvalidArgument("object name: '" + name +
                           "' stands for a folder in paths and URLs; choose another name");
  }
  if (const auto bad = FirstBadByte(name)) {
    return InvalidArgument("object name: expected UTF-8 without control characters, found byte " +
                           std::to_string(static_cast<unsigned char>(name[*bad])) + " at " +
                           std::to_string(*bad) + "; choose another name");
  }
  return Status::Ok();
}

Status CheckPageName(const std::string& name) {
  constexpr size_t kMostBytes = 255;
  if (!name.empty() && name.size() <= kMostBytes && name != "." && name != ".." &&
      name.find_first_of("/\\") == std::string::npos && !FirstBadByte(name)) {
    return Status::Ok();
  }
  return InvalidArgument(
      "name of a page: expected 1 to " + std::to_string(kMostBytes) +
      " bytes of UTF-8 that name a file in a folder, without control characters");
}

}  // namespace mtdb
