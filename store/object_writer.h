// SPDX-License-Identifier: Apache-2.0
// ObjectWriter: writes one object; Database::Create makes one.
#pragma once

#include <functional>
#include <span>

#include "store/base/bytes.h"
#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/object_record.h"

namespace mtdb {

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
  // Appends bytes to a file of the object's texture (TextureRecord::file). Files come in ascending
  // order, each with one part after the other, before or between units. Nothing needs to be added
  // of a file without bytes. An image has at most 1 GiB (store/texture_pages.h).
  virtual Status AddTextureFile(uint32_t file, ByteSpan part) = 0;
  // Writes the index, publishes the object in the catalog, and frees the pages of the object that
  // it replaces. Returns the published record: `record`, with id, name, payload_bytes,
  // stored_bytes, index_checksum and digest filled in. kInvalidArgument when what was added is not
  // what the record says: units, and of each file of the texture the bytes and their checksum. When
  // `before` returns an error, nothing is published and the error is returned.
  virtual Result<ObjectRecord> Publish(const ObjectRecord& record,
                                       const BeforePublish& before = {}) = 0;
};

}  // namespace mtdb
