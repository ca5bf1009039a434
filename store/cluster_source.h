// ClusterSource: where the query engine gets units from. LMDB stands behind it today
// (Database::OpenObject); an object store or HTTP ranges can tomorrow.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "store/base/bytes.h"
#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/object_record.h"

namespace mtdb {

// One published object, as it was when it was opened. Safe for many threads.
class ClusterSource {
 public:
  virtual ~ClusterSource() = default;

  virtual const ObjectRecord& record() const = 0;
  virtual const ClusterIndex& index() const = 0;

  // Reads payloads, in any order, and hands each one to `receive` (on the calling thread) once its
  // checksum has been verified. An error of `receive` stops the batch and is returned.
  // Errors: kCorrupt (names object, unit, offset), kNotFound (the object was removed since),
  // kIoError.
  using Receiver = std::function<Status(UnitId, Bytes payload)>;
  virtual Status Read(std::span<const UnitId> units, const Receiver& receive) = 0;

  // Bytes that were read so far from where the units lie: payloads, checksums and what leads to
  // them, by all handles of the process on the same store. 0 when the source does not count.
  virtual uint64_t bytes_read() const { return 0; }
};

}  // namespace mtdb
