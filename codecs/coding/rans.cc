// SPDX-License-Identifier: Apache-2.0
#include "codecs/coding/rans.h"

#include <cmath>

namespace mtdb {

double RansEncoder::BitsSince(size_t decision) const {
  double bits = 0;
  for (size_t i = decision; i < log_.size(); ++i) bits += log_[i].bits - std::log2(log_[i].size);
  return bits;
}

Bytes RansEncoder::Finish(size_t lanes) {
  if (log_.empty()) return {};
  std::vector<uint32_t> words;  // last first
  words.reserve(log_.size() / 4 + 2 * lanes);
  std::array<uint64_t, kMaxRansLanes> states;
  states.fill(kRansLow);
  for (size_t i = log_.size(); i-- > 0;) {
    const Entry e = log_[i];
    uint64_t& state = states[e.lane];
    if (state >= uint64_t{e.size} << (63 - e.bits)) {
      words.push_back(static_cast<uint32_t>(state));
      state >>= 32;
    }
    state = ((state / e.size) << e.bits) + state % e.size + e.begin;
  }
  for (size_t lane = lanes; lane-- > 0;) {
    words.push_back(static_cast<uint32_t>(states[lane]));
    words.push_back(static_cast<uint32_t>(states[lane] >> 32));
  }
  log_.clear();
  Bytes bytes(4 * words.size());
  for (size_t i = 0; i < words.size(); ++i) {
    std::memcpy(bytes.data() + 4 * i, &words[words.size() - 1 - i], 4);
  }
  return bytes;
}

}  // namespace mtdb
