// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/texture_pages.h"

#include <algorithm>
#include <array>
#include <memory>
#include <utility>

#include "codecs/mesh_file/input/file_io.h"
#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/textures/image_info.h"

namespace mtdb::internal {

Result<Bytes> LoadImageFile(const std::string& path) {
  constexpr uint64_t kMostBytes = uint64_t{1} << 30;
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<InputFile> file, InputFile::Open(path));
  if (file->size_bytes() > kMostBytes) {
    return Unsupported(path + ": an image of " + std::to_string(file->size_bytes()) +
                       " bytes, at most 1 GiB are read");
  }
  Bytes bytes(file->size_bytes());
  MTDB_ASSIGN_OR_RETURN(const size_t read, file->ReadAt(0, bytes));
  bytes.resize(read);
  return bytes;
}

namespace {

// Of images whose first bytes LookAtImage does not know. Other files are none, whoever names them:
// a mesh that came from elsewhere must not make them part of what is published.
bool IsImageName(std::string_view name) {
  constexpr std::array<std::string_view, 12> kSuffixes{".tif", ".tiff", ".bmp",  ".tga",
                                                       ".dds", ".ktx",  ".ktx2", ".jp2",
                                                       ".gif", ".exr",  ".hdr",  ".psd"};
  const size_t dot = name.rfind('.');
  std::string suffix(dot == std::string_view::npos ? "" : name.substr(dot));
  std::ranges::transform(suffix, suffix.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  return std::ranges::find(kSuffixes, suffix) != kSuffixes.end();
}

}  // namespace

Result<uint32_t> TexturePages::AddFile(const std::string& folder, std::string_view name) {
  const std::string path = PathOfNamed(folder, name);
  const auto known = files_.find(path);
  if (known != files_.end()) return known->second;
  if (path == folder + std::string(LastPart(name)) && LastPart(name) != name) {
    AddIgnored(report_,
               "the folder in the image's name " + std::string(name) + ": taken is " + path);
  }
  Texture texture;
  texture.name = PlainFileName(name);
  texture.load = [path] { return LoadImageFile(path); };
  const Result<std::unique_ptr<InputFile>> file = InputFile::Open(path);
  if (file.ok()) {
    const ImageInfo info = LookAtImage([&](uint64_t offset, std::span<std::byte> out) {
      const Result<size_t> n = (*file)->ReadAt(offset, out);
      return n.ok() ? *n : 0;
    });
    texture.media_type = info.media_type;
    texture.width = info.width;
    texture.height = info.height;
    if (info.media_type.empty() && !IsImageName(name)) {
      texture.load = {};
      AddIgnored(report_, "no image: " + path);
    }
  } else {
    AddIgnored(report_, "an image that cannot be read: " + file.status().message());
  }
  MTDB_ASSIGN_OR_RETURN(const uint32_t page, Add(std::move(texture)));
  files_[path] = page;
  return page;
}

Result<uint32_t> TexturePages::Add(Texture texture) {
  if (pages_.size() == kMostPages) {
    return Unsupported(path_ + ": more than " + std::to_string(kMostPages) +
                       " images; join some, or split the mesh");
  }
  texture.name = names_.Add(texture.name);
  pages_.push_back(std::move(texture));
  return static_cast<uint32_t>(pages_.size() - 1);
}

}  // namespace mtdb::internal
