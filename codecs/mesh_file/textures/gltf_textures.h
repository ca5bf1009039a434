// SPDX-License-Identifier: Apache-2.0
// GltfTextures: which image a primitive of a glTF file shows, and where.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "codecs/mesh_file/mesh_file.h"
#include "codecs/mesh_file/readers/gltf_document.h"
#include "codecs/mesh_file/textures/corner_table.h"
#include "codecs/mesh_file/textures/texture_pages.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// What the material of a primitive says.
struct GltfTextureUse {
  std::string coordinates;  // "TEXCOORD_0"; empty: the primitive has none
  uint32_t page = TextureCorner::kNoPage;
  // KHR_texture_transform: u is place[0] * u + place[1] * v + place[2], and v likewise from
  // place[3] on.
  std::array<double, 6> place{1, 0, 0, 0, 1, 0};

  // The place of the file's values: v goes up, where glTF's goes down.
  TexturePlace Apply(double u, double v) const {
    return {static_cast<float>(place[0] * u + place[1] * v + place[2]),
            static_cast<float>(1 - (place[3] * u + place[4] * v + place[5]))};
  }
};

class GltfTextures {
 public:
  // `document` and `file` must outlive it, but not what Texture::load reads.
  GltfTextures(const GltfDocument& document, const InputFile& file, MeshReadReport* report)
      : document_(document), file_(file), report_(report), pages_(file.path(), report) {}

  // Of the next primitive. kUnsupported: too many images.
  Result<GltfTextureUse> Add(const GltfJson* primitive);
  // After the last one: whether the mesh is textured: some primitive shows an image, or all have
  // coordinates. Then `uses` are final.
  bool Finish();
  void PutInto(MeshHeader* header) const;
  // Pages of primitives that have coordinates and show no image.
  uint32_t other_page() const { return has_images_ ? TextureCorner::kNoPage : 0; }
  // Materials and images that became pages.
  size_t materials() const { return materials_.size(); }
  size_t images() const { return images_.size(); }

 private:
  // The image of a texture, where there is one.
  Result<uint32_t> PageOf(uint64_t texture);
  // Of the image `number`, wherever its bytes are.
  Result<uint32_t> AddImage(uint64_t number);
  Texture TextureOf(const GltfJson* image, uint64_t number) const;
  Status Transform(const GltfJson* info, GltfTextureUse* use, uint64_t* set) const;

  const GltfDocument& document_;
  const InputFile& file_;
  MeshReadReport* report_;
  TexturePages pages_;
  std::map<uint64_t, uint32_t> images_;  // and their pages
  std::set<uint64_t> materials_;
  uint64_t primitives_ = 0, with_coordinates_ = 0;
  bool has_images_ = false;
};

}  // namespace mtdb::internal
