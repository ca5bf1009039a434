// SPDX-License-Identifier: Apache-2.0
// Copies of objects and of whole stores, and stores without free space.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "store/cluster_source.h"
#include "store/database.h"

namespace mtdb {

// Called again and again with bytes of payloads and textures; an error that it returns ends the
// work.
using CopyProgress = std::function<Status(uint64_t bytes_done, uint64_t bytes_total)>;

// Objects of one store at one moment.
using ObjectSources = std::vector<std::shared_ptr<ClusterSource>>;

// Copies an object into `target` under `name`: the same payloads, textures, index and digest. Every
// payload's checksum is verified on the way, and the digest of the whole before it is published.
// Errors: those of reading and of Database::Create. A source of Database::OpenAll must be of
// another store.
Result<ObjectRecord> CopyObject(ClusterSource& source, Database& target, const std::string& name,
                                bool replace, const CopyProgress& progress = {});

// Writes the objects into a new store at `path`, which appears when it is complete; until then it
// is "PATH.partial", which the next copy to that path removes if this one dies. Errors:
// kAlreadyExists, kBusy (somebody is just writing a copy there), those of CopyObject.
Status CopyToNewStore(const ObjectSources& objects, const std::string& path,
                      const CopyProgress& progress = {});

// Copies objects into the store at `path`, which is made when it is not there. Those that were
// copied before an error stay. Errors: those of CopyObject and of Database::Open.
Status CopyToStore(const ObjectSources& objects, const std::string& path, bool replace,
                   const CopyProgress& progress = {});

struct CompactReport {
  uint64_t bytes_before = 0;  // of the file
  uint64_t bytes_after = 0;
};

// Writes the store's objects into a new file without free space, "PATH.partial", which then takes
// the place of the store's file in one step: a process that dies on the way leaves the store as it
// was. The disk must have room for both. Whoever has the store open for reading goes on with the
// old file, whose space is free when the last of them closes it. Errors: kBusy when a program has
// the store open for writing; kUnsupported when the file has several names (hard links);
// kCorrupt when an object is damaged, kNoSpace, kIoError. The store is unchanged then.
Result<CompactReport> CompactStore(const std::string& path, const CopyProgress& progress = {});

}  // namespace mtdb
