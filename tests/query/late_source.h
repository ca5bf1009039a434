// SPDX-License-Identifier: Apache-2.0
// LateSource: a source that answers late, out of order, not at all when cancelled, and with errors
// where the test wants them; its index has the rows that it has answered for, and no others.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <random>
#include <span>
#include <thread>
#include <vector>

#include "store/cluster_source.h"

namespace mtdb::testing {

struct LateOptions {
  uint64_t seed = 1;
  // False: answers come when the test calls Pump.
  bool own_thread = true;
  // Rows of the index come with the answers.
  bool late_rows = true;
  // Some units are answered twice.
  bool twice = false;
  // The error of a unit's read, decided when it is answered.
  std::function<Status(UnitId)> fails = {};
};

class LateSource final : public ClusterSource {
 public:
  // `whole` answers at once and has its whole index.
  LateSource(std::shared_ptr<ClusterSource> whole, LateOptions options);
  ~LateSource() override;

  const ObjectRecord& record() const override { return whole_->record(); }
  const ClusterIndex& index() const override { return index_; }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override;
  void Cancel(const PayloadReceiver& receiver) override;
  Result<Bytes> ReadTextureFile(uint32_t page, uint64_t offset, uint64_t bytes) override {
    return whole_->ReadTextureFile(page, offset, bytes);
  }

  // Answers up to `count` of what is asked for; returns how many it did.
  size_t Pump(size_t count);
  // Asked for, neither answered nor cancelled.
  size_t open() const;
  uint64_t batches() const { return batches_; }
  size_t largest_batch() const { return largest_batch_; }
  uint64_t cancelled() const { return cancelled_; }
  // The units of each batch were in the order of their places.
  bool in_order() const { return in_order_; }

 private:
  struct Question {
    UnitId unit;
    std::shared_ptr<PayloadReceiver> receiver;
  };
  bool AnswerOne();
  void PutRows(UnitId unit);
  void PutFamily(UnitId unit, int generations);

  const std::shared_ptr<ClusterSource> whole_;
  const LateOptions options_;
  ClusterIndex index_;
  std::mutex rows_mutex_;
  mutable std::mutex mutex_;
  std::condition_variable asked_;
  std::vector<Question> open_;
  std::mt19937_64 random_;
  std::atomic<uint64_t> batches_{0};
  std::atomic<size_t> largest_batch_{0};
  std::atomic<uint64_t> cancelled_{0};
  std::atomic<bool> in_order_{true};
  bool stopping_ = false;
  std::thread thread_;
};

// What a test opens: the source itself, or, when MTDB_LATE_SOURCE is set, a late one before it.
std::shared_ptr<ClusterSource> AsTested(std::shared_ptr<ClusterSource> source);

}  // namespace mtdb::testing
