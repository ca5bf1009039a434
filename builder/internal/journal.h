// Journal: the finished tiles of a build, so that an interrupted one need not do them again.
//
// A build is deterministic, so its journal is just the list of its tiles' results in order. Going
// on means to read the input again, to take the results that are there instead of decimating, and
// to append from then on. Records carry checksums: a torn end is cut off.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "builder/internal/tile_cluster.h"
#include "store/base/status.h"

namespace mtdb {

// One tile's result.
struct TileOutcome {
  TileCluster cluster;  // without what only the encoder needs
  uint64_t locked_vertices = 0;
  uint64_t stuck_topology = 0;
  uint64_t stuck_degree = 0;
};

// A file, locked while it is open. Single thread.
class Journal {
 public:
  // Opens `path` for the build with this fingerprint (of input and options). With `resume`, a
  // journal of another build is kInvalidArgument and none at all begins a new one; without, what is
  // there is overwritten. kBusy when another process has it open.
  static Result<std::unique_ptr<Journal>> Open(const std::string& path, uint64_t fingerprint,
                                               bool resume);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // The next tile's result, or none when the journal ends here; after that, only Append.
  Result<std::optional<TileOutcome>> Next();
  Status Append(const TileOutcome& outcome);
  // Removes the file: the object is published, or nothing is worth keeping.
  void Remove();

 private:
  Journal(int file, std::string path) : file_(file), path_(std::move(path)) {}
  Status Error(const char* what, int error) const;
  Status Write(ByteSpan bytes);

  int file_;
  std::string path_;
  uint64_t at_ = 0;        // where the next record begins
  uint64_t size_ = 0;      // of what was there when it was opened
  uint64_t sequence_ = 0;  // of the next record
  uint64_t unsynced_ = 0;  // bytes
  bool reading_ = true;
};

}  // namespace mtdb
