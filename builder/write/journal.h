// SPDX-License-Identifier: Apache-2.0
// Journal: the finished tiles of a build, so that an interrupted one need not do them again.
//
// A build is deterministic, so its journal is just the list of its tiles' results in order. Going
// on means to read the input again, to take the results that are there instead of decimating, and
// to append from then on.
//
// Nothing is believed that was not written whole: each record's checksum is seeded with the one
// before it, the first with the header's. So a record serves only when all before it are there, in
// their order, and of this build; from the first that is torn, zeroed or misplaced on, the file is
// cut off. Before the object is published, its digest is noted in the header, so that whoever finds
// the journal of a build that was killed after that knows it for finished. The file and its name
// reach the disk at the beginning, its records every 64 MiB: a power failure costs the work since
// then, a killed process none.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "builder/build_options.h"
#include "builder/disk/spool.h"
#include "builder/journal_info.h"
#include "builder/write/tile_cluster.h"
#include "store/base/status.h"

namespace mtdb::internal {

// What a journal stands on: a build whose key differs can take nothing from it.
struct JournalKey {
  uint64_t options = 0;  // hash of those that shape the result
  uint64_t input = 0;    // hash of the joined triangles in order, with their attributes
};

// A file, locked while it is open. Single thread.
class Journal {
 public:
  // Opens options.journal_path for the build of this key. With `resume`, a journal of another build
  // is kInvalidArgument, which says what differs, and none at all, or one without a whole header,
  // begins a new one; without, what is there is overwritten. kBusy when another process has it
  // open. The note is kept for ReadJournalInfo(). The journal counts among the files of `space`.
  static Result<std::unique_ptr<Journal>> Open(const BuildOptions& options, const JournalKey& key,
                                               const SpoolSpace* space);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // The next tile's result, or none when the journal ends here; after that, only Append.
  Result<std::optional<TileOutcome>> Next();
  // Errors: those of writing, and of SpoolSpace::Take.
  Status Append(const TileOutcome& outcome);
  // Notes what is about to be published, on the disk when this returns.
  Status Finish(const ObjectRecord& record);
  // Removes the file: the object is published, or never will be.
  void Remove();

 private:
  Journal(std::string path, const SpoolSpace* space) : path_(std::move(path)), space_(space) {}
  Status Error(const char* what, int error) const;
  Status Lock();
  Status CheckContent() const;
  Status Begin(const JournalKey& key, const std::string& note);
  Status Write(ByteSpan bytes);
  Status Sync();

  int file_ = -1;
  std::string path_;
  const SpoolSpace* space_;
  uint64_t counted_ = 0;   // of the bytes, in space_
  uint64_t at_ = 0;        // where the next record begins
  uint64_t size_ = 0;      // of what was there when it was opened
  uint64_t chain_ = 0;     // checksum of what is before at_
  uint64_t checksum_ = 0;  // the header's
  uint64_t unsynced_ = 0;  // bytes
  bool reading_ = true;
};

}  // namespace mtdb::internal
