// SPDX-License-Identifier: Apache-2.0
// The desk alone, over a source that answers what the test tells it to.
#include "query/cache/payload_desk.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

#include "store/base/out_of_memory.h"
#include "tests/query/mt_fixture.h"
#include "tests/support/failing_allocation.h"

namespace mtdb::testing {

using namespace internal;

namespace {

class AskedSource final : public ClusterSource {
 public:
  explicit AskedSource(std::shared_ptr<MemoryClusterSource> whole) : whole_(std::move(whole)) {}
  const ObjectRecord& record() const override { return whole_->record_; }
  const ClusterIndex& index() const override { return whole_->index_; }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override {
    asked_.emplace_back(units.begin(), units.end());
    receivers_.push_back(std::move(receiver));
  }
  void Cancel(const PayloadReceiver& receiver) override {
    if (cancelled_ != nullptr) cancelled_->push_back(&receiver);
  }
  size_t length(UnitId unit) const { return whole_->index_.location(unit).length; }

  std::vector<std::vector<UnitId>> asked_;
  std::vector<std::shared_ptr<PayloadReceiver>> receivers_;  // of these
  std::vector<const PayloadReceiver*>* cancelled_ = nullptr;

 private:
  const std::shared_ptr<MemoryClusterSource> whole_;
};

struct World {
  explicit World(size_t limit = size_t{1} << 30)
      : f(MakeTorus(20, 16)),
        source(std::make_shared<AskedSource>(f.source)),
        user(std::make_shared<CacheUser>(f.source->record_, f.source->index_.unit_count(),
                                         ReaderLimits{})),
        budget(limit),
        desk(std::in_place, source, budget, changed,
             [this](PayloadDesk::Batch& batch, UnitId unit, const Result<Bytes>&) {
               if (desk->TakeOff(batch, unit)) arrived.push_back(unit);
             }) {
    arrived.reserve(1000);
    source->cancelled_ = &cancelled;
    cancelled.reserve(1000);
  }
  PayloadDesk::BatchPtr Ask(const std::vector<UnitId>& units, Asking asking = Asking::kToWait) {
    const auto batch = desk->NewBatch(units.size(), user, asking);
    for (const UnitId u : units) desk->Expect(batch, u, desk->SizeOf(u));
    MutexLock lock(mutex);
    desk->Send(batch, lock);
    return batch;
  }
  void Tell() {
    MutexLock lock(mutex);
    desk->TellSource(lock);
  }
  size_t Length(const std::vector<UnitId>& units) const {
    size_t sum = 0;
    for (const UnitId u : units) sum += source->length(u);
    return sum;
  }
  Payload PayloadOf(UnitId unit) const {
    return std::make_shared<const Bytes>(f.source->payloads_[unit]);
  }

  MtFixture f;
  std::shared_ptr<AskedSource> source;
  CacheUserPtr user;
  Mutex mutex;
  ConditionVariable changed;
  ByteBudget budget;
  std::vector<UnitId> arrived;
  std::vector<const PayloadReceiver*> cancelled;
  std::optional<PayloadDesk> desk;
};

}  // namespace

TEST_CASE("A batch is asked for in the order of the places, and counts until it is answered") {
  World w;
  std::vector<UnitId> units{5, 2, 9, 0, 7};
  const auto batch = w.Ask(units);
  REQUIRE(w.source->asked_.size() == 1);
  std::ranges::sort(units, {}, [&](UnitId u) {
    const PayloadLocation& at = w.f.source->index_.location(u);
    return std::tuple(at.value, at.offset, u);
  });
  REQUIRE(w.source->asked_[0] == units);
  REQUIRE(w.budget.used() == w.Length(units));
  REQUIRE(w.desk->bytes_on_their_way() == w.Length(units));
  for (const UnitId u : units) REQUIRE(w.desk->Expects(*batch, u));
  REQUIRE(!w.desk->on_its_way(1));
  batch->Receive(9, Bytes());
  batch->Receive(9, Bytes());  // once more
  batch->Receive(1, Bytes());  // nobody asked
  batch->Receive(100'000, Bytes());
  batch->Receive(2, IoError("not now"));
  REQUIRE(w.arrived == std::vector<UnitId>{9, 2});
  REQUIRE(w.budget.used() == w.Length({5, 0, 7}));
  for (const UnitId u : {5, 0, 7}) batch->Receive(u, Bytes());
  REQUIRE(w.budget.used() == 0);
  REQUIRE(w.desk->bytes_on_their_way() == 0);
  REQUIRE(w.cancelled.empty());
}

TEST_CASE("What was withdrawn is told to the source, and does not arrive") {
  World w;
  const auto waited = w.Ask({1, 2}), first = w.Ask({3, 4}, Asking::kAhead),
             second = w.Ask({5}, Asking::kAhead);
  REQUIRE(w.desk->WithdrawAhead());  // the oldest
  REQUIRE(!w.desk->on_its_way(3));
  REQUIRE(w.desk->on_its_way(5));
  first->Receive(3, Bytes());
  REQUIRE(w.arrived.empty());
  REQUIRE(w.cancelled.empty());
  w.Tell();
  w.Tell();
  REQUIRE(w.cancelled == std::vector<const PayloadReceiver*>{first.get()});
  // It can be asked for again, and the old answer is still none.
  const auto again = w.Ask({3});
  first->Receive(3, Bytes());
  REQUIRE(w.arrived.empty());
  again->Receive(3, Bytes());
  REQUIRE(w.arrived == std::vector<UnitId>{3});
  REQUIRE(w.desk->WithdrawAhead());
  REQUIRE(!w.desk->WithdrawAhead());
  w.desk->WithdrawIf([&](const PayloadDesk::Batch& batch) { return &batch == waited.get(); });
  w.Tell();
  REQUIRE(w.cancelled.size() == 3);
  REQUIRE(w.budget.used() == 0);
}

TEST_CASE("The oldest payload goes first, and none that somebody wants") {
  World w;
  for (const UnitId u : {4, 8, 6}) REQUIRE(w.desk->Put(u, w.PayloadOf(u)));
  REQUIRE(w.budget.used() == w.Length({4, 8, 6}));
  REQUIRE(w.desk->bytes() == w.budget.used());
  w.desk->Want(4);
  REQUIRE(w.desk->DropOldest());
  REQUIRE(w.desk->Find(8) == nullptr);
  REQUIRE(w.desk->DropOldest());
  REQUIRE(!w.desk->DropOldest());
  REQUIRE(w.desk->Find(4) != nullptr);
  // A plan gives up what it alone wants, there or on its way.
  w.desk->Want(4);
  REQUIRE(!w.desk->GiveUp(4));
  w.desk->Unwant(4);
  REQUIRE(w.desk->GiveUp(4));
  REQUIRE(!w.desk->GiveUp(4));
  const auto batch = w.Ask({4});
  REQUIRE(w.desk->GiveUp(4));
  REQUIRE(w.budget.used() == 0);
}

TEST_CASE("Answers after its end find no desk, and the source knows that none is wanted") {
  World w;
  const auto open = w.Ask({1, 2}), withdrawn = w.Ask({3}, Asking::kAhead), answered = w.Ask({4});
  answered->Receive(4, Bytes());
  REQUIRE(w.desk->WithdrawAhead());
  w.desk.reset();
  REQUIRE(w.cancelled.size() == 2);
  open->Receive(1, Bytes());
  REQUIRE(w.arrived == std::vector<UnitId>{4});
}

TEST_CASE("Whichever allocation fails, the desk counts what is there and what is on its way") {
  using Mode = FailingAllocation::Mode;
  for (const Mode mode : {Mode::kOnce, Mode::kFromThenOn}) {
    World w;
    const Payload payload = w.PayloadOf(6);
    const auto run = [&] {
      return CatchOutOfMemory([&]() -> Status {
        const auto batch = w.Ask({1, 2});
        if (!w.desk->on_its_way(1)) return OutOfMemory();
        return w.desk->Put(6, payload) ? Status::Ok() : OutOfMemory();
      });
    };
    uint64_t failures = 0;
    FailEachAllocation(mode, run, [&](uint64_t, const Status& status) {
      failures += status.ok() ? 0 : 1;
      const bool asked = w.desk->on_its_way(1), there = w.desk->Find(6) != nullptr;
      REQUIRE(status.ok() == (asked && there));
      REQUIRE(w.desk->on_its_way(2) == asked);
      REQUIRE(w.budget.used() == (asked ? w.Length({1, 2}) : 0) + (there ? w.Length({6}) : 0));
      w.desk->WithdrawIf([](const auto&) { return true; });
      if (there) w.desk->Drop(6);
      w.Tell();
      REQUIRE(w.budget.used() == 0);
    });
    REQUIRE(failures > 2);
  }
}

}  // namespace mtdb::testing
