// SPDX-License-Identifier: Apache-2.0
// ClusterSource: where the query engine gets units from. A store stands behind it
// (Database::OpenObject); an object store or HTTP ranges can.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "store/base/bytes.h"
#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/object_record.h"

namespace mtdb {

// Takes the answers to one Read.
class PayloadReceiver {
 public:
  virtual ~PayloadReceiver() = default;
  // A unit's payload after its checksum has been verified, or why it cannot be had. Must not wait
  // for another answer.
  virtual void Receive(UnitId unit, Result<Bytes> payload) = 0;
};

// One published object, as it was when it was opened. Safe for many threads.
class ClusterSource {
 public:
  virtual ~ClusterSource() = default;

  virtual const ObjectRecord& record() const = 0;
  // Its rows are there from the beginning, or come with the answers and stay. The rows of the
  // root's pieces and of their children are there in any case; when a unit is answered, those of
  // the unit, its parents and its children. A failed answer promises none. So a query that holds a
  // unit knows what may come next, and nothing has to be waited for but payloads.
  virtual const ClusterIndex& index() const = 0;

  // Asks for the payloads of a batch. Each unit is answered once, in any order: during the call or
  // later, on any thread. Units fail one by one. Errors: kInvalidArgument (no such unit), kCorrupt
  // (names object, unit, offset), kNotFound (the object was removed since), kIoError.
  virtual void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) = 0;
  // What was asked for this receiver and is not answered is not wanted any more. Does not wait; the
  // answers that come nevertheless are ignored.
  virtual void Cancel(const PayloadReceiver& receiver) { static_cast<void>(receiver); }
  // True when Read answers all during the call: nothing is gained by asking ahead.
  virtual bool answers_at_once() const { return false; }

  // Bytes of a file of the object's texture (TextureRecord::file). Waits for them. A
  // whole file is held against the record's checksum, part of one only as far as that is possible;
  // store/texture_pages.h reads files in parts and checks them. Errors: kInvalidArgument (no such
  // file, or bytes beyond its end), kUnsupported (the source has none), kCorrupt, kNotFound
  // (the object was removed since), kIoError; they name the object and the file.
  virtual Result<Bytes> ReadTextureFile(uint32_t file, uint64_t offset, uint64_t bytes);

  // Bytes that were read so far from where the units lie: payloads, checksums and what leads to
  // them, by all handles of the process on the same store. 0 when the source does not count.
  virtual uint64_t bytes_read() const { return 0; }
};

// Reads a batch and waits for it. `receive` is called on this thread, in the order of the answers;
// its error, or the first failed unit's, ends the reading and is returned. Without threads
// (store/base/threading.h) for sources that answer at once.
Status ReadUnits(ClusterSource& source, std::span<const UnitId> units,
                 const std::function<Status(UnitId, Bytes)>& receive);

}  // namespace mtdb
