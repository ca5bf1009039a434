// SPDX-License-Identifier: Apache-2.0
// RecordedRanges: notes when requests of a carrier begin and end.
#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "store/range_reader.h"

namespace mtdb {

class RecordedRanges final : public RangeReader {
 public:
  struct Request {
    ByteRange range;
    std::chrono::steady_clock::time_point begin, end;  // end: none while it is under way
  };

  explicit RecordedRanges(std::shared_ptr<RangeReader> inner) : inner_(std::move(inner)) {}

  // Of what came from afar and not from memory.
  std::vector<Request> requests_made() const;
  // The longest chain of requests that have been answered, each begun after the one before was
  // answered; the one that opened the file counts, a connection's handshake does not.
  size_t RoundTrips() const;

  const std::string& name() const override { return inner_->name(); }
  uint64_t size() const override { return inner_->size(); }
  Ticket Read(ByteRange range, Answer answer) override;
  void Cancel(Ticket ticket) override { inner_->Cancel(ticket); }
  bool IsOutdated() const override { return inner_->IsOutdated(); }
  bool answers_at_once() const override { return inner_->answers_at_once(); }
  uint64_t bytes_read() const override { return inner_->bytes_read(); }
  uint64_t requests() const override { return inner_->requests(); }

 private:
  mutable std::mutex mutex_;
  std::vector<Request> all_;
  const std::shared_ptr<RangeReader> inner_;  // goes first: its answers come here
};

}  // namespace mtdb
