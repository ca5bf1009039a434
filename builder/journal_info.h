// SPDX-License-Identifier: Apache-2.0
// JournalInfo: what an interrupted build has left, with which the same build goes on.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb {

// A journal that an interrupted build has left, or that a running one writes.
struct JournalInfo {
  std::string note;     // BuildOptions::journal_note
  uint64_t bytes = 0;   // size of the file
  bool in_use = false;  // a running build has locked it
  bool usable = false;  // its header is whole, and of this version
  // True when its build had published one of the objects of `published`, and was killed before it
  // removed the journal.
  bool finished = false;
};
// `published`: the objects of the store that the journal's note names. Changes nothing. Errors:
// kNotFound, kIoError.
Result<JournalInfo> ReadJournalInfo(const std::string& path,
                                    std::span<const ObjectRecord> published = {});
// Removes the journal when it is finished, or empty since its build was killed at
// once, and not in use, and when the process may remove it.
void RemoveFinishedJournal(const std::string& path, std::span<const ObjectRecord> published);

}  // namespace mtdb
