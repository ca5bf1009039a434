// Catalog: published, building and garbage objects, and the removal of what nobody wants.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/internal/catalog_entry.h"
#include "store/internal/environment.h"
#include "store/object_record.h"

namespace mtdb {

struct CatalogListing {
  std::vector<ObjectRecord> objects;  // by name
  std::vector<std::pair<ObjectId, PendingEntry>> building;
  std::vector<std::pair<ObjectId, PendingEntry>> garbage;
};

// Every entry; the first that fails its checks is the error.
Result<CatalogListing> ListCatalog(const Snapshot& snapshot);

// The same, one entry at a time: `fail` gets what a bad entry gives, and the walk goes on.
Status ListCatalogLeniently(const Snapshot& snapshot, CatalogListing* listing,
                            const std::function<void(const Status&)>& fail);

Result<std::optional<ObjectRecord>> FindObject(const Snapshot& snapshot, const std::string& name);

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

}  // namespace mtdb
