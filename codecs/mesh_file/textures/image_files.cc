// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/image_files.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <system_error>

#include "codecs/mesh_file/atomic_file.h"
#include "codecs/mesh_file/textures/texture_pages.h"

namespace mtdb::internal {

std::string MaterialPath(const std::string& mesh_path) {
  return std::filesystem::path(mesh_path).replace_extension(".mtl").string();
}

namespace {

// Another file has that name. An image that cannot be read has no file.
bool IsTaken(const std::string& path, const Texture& texture) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::symlink_status(path, error);
  if (!std::filesystem::exists(status)) return false;
  if (!std::filesystem::is_regular_file(status)) return true;
  const Result<Bytes> image = texture.load();
  if (!image.ok() || std::filesystem::file_size(path, error) != image->size()) return image.ok();
  const Result<Bytes> there = LoadImageFile(path);
  return !there.ok() || *there != *image;
}

}  // namespace

ImageFiles::ImageFiles(const MeshHeader& header, const std::string& mesh_path, bool beside)
    : header_(header), path_(mesh_path), beside_(beside), used_(header.textures.size(), false) {
  DistinctNames names;
  names.Add(std::string(LastPart(mesh_path)));
  names.Add(std::string(LastPart(MaterialPath(mesh_path))));
  for (const Texture& texture : header.textures) {
    names_.push_back(names.Add(PlainFileName(texture.name)));
    if (!beside || !texture.load) continue;
    // A file that is there is not replaced, unless it is the same.
    const std::string stem = std::filesystem::path(mesh_path).stem().string();
    for (int n = 1; IsTaken(FolderOf(mesh_path) + names_.back(), texture); ++n) {
      const std::string number = n == 1 ? "" : std::to_string(n) + "-";
      names_.back() = names.Add(PlainFileName(stem + "-" + number + texture.name));
    }
  }
}

ImageFiles::~ImageFiles() {
  for (const std::string& path : made_) {
    std::error_code error;
    std::filesystem::remove(path, error);
  }
}

bool ImageFiles::has_some() const {
  return std::ranges::any_of(header_.textures, [](const Texture& t) { return t.load != nullptr; });
}

Status ImageFiles::Use(std::span<const TextureCorner> corners) {
  for (size_t i = 0; i < corners.size(); ++i) {
    const uint32_t page = corners[i].page;
    if (page != corners[i / 3 * 3].page) {
      return InvalidArgument(path_ + ": the corners of a triangle are on pages " +
                             std::to_string(corners[i / 3 * 3].page) + " and " +
                             std::to_string(page) + ", expected one page");
    }
    if (page == TextureCorner::kNoPage) continue;
    if (page >= used_.size()) {
      return InvalidArgument(path_ + ": a corner on page " + std::to_string(page) +
                             ", but the mesh has " + std::to_string(used_.size()) + " pages");
    }
    used_[page] = true;
  }
  return Status::Ok();
}

Status ImageFiles::Write() {
  for (uint32_t page = 0; page < used_.size(); ++page) {
    if (!used_[page] || !has_file(page)) continue;
    MTDB_ASSIGN_OR_RETURN(const Bytes bytes, header_.textures[page].load());
    MTDB_RETURN_IF_ERROR(WriteFile(FolderOf(path_) + names_[page], bytes));
  }
  return Status::Ok();
}

Status ImageFiles::WriteText(const std::string& path, const std::string& text) {
  return WriteFile(path, AsBytes(text));
}

Status ImageFiles::WriteFile(const std::string& path, ByteSpan bytes) {
  std::error_code error;
  const bool is_new = !std::filesystem::exists(path, error);
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  MTDB_RETURN_IF_ERROR(file->Append(bytes));
  MTDB_RETURN_IF_ERROR(file->Commit());
  if (is_new) made_.push_back(path);
  return Status::Ok();
}

uint64_t ImageFiles::left_out() const {
  uint64_t count = 0;
  for (uint32_t page = 0; page < used_.size(); ++page) {
    count += used_[page] && header_.textures[page].load != nullptr && !beside_;
  }
  return count;
}

}  // namespace mtdb::internal
