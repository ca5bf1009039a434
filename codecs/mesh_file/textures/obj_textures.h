// SPDX-License-Identifier: Apache-2.0
// ObjTextures: what an OBJ file says of texture coordinates and materials.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/mesh_file.h"
#include "codecs/mesh_file/textures/corner_table.h"
#include "codecs/mesh_file/textures/material_file.h"
#include "codecs/mesh_file/textures/texture_pages.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// It is shown the file's statements in two passes: the first one collects coordinates and
// materials, the second one gives faces their corners.
class ObjTextures {
 public:
  ObjTextures(const std::string& path, const ReaderSpace& tmp, MeshReadReport* report)
      : path_(path), report_(report), table_(tmp), pages_(path, report) {}

  // First pass: any statement; `rest` is what is behind its word. Errors: those of CornerTable.
  Status Scan(std::string_view word, std::string_view rest);
  // After the first pass: reads the material files, and looks at the images of the materials that
  // faces use.
  Status Finish();
  // After Finish(): some face has texture coordinates.
  bool are_used() const { return is_used_; }
  void PutInto(MeshHeader* header) const;
  uint64_t temporary_bytes() const { return table_.temporary_bytes(); }

  // Second pass, of are_used(): whether the statement is one of textures and not of faces.
  bool Follow(std::string_view word, std::string_view rest);
  // Whether all corners of a face have texture coordinates.
  static bool HasAll(LineTokens corners);
  // Of a corner as it is written: "1/2/3". A number that no coordinates have gives NaN.
  Status Corner(std::string_view token, TextureCorner* corner);

 private:
  // "2" of "1/2/3".
  static std::string_view Reference(std::string_view token);
  Result<uint32_t> PageOf(const std::string& material);

  std::string path_;
  MeshReadReport* report_;
  CornerTable table_;
  TexturePages pages_;
  std::vector<std::string> libraries_;  // what statements "mtllib" name
  // The materials of faces with coordinates, and their pages; in the order of the file in used_.
  std::map<std::string, uint32_t, std::less<>> materials_;
  std::vector<std::string> used_;
  std::string current_;    // first pass
  bool is_noted_ = false;  // current_ is in used_
  bool is_used_ = false;
  uint32_t page_ = 0;  // second pass
  uint64_t seen_ = 0;  // coordinates; second pass
};

}  // namespace mtdb::internal
