// SPDX-License-Identifier: Apache-2.0
// RunningHash: the Hash64 of bytes that come in parts.
#pragma once

#include <cstdint>
#include <memory>

#include "store/base/bytes.h"

namespace mtdb {

// However the bytes are cut into parts, the value is that of all of them at once. Throws
// std::bad_alloc.
class RunningHash {
 public:
  explicit RunningHash(uint64_t seed = 0);
  ~RunningHash();
  RunningHash(RunningHash&&) noexcept;
  RunningHash& operator=(RunningHash&&) noexcept;

  void Add(ByteSpan part);
  // Of what was added so far.
  uint64_t value() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace mtdb
