// SPDX-License-Identifier: Apache-2.0
// KeptTriangles: the triangles of an answer that waits for its vertices, in the file for what finds
// no room in memory.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "query/cache/spill_file.h"
#include "store/base/bytes.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// Lists of triangles, some 12 bytes each, of one answer after the other. One thread. A list that is
// not there any more is made again by whoever wants it.
class KeptTriangles {
 public:
  // Before an answer: no list is there. `file`: null when nothing is to be kept; what an answer
  // before took of the same file serves this one. `lists`: how many there may be; `vertices`: more
  // than any triangle names.
  void Begin(std::shared_ptr<SpillFile> file, size_t lists, uint64_t vertices);

  // False when Keep would fail.
  bool open() const;
  bool Keep(size_t list, std::span<const TriangleVertices> triangles);
  bool Has(size_t list) const { return list < lists_.size() && lists_[list].bytes > 0; }
  // How many triangles a list has that is there.
  size_t size(size_t list) const;
  // Fills in that many; false when the file has lost or changed them: then the list is there no
  // more.
  bool Read(size_t list, TriangleVertices* triangles);

 private:
  std::shared_ptr<SpillFile> file_;
  bool narrow_ = false;  // numbers fit 32 bits
  struct List {
    SpillPlace room;   // in the file
    size_t bytes = 0;  // of these; 0: it is not there
  };
  std::vector<List> lists_;
  Bytes image_;  // scratch: a checksum, then the numbers
};

}  // namespace mtdb::internal
