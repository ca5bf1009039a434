// SPDX-License-Identifier: Apache-2.0
// TileFiles: the files of a tree of tiles by their names, from a folder or an archive.
#pragma once

#include <memory>
#include <string>

#include "store/base/json.h"
#include "store/base/status.h"

namespace mtdb {

class TileFiles {
 public:
  virtual ~TileFiles() = default;
  // kNotFound, kBadInput (a name that leads out of the tree, what is no file), those of reading.
  virtual Result<std::string> Read(const std::string& name) const = 0;
};

// A folder, or an archive .3tz or .pmtiles. kNotFound, kCorrupt.
Result<std::unique_ptr<TileFiles>> OpenTileFiles(const std::string& path);

}  // namespace mtdb
