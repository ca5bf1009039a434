#include "codecs/internal/rans.h"

namespace mtdb {

Bytes RansEncoder::Finish() {
  if (log_.empty()) return {};
  std::vector<uint32_t> words;  // last first
  words.reserve(log_.size() / 4 + 2);
  uint64_t state = kRansLow;
  const auto flush = [&](uint64_t limit) {
    if (state >= limit) {
      words.push_back(static_cast<uint32_t>(state));
      state >>= 32;
    }
  };
  for (size_t i = log_.size(); i-- > 0;) {
    const Entry e = log_[i];
    if (e.size & kRawFlag) {
      const int n = e.size & ~kRawFlag;
      flush(uint64_t{1} << (63 - n));
      state = state << n | e.begin;
    } else {
      flush(static_cast<uint64_t>(e.size) << (63 - kProbabilityBits));
      state = ((state / e.size) << kProbabilityBits) + state % e.size + e.begin;
    }
  }
  words.push_back(static_cast<uint32_t>(state));
  words.push_back(static_cast<uint32_t>(state >> 32));
  log_.clear();
  Bytes bytes(4 * words.size());
  for (size_t i = 0; i < words.size(); ++i) {
    std::memcpy(bytes.data() + 4 * i, &words[words.size() - 1 - i], 4);
  }
  return bytes;
}

}  // namespace mtdb
