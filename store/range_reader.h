// SPDX-License-Identifier: Apache-2.0
// RangeReader: the bytes of an immutable file, wherever it lies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

struct ByteRange {
  uint64_t offset = 0;
  uint64_t bytes = 0;
};

// Safe for many threads.
class RangeReader {
 public:
  using Answer = std::function<void(Result<Bytes>)>;
  using Ticket = uint64_t;

  virtual ~RangeReader() = default;

  // Path or URL, for messages: what the user gave.
  virtual const std::string& name() const = 0;
  virtual uint64_t size() const = 0;
  // Asks for a range of the file. `answer` is called once: during the call or later, on any thread,
  // with all of its bytes or an error. What is asked for first comes first, more or less.
  // Errors: kCorrupt (the file ends before, or is another one), kIoError, kNoSpace.
  virtual Ticket Read(ByteRange range, Answer answer) = 0;
  // Nobody wants the answer any more. It may come nevertheless. Does not wait.
  virtual void Cancel(Ticket ticket) { static_cast<void>(ticket); }
  // What came of the range is not what the file should have. Copies of it that are kept go; true
  // when there were any, so that asking once more may bring other bytes.
  virtual bool Forget(ByteRange range) {
    static_cast<void>(range);
    return false;
  }
  // Whether name() leads to another file by now, or to none; of a URL, whether an answer said so.
  virtual bool IsOutdated() const { return false; }
  // True when Read answers during the call.
  virtual bool answers_at_once() const = 0;

  // Bytes of the file that came so far, and how many times something was asked for.
  virtual uint64_t bytes_read() const = 0;
  virtual uint64_t requests() const = 0;
};

// Reads and waits.
Result<Bytes> ReadRange(RangeReader& reader, ByteRange range);

// A file by its path. Errors: kNotFound, kIoError, kInvalidArgument (a folder).
Result<std::unique_ptr<RangeReader>> OpenFileRanges(const std::string& path);

}  // namespace mtdb
