// SPDX-License-Identifier: Apache-2.0
// Catalog: published, building and garbage objects, and the removal of what nobody wants.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/lmdb/environment.h"
#include "store/object_record.h"
#include "store/pages/catalog_entry.h"

namespace mtdb::internal {

struct CatalogListing {
  std::vector<ObjectRecord> objects;  // by name
  std::vector<std::pair<ObjectId, PendingEntry>> building;
  std::vector<std::pair<ObjectId, PendingEntry>> garbage;
};

// Gets what a bad entry gives.
using EntryFailure = std::function<void(const Status&)>;

// Every entry of the newest catalog, each as of a moment during the call; an object that is there
// all the time is there once. A bad entry goes to `fail`, and the walk goes on.
Result<CatalogListing> ListCatalog(Environment& environment, const EntryFailure& fail);
// The same of one snapshot.
Status ListCatalog(const Snapshot& snapshot, CatalogListing* listing, const EntryFailure& fail);

Result<std::optional<ObjectRecord>> FindObject(const Snapshot& snapshot, const std::string& name);
// In the newest snapshot.
Result<std::optional<ObjectRecord>> FindObject(Environment& environment, const std::string& name);

// In a write transaction.
Result<std::optional<ObjectRecord>> FindObject(WriteTransaction& write, const std::string& path,
                                               const std::string& name);
// Object entry -> garbage entry.
Status MakeGarbage(WriteTransaction& write, const ObjectRecord& record);

// Deletes the object's values in bounded transactions, then the building or garbage entry. Nothing
// without such an entry: the object may have been published, though its builder was told otherwise.
Status RemoveRemains(Environment& environment, ObjectId id);

// RemoveRemains for what dead builders and removers left. What live ones hold is skipped.
Status RemoveDead(Environment& environment);

}  // namespace mtdb::internal
