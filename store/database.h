// Database: one store file (LMDB, MDB_NOSUBDIR) of any number of objects. Start here.
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

class Environment;
class ObjectWriter;

struct OpenOptions {
  bool writable = false;  // false: the file must exist and is not changed
  bool create = true;     // with writable: makes the file when it is not there
};

// Safe for many threads, and for many processes on one file. One Database per file and process is
// enough: opening a file that this process has open shares the environment. Reading needs leave to
// read the file and nothing else, keeps nothing from writers, and goes on in a forked child;
// writing needs a Database that the process opened itself.
class Database {
 public:
  // Checks the size and both meta pages; with `writable` also walks the tree pages, since LMDB
  // trusts them. Errors: kNotFound, kCorrupt, kUnsupported, kIoError, kBusy (another program writes
  // the file by another name).
  static Result<std::shared_ptr<Database>> Open(const std::string& path,
                                                const OpenOptions& options = {});
  ~Database();
  // Whether a file is there in which nothing was ever stored, as a process leaves it that dies
  // while it makes a store: no store yet, but Open() with `create` makes it one.
  static bool NothingStored(const std::string& path);

  const std::string& path() const;
  // Size of the file in bytes.
  Result<uint64_t> FileBytes() const;

  // Published objects, by name, each as of a moment during the call.
  Result<std::vector<ObjectRecord>> List() const;
  // The object of that name; with an empty name, the store's only object.
  Result<ObjectRecord> Find(const std::string& name) const;
  // Loads the record and the cluster index.
  Result<std::shared_ptr<ClusterSource>> OpenObject(const std::string& name) const;

  // Begins an object in the state "building". Fails with kAlreadyExists when `name` is published
  // and not `replace`, with kBusy while a live process builds that name. What a dead builder left
  // of that name is removed. Writable databases only.
  Result<std::unique_ptr<ObjectWriter>> Create(const std::string& name, bool replace);

  // Takes the object out of the catalog, then frees its pages in bounded transactions.
  Status Remove(const std::string& name);

 private:
  explicit Database(std::shared_ptr<Environment> environment);
  std::shared_ptr<Environment> environment_;
};

// Called with the whole record when everything is written but the catalog's entry.
using BeforePublish = std::function<Status(const ObjectRecord&)>;

// Writes one object. Clusters come finest round first; within a round with ascending `hilbert`.
// Destroyed before Publish(): what it wrote is removed. Single thread.
class ObjectWriter {
 public:
  virtual ~ObjectWriter() = default;

  // Appends a cluster, or, when `entry` has no nodes, a piece of the root: after the last cluster.
  // Returns its id: 0, 1, 2, ... `children` ascending and without repetition. A payload has 1 byte
  // to 1 GiB.
  virtual Result<UnitId> Add(const UnitEntry& entry, std::span<const UnitId> children,
                             ByteSpan payload) = 0;
  // Writes the index and flips the catalog. `record` comes without id, name, payload_bytes,
  // stored_bytes, index_checksum and digest; the published record is returned. A replaced object's
  // pages are freed. An error of `before` is returned, and nothing is published.
  virtual Result<ObjectRecord> Publish(const ObjectRecord& record,
                                       const BeforePublish& before = {}) = 0;
};

}  // namespace mtdb
