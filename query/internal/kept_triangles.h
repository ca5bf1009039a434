// SPDX-License-Identifier: Apache-2.0
// KeptTriangles: the triangles of an answer that waits for its vertices, in the file for what finds
// no room in memory.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "query/internal/spill_file.h"
#include "store/base/bytes.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// Lists of triangles, some 12 bytes each. One thread. A list that is not there any more is made
// again by whoever wants it.
class KeptTriangles {
 public:
  // `lists`: how many there may be; `vertices`: more than any triangle names.
  KeptTriangles(std::shared_ptr<SpillFile> file, size_t lists, uint64_t vertices);
  KeptTriangles() = default;  // keeps nothing

  // False when Keep would fail.
  bool open() const;
  bool Keep(size_t list, std::span<const TriangleVertices> triangles);
  bool Has(size_t list) const { return list < places_.size() && places_[list].has_value(); }
  // How many triangles a list has that is there.
  size_t size(size_t list) const;
  // Fills in that many; false when the file has lost or changed them: then the list is there no
  // more.
  bool Read(size_t list, TriangleVertices* triangles);

 private:
  std::shared_ptr<SpillFile> file_;
  bool narrow_ = false;  // numbers fit 32 bits
  std::vector<std::optional<SpillPlace>> places_;
  Bytes image_;  // scratch: a checksum, then the numbers
};

}  // namespace mtdb::internal
