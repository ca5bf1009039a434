// SPDX-License-Identifier: Apache-2.0
// MaterialFiles: the images of the materials of OBJ files, from their MTL files.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Of each material, what map_Kd names. Everything else in the files is left out.
class MaterialFiles {
 public:
  struct Material {
    std::string folder;  // of the MTL file
    std::string image;   // as it stands there; empty: none
  };
  // The files that a statement "mtllib" in `folder` names: one, whose name may have blanks, or
  // several. What is missing or damaged is no error, and goes into the report.
  void ReadNamed(const std::string& folder, std::string_view names, MeshReadReport* report);
  // Null when no file has it. Of two of a name, the first one counts.
  const Material* Find(const std::string& name) const;
  const std::unordered_map<std::string, Material>& all() const { return materials_; }

 private:
  void Read(const std::string& path, MeshReadReport* report);
  std::unordered_map<std::string, Material> materials_;
};

// "name" of a statement's rest: without what surrounds it.
std::string_view TrimmedName(std::string_view rest);
// The file's name behind the options of a map: "name" of "-s 1 1 1 -clamp on name". `has_options`
// is set when some that move the image are there.
std::string_view NameBehindOptions(std::string_view rest, bool* has_options);

}  // namespace mtdb::internal
