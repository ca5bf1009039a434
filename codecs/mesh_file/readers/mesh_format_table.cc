// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/readers/mesh_format_table.h"

namespace mtdb::internal {

const std::vector<MeshFormatRow>& MeshFormatTable() {
  static const std::vector<MeshFormatRow> kTable = OwnMeshFormats();
  return kTable;
}

}  // namespace mtdb::internal
