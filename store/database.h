// SPDX-License-Identifier: Apache-2.0
// Database: one store file (LMDB, MDB_NOSUBDIR) of any number of objects, or a packed file
// (store/packed_file.h) to read from. Start here.
//
// A reader sees an object whole or not at all: ObjectWriter writes in bounded transactions under
// the state "building" and Publish() flips the catalog entry in one last transaction. Object ids
// are never reused.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/cluster_source.h"
#include "store/object_record.h"
#include "store/object_writer.h"
#include "store/open_options.h"

namespace mtdb {

namespace internal {
class Environment;
class PackedFile;
}  // namespace internal

// Safe for many threads, and for many processes on one file. A process needs one Database for a
// file: a second one shares the environment of the first. To read takes no more than permission to
// read the file, never makes a writer wait, and also works in a forked child. To write, a process
// needs a Database that it opened itself.
class Database {
 public:
  // `path`: of a store or of a packed file, or the URL of a packed file (http, https, s3), where
  // mtdb was built with libcurl. Checks the size of the file and both meta pages, or header and
  // directory. When writable, also walks the pages of the
  // tree, since LMDB trusts them. Errors: kNotFound, kCorrupt, kUnsupported, kIoError, kNoSpace
  // (those two also of the cache's folder), kBusy (another program writes the file by another
  // name).
  static Result<std::shared_ptr<Database>> Open(const std::string& path,
                                                const OpenOptions& options = {});
  ~Database();
  // "http://...", "https://..." or "s3://...": no path.
  static bool IsUrl(const std::string& path);
  // Whether a file is there in which nothing was ever stored, as a process leaves it that dies
  // while it makes a store: no store yet, but Open() with `create` makes it one.
  static bool NothingStored(const std::string& path);

  const std::string& path() const;
  // As it was opened; another one may be opened alike.
  const OpenOptions& options() const { return options_; }
  // Size of the file in bytes.
  Result<uint64_t> FileBytes() const;

  bool is_packed() const { return packed_ != nullptr; }

  // The published objects, sorted by name; each as it was at some moment during the call.
  Result<std::vector<ObjectRecord>> List() const;
  // The object of that name; with an empty name, the store's only object.
  Result<ObjectRecord> Find(const std::string& name) const;
  // Loads the record and the cluster index. Over a URL rows of the index come as they are needed,
  // unless the whole index is asked for.
  Result<std::shared_ptr<ClusterSource>> OpenObject(const std::string& name,
                                                    bool whole_index = false) const;

  // All objects as they are at one moment, sorted by name. Where the process may write the store's
  // lock file, the moment is pinned: as long as one of the sources lives, all can be read, whatever
  // is removed or replaced, and writers do not use the pages of that moment again. The thread must
  // not write to the same store meanwhile. Elsewhere an object that was removed since cannot be
  // read to its end (kNotFound).
  Result<std::vector<std::shared_ptr<ClusterSource>>> OpenAll() const;
  // Bytes of the file that no object uses, which the next objects will fill.
  Result<uint64_t> FreeBytes() const;
  // Whether the path leads to another file by now, as after CompactStore(), or to none; of a URL,
  // whether a read has said so. What was opened goes on with the old file: open the path anew.
  bool IsOutdated() const;

  // Begins an object in the state "building", after removing what a dead builder left of that name.
  // Fails with kAlreadyExists when `name` is published and `replace` is false, and with kBusy while
  // a live process builds that name. Writable databases only.
  Result<std::unique_ptr<ObjectWriter>> Create(const std::string& name, bool replace);

  // Gives a published object another name, in one transaction. Who has it open reads on. Errors:
  // kNotFound, kAlreadyExists.
  Status Rename(const std::string& name, const std::string& new_name);

  // Takes the object out of the catalog, then frees its pages in bounded transactions.
  Status Remove(const std::string& name);

 private:
  Database(std::shared_ptr<internal::Environment> environment, OpenOptions options);
  Database(std::shared_ptr<internal::PackedFile> packed, OpenOptions options);
  Status CheckWritable() const;
  Status NoObject(const std::string& name) const;  // kNotFound, which names those that are there
  std::shared_ptr<internal::Environment> environment_;  // either this
  std::shared_ptr<internal::PackedFile> packed_;        // or this
  const OpenOptions options_;
};

}  // namespace mtdb
