// SPDX-License-Identifier: Apache-2.0
#include "builder/write/texture_pages.h"

#include <algorithm>
#include <array>
#include <set>
#include <string_view>
#include <utility>

#include "store/base/hash.h"
#include "store/base/running_hash.h"
#include "store/object_name.h"
#include "store/texture_pages.h"

namespace mtdb::internal {

namespace {

constexpr size_t kBytesAtOnce = 1 << 20;

// ".jpg" for "image/jpeg"; empty for what is not known.
std::string_view ExtensionOf(std::string_view media_type) {
  static constexpr std::array<std::pair<std::string_view, std::string_view>, 4> kExtensions{
      {{"image/jpeg", ".jpg"},
       {"image/png", ".png"},
       {"image/webp", ".webp"},
       {"image/tiff", ".tif"}}};
  for (const auto& [type, extension] : kExtensions) {
    if (media_type == type) return extension;
  }
  return "";
}

// Gives each page a name of its own.
class PageNames {
 public:
  std::string Take(const Texture& texture, size_t page) {
    std::string name = texture.name.substr(texture.name.find_last_of("/\\") + 1);
    if (!CheckPageName(name).ok()) {
      name = "texture" + std::to_string(page + 1) + std::string(ExtensionOf(texture.media_type));
    }
    const size_t dot = name.find_last_of('.');
    const bool has_extension = dot != std::string::npos && dot > 0 && name.size() - dot <= 32;
    const size_t stem = has_extension ? dot : name.size();
    std::string free = name;
    for (int i = 2; taken_.contains(free); ++i) {
      // A name of many bytes has room for a number where it was cut.
      free = Clipped(name, std::min<size_t>(stem, 200)) + "-" + std::to_string(i);
      free += name.substr(stem);
    }
    taken_.insert(free);
    return free;
  }

 private:
  // At most that many bytes from the beginning, of whole characters.
  static std::string Clipped(const std::string& name, size_t bytes) {
    while (bytes > 0 && bytes < name.size() &&
           (static_cast<unsigned char>(name[bytes]) & 0xc0) == 0x80) {
      --bytes;
    }
    return name.substr(0, bytes);
  }
  std::set<std::string> taken_;
};

// What the record keeps of it: no spaces, no control characters.
std::string MediaTypeOf(const Texture& texture) {
  const bool plain =
      texture.media_type.size() <= 255 &&
      std::ranges::all_of(texture.media_type, [](char c) { return c > ' ' && c <= '~'; });
  return plain ? texture.media_type : "";
}

// Empty when there is none; a failure that is no reason to give up is noted.
Result<Bytes> LoadFile(const Texture& texture, const std::string& name,
                       std::vector<std::string>* notes) {
  if (!texture.load) return Bytes();
  Result<Bytes> file = texture.load();
  if (file.ok() && file->size() <= kMostPageBytes) return file;
  const StatusCode code = file.status().code();
  if (code == StatusCode::kCancelled || code == StatusCode::kNoSpace) return file.status();
  notes->push_back(file.ok() ? name + ": an image of " + std::to_string(file->size()) +
                                   " bytes is not kept; at most " + std::to_string(kMostPageBytes) +
                                   " are"
                             : file.status().message());
  return Bytes();
}

// A page of which no tiles can be made has none.
Status AddTiles(ByteSpan file, const std::string& name, TileMaker& tiles,
                std::vector<std::string>* notes) {
  const Status status = tiles.AddPage(file);
  if (status.code() != StatusCode::kBadInput && status.code() != StatusCode::kUnsupported) {
    return status;
  }
  notes->push_back(name + ": kept, but not drawn: " + status.message());
  return Status::Ok();
}

}  // namespace

Status AddTexturePages(const std::vector<Texture>& textures, ObjectWriter& writer, TileMaker& tiles,
                       TextureRecord* texture, std::vector<std::string>* notes) {
  if (textures.size() > kMostPages) {
    return BadInput("the mesh has " + std::to_string(textures.size()) +
                    " images of its texture, at most " + std::to_string(kMostPages) +
                    " can be kept; join some of them, or drop the texture");
  }
  PageNames names;
  texture->pages.clear();
  texture->tiles = {};
  for (uint32_t i = 0; i < textures.size(); ++i) {
    TextureRecord::Page& page = texture->pages.emplace_back();
    page.name = names.Take(textures[i], i);
    page.media_type = MediaTypeOf(textures[i]);
    page.width = textures[i].width;
    page.height = textures[i].height;
    MTDB_ASSIGN_OR_RETURN(const Bytes file, LoadFile(textures[i], page.name, notes));
    if (file.empty()) {
      tiles.AddEmptyPage();
      continue;
    }
    page.bytes = file.size();
    page.checksum = Hash64(file);
    for (size_t at = 0; at < file.size(); at += kBytesAtOnce) {
      const ByteSpan part = ByteSpan(file).subspan(at, std::min(kBytesAtOnce, file.size() - at));
      MTDB_RETURN_IF_ERROR(writer.AddTextureFile(i, part));
    }
    MTDB_RETURN_IF_ERROR(AddTiles(file, page.name, tiles, notes));
  }
  RunningHash hash;
  const auto number = static_cast<uint32_t>(textures.size());
  MTDB_RETURN_IF_ERROR(tiles.Write([&](ByteSpan part) {
    hash.Add(part);
    texture->tiles.bytes += part.size();
    return writer.AddTextureFile(number, part);
  }));
  if (texture->tiles.bytes > 0) texture->tiles.checksum = hash.value();
  return Status::Ok();
}

}  // namespace mtdb::internal
