// SPDX-License-Identifier: Apache-2.0
#include "tests/query/late_source.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

namespace mtdb::testing {

LateSource::LateSource(std::shared_ptr<ClusterSource> whole, LateOptions options)
    : whole_(std::move(whole)),
      options_(std::move(options)),
      index_(options_.late_rows
                 ? ClusterIndex(whole_->index().cluster_count(), whole_->index().root_piece_count(),
                                whole_->index().root_vertices())
                 : whole_->index()),
      random_(options_.seed) {
  for (UnitId u = index_.cluster_count(); u < index_.unit_count(); ++u) PutFamily(u, 1);
  if (options_.own_thread) {
    thread_ = std::thread([this] {
      std::unique_lock lock(mutex_);
      while (!stopping_) {
        if (open_.empty()) {
          asked_.wait(lock);
          continue;
        }
        lock.unlock();
        AnswerOne();
        lock.lock();
      }
    });
  }
}

LateSource::~LateSource() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  asked_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void LateSource::Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) {
  ++batches_;
  largest_batch_ = std::max<size_t>(largest_batch_, units.size());
  for (size_t i = 1; i < units.size(); ++i) {
    if (!index_.Has(units[i - 1]) || !index_.Has(units[i])) continue;
    const PayloadLocation& a = index_.location(units[i - 1]);
    const PayloadLocation& b = index_.location(units[i]);
    if (std::pair(a.value, a.offset) > std::pair(b.value, b.offset)) in_order_ = false;
  }
  const std::lock_guard lock(mutex_);
  for (const UnitId u : units) open_.push_back({u, receiver});
  asked_.notify_all();
}

void LateSource::Cancel(const PayloadReceiver& receiver) {
  const std::lock_guard lock(mutex_);
  cancelled_ +=
      std::erase_if(open_, [&](const Question& q) { return q.receiver.get() == &receiver; });
}

size_t LateSource::open() const {
  const std::lock_guard lock(mutex_);
  return open_.size();
}

size_t LateSource::Pump(size_t count) {
  size_t done = 0;
  while (done < count && AnswerOne()) ++done;
  return done;
}

bool LateSource::AnswerOne() {
  Question question;
  {
    const std::lock_guard lock(mutex_);
    if (open_.empty()) return false;
    std::swap(open_[random_() % open_.size()], open_.back());
    question = std::move(open_.back());
    open_.pop_back();
  }
  const UnitId unit = question.unit;
  if (options_.fails) {
    if (Status status = options_.fails(unit); !status.ok()) {
      question.receiver->Receive(unit, std::move(status));
      return true;
    }
  }
  Status status = ReadUnits(*whole_, {&unit, 1}, [&](UnitId, Bytes payload) {
    PutRows(unit);
    if (options_.twice && unit % 3 == 0) question.receiver->Receive(unit, payload);
    question.receiver->Receive(unit, std::move(payload));
    return Status::Ok();
  });
  if (!status.ok()) question.receiver->Receive(unit, std::move(status));
  return true;
}

// What a source promises with its answer.
void LateSource::PutRows(UnitId unit) {
  PutFamily(unit, 1);
  for (const UnitId u : whole_->index().parents(unit)) PutFamily(u, 0);
}

void LateSource::PutFamily(UnitId unit, int generations) {
  if (!options_.late_rows) return;
  const ClusterIndex& all = whole_->index();
  {
    const std::lock_guard lock(rows_mutex_);
    index_.Put(unit, all.unit(unit), all.location(unit), all.first_vertex(unit), all.children(unit),
               all.parents(unit), all.error_code_below(unit));
  }
  if (generations == 0) return;
  for (const UnitId u : all.children(unit)) PutFamily(u, generations - 1);
}

std::shared_ptr<ClusterSource> AsTested(std::shared_ptr<ClusterSource> source) {
  if (std::getenv("MTDB_LATE_SOURCE") == nullptr) return source;
  return std::make_shared<LateSource>(std::move(source), LateOptions{});
}

}  // namespace mtdb::testing
