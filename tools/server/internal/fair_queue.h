// SPDX-License-Identifier: Apache-2.0
// FairQueue: which job of which client runs next. The decisions alone: no threads and no clock.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <optional>
#include <string>

namespace mtdb::internal {

// Where a job comes from: an address has its share, which its connections share.
struct ServerClient {
  std::string address;
  uint64_t connection = 0;  // of all that the server has had
};

// Start-time fair queueing (Goyal, Vin, Cheng 1996) at two levels, addresses and their connections:
// whoever has used the least time goes first. Nobody saves up time while he asks for nothing, and
// nobody is more than kMostBehind seconds behind for what he has used before.
//
// Jobs cannot be interrupted. So that long ones do not keep short ones waiting, one that has run
// for Limits::long_seconds while others wait leaves its slot to them: it moves to one of the slots
// for long jobs, or, when these are taken, is to be stopped and pushed again as a long one. An
// address gets all but one of them at most. One thread. Cost of a decision: in proportion to the
// jobs.
class FairQueue {
 public:
  using Job = uint64_t;
  struct Limits {
    unsigned slots = 1;       // jobs at once
    unsigned long_slots = 1;  // long ones beside them
    double long_seconds = 0.5;
  };
  static constexpr double kMostBehind = 1;
  static constexpr double kLeastCharge = 0.001;  // seconds, for each job

  explicit FairQueue(const Limits& limits) : limits_(limits) {}

  // The job waits. `is_long`: it runs in a slot for long jobs only. Ids are not used twice at once.
  void Push(Job job, const ServerClient& client, bool is_long);
  // The job that runs next, from now on; none when none waits, or no slot is free.
  std::optional<Job> Start(double now_seconds);
  // A running job that is to be stopped, so that others are not kept waiting; each is named once.
  // Call it until it names none, then Start.
  std::optional<Job> Preempt(double now_seconds);
  // The job has ended, or does not wait any more.
  void Finish(Job job, double now_seconds);

  size_t waiting() const { return waiting_.size(); }
  size_t running() const { return running_.size(); }
  size_t long_running() const { return long_running_; }
  // Jobs wait that any slot would do for.
  bool contended() const { return short_waiting_ > 0; }
  // Clients that it keeps something of.
  size_t clients() const { return groups_.size(); }

 private:
  // Of an address or a connection: the time that it has used, and what it has here.
  struct Share {
    double used = 0;
    size_t jobs = 0;
  };
  struct Group : Share {
    std::map<uint64_t, Share> members;
    double now = 0;  // the most that a member had used when one of its jobs began
    size_t long_running = 0;
  };
  struct Entry {
    Job job = 0;
    std::string address;
    uint64_t connection = 0;
    bool is_long = false;
    bool stopping = false;
    double begin = 0;
  };
  using Entries = std::list<Entry>;

  bool MayRun(const Entry& entry) const;
  bool LongSlotFor(const Group& group) const;
  void Charge(const Entry& entry, double seconds);
  void Leave(const Entry& entry);

  const Limits limits_;
  std::map<std::string, Group> groups_;
  double now_ = 0;   // the most that an address had used when one of its jobs began
  Entries waiting_;  // by arrival
  Entries running_;  // by begin
  size_t short_waiting_ = 0;
  size_t long_running_ = 0;
};

}  // namespace mtdb::internal
