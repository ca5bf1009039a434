// SPDX-License-Identifier: Apache-2.0
// TexturePages: the pages of a mesh, as a reader finds them in its file.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "codecs/mesh_file/textures/file_names.h"
#include "store/base/status.h"
#include "store/base/texture.h"

namespace mtdb::internal {

// The bytes of a whole file. kNotFound, kIoError, kUnsupported (above 4 GiB).
Result<Bytes> LoadImageFile(const std::string& path);

// Images are looked at, and not kept. One that cannot be read is a page all the same: what is
// wrong goes into the report, and is what Texture::load says.
class TexturePages {
 public:
  // `path`: of the mesh file.
  TexturePages(std::string path, MeshReadReport* report)
      : path_(std::move(path)), report_(report) {}

  // The page of the image file that a file in `folder` names (file_names.h). kUnsupported: there
  // are too many.
  Result<uint32_t> AddFile(const std::string& folder, std::string_view name);
  // A page of another kind; its name may still be taken by another one.
  Result<uint32_t> Add(Texture texture);
  // Keeps coordinates that belong to no image: a page of which nobody has the bytes.
  void AddUnknown() { pages_.push_back({names_.Add("texture"), "", 0, 0, {}}); }

  size_t size() const { return pages_.size(); }
  const std::vector<Texture>& pages() const { return pages_; }

 private:
  std::string path_;
  MeshReadReport* report_;
  std::vector<Texture> pages_;
  DistinctNames names_;
  std::map<std::string, uint32_t> files_;  // by path
};

}  // namespace mtdb::internal
