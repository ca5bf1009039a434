// SPDX-License-Identifier: Apache-2.0
// ImageFiles: the images of a textured mesh as files beside the mesh file.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "codecs/mesh_file/textures/file_names.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Of the pages that triangles use, those that have bytes. Until Keep() is called, the files that
// were not there before are removed again, so that nothing is left of a run that fails.
class ImageFiles {
 public:
  // `mesh_path`: of the mesh file. `beside`: whether there is a folder that files can be put into.
  ImageFiles(const MeshHeader& header, const std::string& mesh_path, bool beside);
  ~ImageFiles();
  ImageFiles(const ImageFiles&) = delete;
  ImageFiles& operator=(const ImageFiles&) = delete;

  // Of the file of a page, in the folder of the mesh file.
  const std::string& name(uint32_t page) const { return names_[page]; }
  // Whether the page gets a file when it is used.
  bool has_file(uint32_t page) const { return beside_ && header_.textures[page].load != nullptr; }
  // Some page has bytes.
  bool has_some() const;

  // Notes the pages of corners. kInvalidArgument: there is no such page, or a triangle is on two.
  Status Use(std::span<const TextureCorner> corners);
  bool is_used(uint32_t page) const { return used_[page]; }

  // Writes the images that are used. Their own errors, and those of AtomicFile.
  Status Write();
  // Writes another file beside the mesh, which disappears with the images.
  Status WriteText(const std::string& path, const std::string& text);
  // The mesh file is there.
  void Keep() { made_.clear(); }
  // Pages whose images are used but have no place.
  uint64_t left_out() const;

 private:
  Status WriteFile(const std::string& path, ByteSpan bytes);

  const MeshHeader& header_;
  std::string path_;
  bool beside_;
  std::vector<std::string> names_;  // by page
  std::vector<bool> used_;          // by page
  std::vector<std::string> made_;   // files that are removed again
};

// "a/b.mtl" for "a/b.obj".
std::string MaterialPath(const std::string& mesh_path);

}  // namespace mtdb::internal
