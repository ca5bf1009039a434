// SPDX-License-Identifier: Apache-2.0
#include "store/carriers/http_ranges.h"

#if MTDB_HTTP

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <curl/curl.h>
#include <deque>
#include <limits>
#include <mutex>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "store/base/out_of_memory.h"
#include "store/carriers/http_answer.h"
#include "store/carriers/http_url.h"
#include "store/carriers/url_carriers.h"

namespace mtdb::internal {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kPollMilliseconds = 1000;
constexpr const char* kEmptyHash =
    "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
constexpr uint64_t kMaxHeaderBytes = 256 << 10;

Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

struct Request {
  RangeReader::Ticket ticket = 0;
  ByteRange range;
  RangeReader::Answer answer;
  int tries = 0;
  Clock::time_point deadline;  // set by the first try
  Clock::time_point not_before;
  CURL* handle = nullptr;
  curl_slist* headers = nullptr;
  HttpAnswer http;
  uint64_t header_bytes = 0;
  bool no_memory = false;
};
using RequestPtr = std::unique_ptr<Request>;

size_t OnHeader(char* text, size_t, size_t bytes, void* request) {
  auto& r = *static_cast<Request*>(request);
  r.header_bytes += bytes;
  r.no_memory |= !TryAllocate([&] { r.http.AddHeader({text, bytes}); });
  return r.no_memory || r.header_bytes > kMaxHeaderBytes ? 0 : bytes;
}

size_t OnBody(char* text, size_t, size_t bytes, void* request) {
  auto& r = *static_cast<Request*>(request);
  bool goes_on = false;
  r.no_memory |= !TryAllocate([&] {
    goes_on = r.http.AddBody(AsBytes({text, bytes}), r.range.bytes);
  });
  return goes_on && !r.no_memory ? bytes : 0;
}

// Errors of the line, which another try may not meet.
bool IsTransient(CURLcode code) {
  switch (code) {
    case CURLE_COULDNT_CONNECT:
    case CURLE_COULDNT_RESOLVE_HOST:
    case CURLE_COULDNT_RESOLVE_PROXY:
    case CURLE_WEIRD_SERVER_REPLY:
    case CURLE_HTTP2:
    case CURLE_HTTP2_STREAM:
    case CURLE_PARTIAL_FILE:
    case CURLE_OPERATION_TIMEDOUT:
    case CURLE_SSL_CONNECT_ERROR:
    case CURLE_GOT_NOTHING:
    case CURLE_SEND_ERROR:
    case CURLE_RECV_ERROR: return true;
    default: return false;
  }
}

// What a reader and its thread share. The thread may outlive the reader, when an answer drops it.
class Loop : public std::enable_shared_from_this<Loop> {
 public:
  Loop(HttpPlace place, const HttpOptions& options)
      : place_(std::move(place)), options_(options), multi_(curl_multi_init()) {
    if (multi_ == nullptr) return;
    curl_multi_setopt(multi_, CURLMOPT_MAX_HOST_CONNECTIONS, static_cast<long>(options.parallel));
    curl_multi_setopt(multi_, CURLMOPT_PIPELINING, static_cast<long>(CURLPIPE_MULTIPLEX));
  }
  ~Loop() {
    for (CURL* handle : idle_) curl_easy_cleanup(handle);
    if (multi_ != nullptr) curl_multi_cleanup(multi_);
  }
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  bool ok() const { return multi_ != nullptr; }
  const HttpPlace& place() const { return place_; }
  const FileVersion& version() const { return version_; }
  bool outdated() const { return outdated_; }
  uint64_t bytes_read() const { return bytes_read_; }
  uint64_t requests() const { return requests_; }

  // Before there are other requests.
  void SetVersion(FileVersion version) {
    version_ = std::move(version);
    known_ = true;
  }
  const FileVersion& found() const { return found_; }

  RangeReader::Ticket Add(ByteRange range, RangeReader::Answer answer) {
    auto request = std::make_unique<Request>();
    request->range = range;
    request->answer = std::move(answer);
    RangeReader::Ticket ticket = 0;
    {
      const std::lock_guard lock(mutex_);
      request->ticket = ticket = ++last_ticket_;
      waiting_.push_back(std::move(request));
    }
    curl_multi_wakeup(multi_);
    return ticket;
  }
  void Cancel(RangeReader::Ticket ticket) {
    {
      const std::lock_guard lock(mutex_);
      cancelled_.push_back(ticket);
    }
    curl_multi_wakeup(multi_);
  }
  void Stop() {
    stopping_ = true;
    curl_multi_wakeup(multi_);
  }

  void Run() {
    while (!stopping_) {
      DropCancelled();
      const int wait = StartWaiting();
      int running = 0;
      curl_multi_perform(multi_, &running);
      bool any = false;
      int left = 0;
      while (const CURLMsg* const message = curl_multi_info_read(multi_, &left)) {
        if (message->msg != CURLMSG_DONE) continue;
        any = true;
        Finish(message->easy_handle, message->data.result);
      }
      if (!any) curl_multi_poll(multi_, nullptr, 0, wait, nullptr);
    }
    std::vector<RequestPtr> left = TakeAll();
    for (RequestPtr& r : left) {
      Detach(*r);
      r->answer(Status(StatusCode::kCancelled, place_.shown + ": closed"));
    }
  }

 private:
  std::vector<RequestPtr> TakeAll() {
    const std::lock_guard lock(mutex_);
    std::vector<RequestPtr> all = std::move(running_);
    for (RequestPtr& r : waiting_) all.push_back(std::move(r));
    waiting_.clear();
    running_.clear();
    return all;
  }

  void DropCancelled() {
    std::vector<RequestPtr> dropped;
    {
      const std::lock_guard lock(mutex_);
      const auto drop = [&](auto& requests) {
        std::erase_if(requests, [&](RequestPtr& r) {
          if (std::ranges::find(cancelled_, r->ticket) == cancelled_.end()) return false;
          dropped.push_back(std::move(r));
          return true;
        });
      };
      if (!cancelled_.empty()) {
        drop(running_);
        drop(waiting_);
        cancelled_.clear();
      }
    }
    for (const RequestPtr& r : dropped) {
      Detach(*r);
      r->answer(Status(StatusCode::kCancelled, place_.shown + ": cancelled"));
    }
  }

  // Those that were asked for first, as many as may be under way. Returns how long there is nothing
  // to start.
  int StartWaiting() {
    const Clock::time_point now = Clock::now();
    int wait = kPollMilliseconds;
    for (;;) {
      RequestPtr request;
      {
        const std::lock_guard lock(mutex_);
        if (running_.size() >= static_cast<size_t>(options_.parallel)) return wait;
        const auto next = std::ranges::find_if(
            waiting_, [&](const RequestPtr& r) { return r->not_before <= now; });
        if (next == waiting_.end()) {
          for (const RequestPtr& r : waiting_) {
            const auto left =
                std::chrono::duration_cast<std::chrono::milliseconds>(r->not_before - now);
            wait = std::clamp(static_cast<int>(left.count()) + 1, 1, wait);
          }
          return wait;
        }
        request = std::move(*next);
        waiting_.erase(next);
      }
      if (Attach(*request)) {
        const std::lock_guard lock(mutex_);
        running_.push_back(std::move(request));
      } else {
        request->answer(OutOfMemory());
      }
    }
  }

  bool Attach(Request& r) {
    if (r.tries++ == 0) {
      const double at_least_rate =
          static_cast<double>(r.range.bytes) / static_cast<double>(options_.least_rate);
      r.deadline = Clock::now() + Seconds(options_.request_seconds + at_least_rate);
    }
    ++requests_;
    r.http = {};
    r.header_bytes = 0;
    r.no_memory = false;
    if (idle_.empty()) {
      r.handle = curl_easy_init();
    } else {
      r.handle = idle_.back();
      idle_.pop_back();
    }
    if (r.handle == nullptr || !SetOptions(r) ||
        curl_multi_add_handle(multi_, r.handle) != CURLM_OK) {
      Detach(r);
      return false;
    }
    return true;
  }

  bool SetOptions(Request& r) {
    CURL* const h = r.handle;
    bool ok = true;
    const auto header = [&](const std::string& line) {
      curl_slist* const list = curl_slist_append(r.headers, line.c_str());
      ok = ok && list != nullptr;
      if (list != nullptr) r.headers = list;
    };
    const auto set = [&](CURLoption option, auto value) {
      ok = ok && curl_easy_setopt(h, option, value) == CURLE_OK;
    };
    header("Accept-Encoding: identity");
    // A file that has changed comes whole, with 200.
    if (known_ && !version_.etag.empty() && !version_.etag.starts_with("W/")) {
      header("If-Range: " + version_.etag);
    }
    // Which S3 wants, and libcurl 7.88 leaves out: the hash of a body that is empty.
    if (!place_.signature_scope.empty()) header("x-amz-content-sha256: " + std::string(kEmptyHash));
    if (!place_.session_token.empty()) header("x-amz-security-token: " + place_.session_token);
    const std::string last = std::to_string(r.range.offset + r.range.bytes - 1);
    const std::string range = std::to_string(r.range.offset) + "-" + last;
    set(CURLOPT_URL, place_.url.c_str());
    set(CURLOPT_RANGE, range.c_str());
    set(CURLOPT_HTTPHEADER, r.headers);
    set(CURLOPT_HEADERFUNCTION, &OnHeader);
    set(CURLOPT_HEADERDATA, static_cast<void*>(&r));
    set(CURLOPT_WRITEFUNCTION, &OnBody);
    set(CURLOPT_WRITEDATA, static_cast<void*>(&r));
    set(CURLOPT_PRIVATE, static_cast<void*>(&r));
    set(CURLOPT_NOSIGNAL, 1L);
    // Whom a redirect names must not learn the session's token; nor would the signature hold there.
    set(CURLOPT_FOLLOWLOCATION, place_.signature_scope.empty() ? 1L : 0L);
    set(CURLOPT_MAXREDIRS, 5L);
    set(CURLOPT_PROTOCOLS_STR, "http,https");
    set(CURLOPT_REDIR_PROTOCOLS_STR, place_.url.starts_with("https") ? "https" : "http,https");
    set(CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_2TLS));
    if (!place_.signature_scope.empty()) set(CURLOPT_PATH_AS_IS, 1L);
    set(CURLOPT_PIPEWAIT, 1L);
    set(CURLOPT_NETRC, static_cast<long>(CURL_NETRC_OPTIONAL));
    set(CURLOPT_USERAGENT, "mtdb");
    if (!place_.certificates.empty()) set(CURLOPT_CAINFO, place_.certificates.c_str());
    set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(1e3 * options_.connect_seconds));
    // Neither bytes that trickle nor heads and redirects without an end keep a request for ever.
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(r.deadline - Clock::now());
    set(CURLOPT_TIMEOUT_MS, std::max(1L, static_cast<long>(left.count())));
    set(CURLOPT_LOW_SPEED_LIMIT, static_cast<long>(options_.least_rate));
    set(CURLOPT_LOW_SPEED_TIME, std::max(1L, static_cast<long>(options_.stall_seconds)));
    if (!place_.signature_scope.empty()) {
      set(CURLOPT_AWS_SIGV4, place_.signature_scope.c_str());
      set(CURLOPT_USERPWD, place_.credentials.c_str());
    }
    return ok;
  }

  // The handle keeps its connection for the next request.
  void Detach(Request& r) {
    if (r.handle != nullptr) {
      curl_multi_remove_handle(multi_, r.handle);
      curl_easy_reset(r.handle);
      CURL* const handle = std::exchange(r.handle, nullptr);
      if (!TryAllocate([&] { idle_.push_back(handle); })) curl_easy_cleanup(handle);
    }
    curl_slist_free_all(std::exchange(r.headers, nullptr));
  }

  void Finish(CURL* handle, CURLcode code) {
    void* which = nullptr;
    curl_easy_getinfo(handle, CURLINFO_PRIVATE, &which);
    RequestPtr request;
    {
      const std::lock_guard lock(mutex_);
      const auto at =
          std::ranges::find(running_, which, [](const RequestPtr& r) -> void* { return r.get(); });
      request = std::move(*at);
      running_.erase(at);
    }
    Detach(*request);
    Result<Bytes> result = CatchOutOfMemory([&] { return Judge(*request, code); });
    if (!result.ok() && result.status().code() == StatusCode::kNotYet) {
      const bool again = TryAllocate([&] {
        const std::lock_guard lock(mutex_);
        waiting_.push_back(std::move(request));
      });
      if (again) return;
      result = OutOfMemory();
    }
    if (request != nullptr) request->answer(std::move(result));
  }

  // kNotYet: the request is to be tried once more.
  Result<Bytes> Judge(Request& r, CURLcode code) {
    if (r.no_memory || code == CURLE_OUT_OF_MEMORY) return OutOfMemory();
    Status status;
    FileVersion found;
    // A body that was refused is an answer too.
    if (code == CURLE_OK || code == CURLE_WRITE_ERROR ||
        (code == CURLE_PARTIAL_FILE && r.http.code() != 206)) {
      if (!r.http.is_transient()) {
        status = r.http.Check(r.range, known_ ? &version_ : nullptr, &found, place_.shown);
        if (status.ok()) {
          if (!known_) found_ = found;
          Bytes body = r.http.TakeBody();
          bytes_read_ += body.size();
          return body;
        }
        // It has changed, or it is gone.
        if (known_ &&
            (status.code() == StatusCode::kCorrupt || status.code() == StatusCode::kNotFound)) {
          outdated_ = true;
        }
        if (status.code() != StatusCode::kNotYet) return status;
      } else {
        status = NotYet(place_.shown + ": the server answered " + std::to_string(r.http.code()));
      }
    } else {
      const std::string message = place_.shown + ": " + curl_easy_strerror(code);
      // At first, what is not there is most likely a wrong URL.
      const bool wrong =
          !known_ && (code == CURLE_COULDNT_RESOLVE_HOST || code == CURLE_COULDNT_RESOLVE_PROXY ||
                      code == CURLE_COULDNT_CONNECT);
      if (!IsTransient(code) || wrong) return IoError(message);
      status = NotYet(message);
    }
    if (Clock::now() + Seconds(options_.first_wait) >= r.deadline) {
      return IoError(status.message() + "; gave up, since " + std::to_string(r.range.bytes) +
                     " bytes did not come in the time that they may take (MTDB_URL_TIMEOUT, "
                     "MTDB_URL_LEAST_RATE); try again later");
    }
    if (r.tries >= options_.tries) {
      return IoError(status.message() + ", the last of " + std::to_string(r.tries) +
                     " tries; try again later");
    }
    double wait = options_.first_wait * static_cast<double>(1 << std::min(r.tries - 1, 20));
    wait *= std::uniform_real_distribution<double>(0.5, 1)(random_);  // not all at once
    if (const auto asked = r.http.retry_seconds()) wait = std::max(wait, *asked);
    r.not_before = Clock::now() + Seconds(std::min(wait, options_.most_wait));
    return status;
  }

  const HttpPlace place_;
  const HttpOptions options_;
  CURLM* const multi_;
  std::atomic<bool> known_{false};  // that there is a version
  FileVersion version_;
  FileVersion found_;
  std::atomic<bool> outdated_{false};
  std::atomic<bool> stopping_{false};
  std::atomic<uint64_t> bytes_read_{0};
  std::atomic<uint64_t> requests_{0};
  std::mutex mutex_;  // guards what follows
  RangeReader::Ticket last_ticket_ = 0;
  std::vector<RequestPtr> running_;
  std::deque<RequestPtr> waiting_;
  std::vector<RangeReader::Ticket> cancelled_;
  // Of the loop's thread.
  std::vector<CURL*> idle_;
  std::minstd_rand random_{std::random_device{}()};
};

class HttpRanges final : public RangeReader {
 public:
  HttpRanges(std::shared_ptr<Loop> loop, std::thread thread)
      : loop_(std::move(loop)), thread_(std::move(thread)) {}
  ~HttpRanges() override {
    loop_->Stop();
    if (thread_.get_id() == std::this_thread::get_id()) {
      thread_.detach();  // an answer was the last to hold the reader
    } else {
      thread_.join();
    }
  }

  Status Begin() {
    auto head = ReadRange(*this, {0, kFirstReadBytes});
    if (!head.ok()) return head.status();
    head_ = *std::move(head);
    loop_->SetVersion(loop_->found());
    return Status::Ok();
  }

  const std::string& name() const override { return loop_->place().shown; }
  uint64_t size() const override { return loop_->version().bytes; }
  Ticket Read(ByteRange range, Answer answer) override {
    if (range.bytes > 0 &&
        (range.offset >= head_.size() || range.bytes > head_.size() - range.offset)) {
      return loop_->Add(range, std::move(answer));
    }
    answer(CatchOutOfMemory([&]() -> Result<Bytes> {
      if (range.bytes == 0) return Bytes();
      const ByteSpan bytes = ByteSpan(head_).subspan(range.offset, range.bytes);
      return Bytes(bytes.begin(), bytes.end());
    }));
    return 0;
  }
  void Cancel(Ticket ticket) override { loop_->Cancel(ticket); }
  bool IsOutdated() const override { return loop_->outdated(); }
  bool answers_at_once() const override { return false; }
  uint64_t bytes_read() const override { return loop_->bytes_read(); }
  uint64_t requests() const override { return loop_->requests(); }

 private:
  const std::shared_ptr<Loop> loop_;
  std::thread thread_;
  Bytes head_;
};

}  // namespace

Result<HttpOptions> HttpOptionsOfEnvironment() {
  HttpOptions options;
  // Empty: as if it were not there.
  const auto read = [](const char* name, double least, double most, double* number) -> Status {
    const char* const text = std::getenv(name);
    if (text == nullptr || *text == '\0') return Status::Ok();
    const char* const end = text + std::strlen(text);
    const auto [at, error] = std::from_chars(text, end, *number);
    if (error == std::errc() && at == end && *number >= least && *number <= most) {
      return Status::Ok();
    }
    return InvalidArgument(std::string(name) + ": expected a number from " +
                           std::to_string(static_cast<uint64_t>(least)) + " to " +
                           std::to_string(static_cast<uint64_t>(most)) + " in the environment");
  };
  constexpr double kDay = 86400, kMostRate = 1 << 30;
  double rate = static_cast<double>(options.least_rate);
  MTDB_RETURN_IF_ERROR(read("MTDB_URL_TIMEOUT", 1, kDay, &options.request_seconds));
  MTDB_RETURN_IF_ERROR(read("MTDB_URL_LEAST_RATE", 1, kMostRate, &rate));
  options.least_rate = static_cast<uint64_t>(rate);
  return options;
}

Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url,
                                                    const HttpOptions& options) {
  static std::once_flag once;
  std::call_once(once, [] { curl_global_init(CURL_GLOBAL_DEFAULT); });
  MTDB_ASSIGN_OR_RETURN(HttpPlace place, PlaceOfUrl(url));
  const auto loop = std::make_shared<Loop>(std::move(place), options);
  if (!loop->ok()) return OutOfMemory();
  std::thread thread;
  try {
    thread = std::thread([loop] { loop->Run(); });
  } catch (const std::system_error&) {
    return Status(StatusCode::kNoSpace, loop->place().shown + ": no thread can be made");
  }
  auto ranges = std::make_unique<HttpRanges>(loop, std::move(thread));
  MTDB_RETURN_IF_ERROR(ranges->Begin());
  return std::unique_ptr<RangeReader>(std::move(ranges));
}

Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url) {
  MTDB_ASSIGN_OR_RETURN(const HttpOptions options, HttpOptionsOfEnvironment());
  return OpenHttpRanges(url, options);
}

}  // namespace mtdb::internal

#else

#include "store/base/redact.h"

namespace mtdb::internal {

Result<std::unique_ptr<RangeReader>> OpenHttpRanges(const std::string& url) {
  return Unsupported(WithoutSecrets(url) +
                     ": this mtdb was built without libcurl, which reads URLs; install " +
                     "libcurl4-openssl-dev and build it again, or download the file");
}

}  // namespace mtdb::internal

#endif
