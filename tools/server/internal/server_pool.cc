// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_pool.h"

#include <cerrno>
#include <sys/eventfd.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "tools/client/network.h"

namespace mtdb::internal {

namespace {

// What a job that can stop for others may do before it does.
constexpr double kSliceSeconds = 0.1;

int NewEvent() {
  const int descriptor = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (descriptor < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  return descriptor;
}

}  // namespace

ServerMail::ServerMail() : descriptor_(NewEvent()) {}

ServerMail::~ServerMail() { ::close(descriptor_); }

void ServerMail::Post(Letter letter) noexcept {
  {
    const std::lock_guard lock(mutex_);
    letters_.splice(letters_.end(), letter);
  }
  Wake();
}

void ServerMail::Wake() const noexcept {
  const int before = errno;
  const uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(descriptor_, &one, sizeof(one));
  errno = before;
}

void ServerMail::Deliver() {
  uint64_t count = 0;
  [[maybe_unused]] const ssize_t n = ::read(descriptor_, &count, sizeof(count));
  while (true) {
    Letter letter;
    {
      const std::lock_guard lock(mutex_);
      if (letters_.empty()) return;
      letter.splice(letter.end(), letters_, letters_.begin());
    }
    letter.front()();
  }
}

ServerPool::ServerPool(ServerMail& mail, const FairQueue::Limits& limits, Figures& figures)
    : mail_(mail), limits_(limits), figures_(figures), queue_(limits) {
  threads_.reserve(limits.slots + limits.long_slots);
}

ServerPool::~ServerPool() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

double ServerPool::Now() const { return SecondsSince(begin_); }

Status ServerPool::Start() {
  if (AddThread()) return Status::Ok();
  return {StatusCode::kNoSpace,
          "no thread can be made; give the process more memory, or a higher limit of processes"};
}

bool ServerPool::AddThread() {
  try {
    threads_.emplace_back([this] { Run(); });
    return true;
  } catch (const std::exception&) {  // no memory, or a limit of the system
    return false;
  }
}

void ServerPool::Submit(JobPtr job) {
  job->id = next_id_++;
  try {
    job->letter = ServerMail::Write([this, job] { OnDone(job); });
    jobs_[job->id] = job;
    queue_.Push(job->id, job->client, job->is_long);
  } catch (...) {
    jobs_.erase(job->id);
    Clear(*job);
    throw;
  }
  Dispatch();
}

// What holds the job and who submitted it.
void ServerPool::Clear(Job& job) {
  job.letter.clear();
  job.work = job.done = job.stop_soon = nullptr;
}

bool ServerPool::Withdraw(const JobPtr& job) {
  if (!jobs_.contains(job->id) || job->begin != Clock::time_point()) return false;
  queue_.Finish(job->id, Now());
  const JobPtr kept = job;
  jobs_.erase(job->id);
  Clear(*kept);
  Dispatch();
  return true;
}

bool ServerPool::ShouldYield(const Job& job) const {
  return contended_ && SecondsSince(job.begin) >= kSliceSeconds;
}

void ServerPool::Tick() {
  while (const auto id = queue_.Preempt(Now())) {
    ++figures_.preempted;
    const JobPtr& job = jobs_.at(*id);
    if (job->stop_soon) job->stop_soon();
  }
  Dispatch();
}

// Nothing in it can fail for want of memory: no job gets lost.
void ServerPool::Dispatch() {
  while (const auto id = queue_.Start(Now())) {
    Job* const job = jobs_.at(*id).get();
    job->begin = Clock::now();
    bool more = false;
    {
      const std::lock_guard lock(mutex_);
      (first_ready_ == nullptr ? first_ready_ : last_ready_->next_ready) = job;
      last_ready_ = job;
      more = ++ready_ > idle_ && threads_.size() < limits_.slots + limits_.long_slots;
    }
    wake_.notify_one();
    // Without another thread it waits for one that there is.
    if (more) AddThread();
  }
  contended_ = queue_.contended();
  figures_.waiting = queue_.waiting();
  figures_.running = queue_.running();
}

void ServerPool::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    ++idle_;
    wake_.wait(lock, [&] { return ending_ || ready_ > 0; });
    --idle_;
    if (ready_ == 0) return;
    Job* const job = std::exchange(first_ready_, first_ready_->next_ready);
    --ready_;
    lock.unlock();
    try {
      job->work();
    } catch (...) {
      job->failed = true;
    }
    mail_.Post(std::move(job->letter));  // the last owner is the loop's thread
    lock.lock();
  }
}

void ServerPool::OnDone(const JobPtr& job) {
  queue_.Finish(job->id, Now());
  jobs_.erase(job->id);
  const std::function<void()> done = std::exchange(job->done, nullptr);
  Clear(*job);
  Dispatch();
  done();
}

}  // namespace mtdb::internal
