// SPDX-License-Identifier: Apache-2.0
// The header of a PLY file.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "codecs/mesh_file/input/file_io.h"
#include "store/base/attributes.h"
#include "store/base/status.h"

namespace mtdb::internal {

enum class PlyEncoding { kAscii, kBinaryLittleEndian, kBinaryBigEndian };

struct PlyProperty {
  std::string name;
  ScalarType type = ScalarType::kFloat32;  // of the value, or of a list's items
  bool is_list = false;
  bool declared_float = false;                 // read as float64 all the same
  ScalarType count_type = ScalarType::kUint8;  // lists only
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;
  std::vector<PlyProperty> properties;

  bool has_list() const;
  // Of one element: the least size in binary (a list is its count), its size when has_list() is
  // false.
  uint64_t min_bytes() const;
};

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::kAscii;
  std::vector<PlyElement> elements;  // in file order
  uint64_t body_offset = 0;
  uint64_t line_count = 0;  // of the header
  // What comments "TextureFile" name, in their order.
  std::vector<std::string> texture_files;

  const PlyElement* Find(const std::string& name) const;
};

// Checks the header's grammar, and the counts against the bytes that follow it.
Result<PlyHeader> ReadPlyHeader(const InputFile& file);

}  // namespace mtdb::internal
