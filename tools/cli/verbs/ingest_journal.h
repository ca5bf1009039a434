// SPDX-License-Identifier: Apache-2.0
// The journals of ingests: where they lie, whose they are.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "store/object_record.h"

namespace mtdb {

// The store file that `path` stands for, links followed; it need not exist. Two names of one file
// give one path.
std::string RealStorePath(const std::string& path);

// The folder that a path lies in.
std::string FolderOf(const std::string& path);

// Where the finished tiles of an object are noted down. `store` is a real path.
std::string JournalPath(const std::string& folder, const std::string& store,
                        const std::string& name);

// What an ingest that was interrupted, or runs, has left in a folder.
struct IngestJournal {
  std::string path;
  std::string object;   // empty: it tells nothing
  std::string folder;   // where the ingest was started
  std::string command;  // that goes on with it; empty when it would be too long
  uint64_t bytes = 0;
  bool running = false;
};

// What a journal keeps of its ingest, for FindJournals(): BuildOptions::journal_note.
std::string JournalNote(const std::string& store, const std::string& object,
                        const std::string& command);

// Journals of `store`, a real path, in `folder`; by path. Files that cannot be read are left out.
// Journals of ingests that ended with one of the objects in the store, `published`, are removed.
std::vector<IngestJournal> FindJournals(const std::string& folder, const std::string& store,
                                        std::span<const ObjectRecord> published);

}  // namespace mtdb
