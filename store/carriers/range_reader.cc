// SPDX-License-Identifier: Apache-2.0
#include "store/range_reader.h"

#include <optional>
#include <utility>

#include "store/base/threading.h"
#include "store/base/wait_scope.h"

namespace mtdb {

Result<Bytes> ReadRange(RangeReader& reader, ByteRange range) {
  struct Waiting {
    Mutex mutex;
    ConditionVariable came;
    std::optional<Result<Bytes>> bytes;
  };
  const auto waiting = std::make_shared<Waiting>();
  [[maybe_unused]] const RangeReader::Ticket ticket =
      reader.Read(range, [waiting](Result<Bytes> bytes) {
        const MutexLock lock(waiting->mutex);
        waiting->bytes.emplace(std::move(bytes));
        waiting->came.notify_all();
      });
  MutexLock lock(waiting->mutex);
#if MTDB_THREADS
  if (!WaitScope::Wait(waiting->came, lock, [&] { return waiting->bytes.has_value(); })) {
    lock.unlock();  // the answer may come during the call
    reader.Cancel(ticket);
    return Status(StatusCode::kCancelled, reader.name() + ": cancelled");
  }
#endif
  if (!waiting->bytes) return NotYet(reader.name() + ": has not answered");
  return *std::move(waiting->bytes);
}

}  // namespace mtdb
