// SPDX-License-Identifier: Apache-2.0
// Database: one store file (LMDB, MDB_NOSUBDIR) of any number of objects, or a packed file
// (store/packed_file.h) to read from. Start here.
//
// A reader sees an object whole or not at all: ObjectWriter writes in bounded transactions under
// the state "building" and Publish() flips the catalog entry in one last transaction. Object ids
// are never reused.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/cluster_source.h"
#include "store/object_record.h"

namespace mtdb {

class ObjectWriter;

namespace internal {
class Environment;
class PackedFile;
}  // namespace internal

struct OpenOptions {
  bool writable = false;  // false: the file must exist, and is not changed
  bool create = true;     // when writable: makes the file if it does not exist
  // Of a URL: what comes of the file is kept in this folder, which is made; empty: nowhere. It need
  // not come again, whoever reads the same content, from whichever URL. Databases and processes may
  // share a folder. Damaged entries come again. The first 64 KiB always come: they tell what the
  // file is.
  std::string cache_directory = {};
  // At most so much lies there, as the disk counts it, and 16 MiB more for each database that has
  // the folder open; what was not used for longest goes first.
  uint64_t cache_directory_bytes = uint64_t{4} << 30;
};

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
  std::shared_ptr<internal::Environment> environment_;  // either this
  std::shared_ptr<internal::PackedFile> packed_;        // or this
  const OpenOptions options_;
};

// Publish() calls it with the whole record, when everything is written except the catalog's entry.
using BeforePublish = std::function<Status(const ObjectRecord&)>;

// Writes one object. Clusters must come finest round first, and within a round with ascending
// `hilbert`. A writer that is destroyed before Publish() removes what it wrote. Single thread.
class ObjectWriter {
 public:
  virtual ~ObjectWriter() = default;

  // Appends a cluster, or a piece of the root when `entry` has no nodes; pieces of the root come
  // after all clusters. Returns the unit's id: 0, 1, 2, ... `children` must ascend without
  // repetition. A payload has 1 byte to 1 GiB.
  virtual Result<UnitId> Add(const UnitEntry& entry, std::span<const UnitId> children,
                             ByteSpan payload) = 0;
  // Writes the index, publishes the object in the catalog, and frees the pages of the object that
  // it replaces. Returns the published record: `record`, with id, name, payload_bytes,
  // stored_bytes, index_checksum and digest filled in. When `before` returns an error, nothing is
  // published and the error is returned.
  virtual Result<ObjectRecord> Publish(const ObjectRecord& record,
                                       const BeforePublish& before = {}) = 0;
};

}  // namespace mtdb
