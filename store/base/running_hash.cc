// SPDX-License-Identifier: Apache-2.0
#include "store/base/running_hash.h"

#include <xxhash.h>

#include "store/base/out_of_memory.h"

namespace mtdb {

struct RunningHash::State {
  State() : xxh(XXH3_createState()) {
    if (xxh == nullptr) ThrowOutOfMemory();
  }
  ~State() { XXH3_freeState(xxh); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;

  XXH3_state_t* const xxh;
};

RunningHash::RunningHash(uint64_t seed) : state_(std::make_unique<State>()) {
  XXH3_64bits_reset_withSeed(state_->xxh, seed);
}

RunningHash::~RunningHash() = default;
RunningHash::RunningHash(RunningHash&&) noexcept = default;
RunningHash& RunningHash::operator=(RunningHash&&) noexcept = default;

void RunningHash::Add(ByteSpan part) { XXH3_64bits_update(state_->xxh, part.data(), part.size()); }

uint64_t RunningHash::value() const { return XXH3_64bits_digest(state_->xxh); }

}  // namespace mtdb
