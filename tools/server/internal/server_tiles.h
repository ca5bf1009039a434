// SPDX-License-Identifier: Apache-2.0
// /objects/NAME/3dtiles/... and its like: an object as the tree of tiles that `mtdb tile` writes,
// file by file.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "store/base/status.h"
#include "store/object_record.h"
#include "tools/server/http/server_request.h"
#include "tools/server/internal/named_locks.h"
#include "tools/server/internal/server_metrics.h"
#include "tools/tiles/tile_choice.h"
#include "tools/tiles/tile_files.h"

namespace mtdb::internal {

// /objects/NAME/FORMAT/FILE, or /objects/NAME/FORMAT/OPTIONS/FILE with OPTIONS as in
// "at=11.6,48.1,520&pixels=4".
struct TileTarget {
  TileChoice choice;
  std::string file;     // in the tree
  std::string version;  // the parameter v; empty: whatever the object is now
};
bool IsTileTarget(const RequestTarget& target);
// kInvalidArgument, with a message that begins with the option.
Result<TileTarget> ParseTileTarget(const RequestTarget& target);

// What a file of a tree follows from, as an ETag: the object's version and all options. `tree`: the
// same of the tree, with its kind.
std::string TileTag(const ObjectRecord& record, const std::string& tree, const std::string& file);
// Whether the header If-None-Match has the tag.
bool HasTag(const std::string& if_none_match, const std::string& tag);
// The file that names the others.
const char* FirstFileOf(const TileChoice& choice);
const char* TileContentType(const std::string& file);

// The trees that were asked for last. Safe for many threads.
class ServedTiles {
 public:
  using Tree = std::shared_ptr<const TileFiles>;
  // All trees together may take so much of temporary files.
  explicit ServedTiles(uint64_t most_bytes) : most_bytes_(most_bytes) {}

  // The tree of this name, or what `make` gives: one thread at a time makes a tree, the others
  // wait. `bytes`: about what it will take; for it those give way that were used longest ago.
  // kUnsupported: it is more than there may be at all; kBusy: trees that are being made have it.
  Result<Tree> Open(const std::string& name, uint64_t bytes,
                    const std::function<Result<std::unique_ptr<TileFiles>>()>& make);
  ServerMetrics::Shared figures();

 private:
  struct Entry {
    std::string name;
    Tree tree;
  };
  Tree Find(const std::string& name);
  Status Reserve(uint64_t bytes);

  const uint64_t most_bytes_;
  NamedLocks making_;
  std::mutex mutex_;
  std::vector<Entry> entries_;   // the last used last
  uint64_t reserved_bytes_ = 0;  // for those that are being made
  uint64_t evictions_ = 0;
};

}  // namespace mtdb::internal
