// SPDX-License-Identifier: Apache-2.0
#include "tools/server/http/server_connection.h"

#include <algorithm>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <boost/beast/http/status.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <ctime>
#include <memory>
#include <new>
#include <optional>
#include <poll.h>
#include <string_view>
#include <sys/socket.h>
#include <utility>

#include "tools/server/http/server_origin.h"
#include "tools/server/http/server_websocket.h"

namespace mtdb::internal {

namespace {

constexpr uint32_t kMaxHeaderBytes = 16 << 10;
constexpr uint64_t kMaxBodyBytes = 1 << 20;
// What a client still sends when its connection is about to be closed is read for so long: a reset
// would take the answer away from it.
constexpr auto kLingerTime = std::chrono::seconds(2);
constexpr uint64_t kLingerBytes = 8 << 20;
// What is said when there is no memory for anything else.
constexpr std::string_view kOutOfMemory =
    "HTTP/1.1 503 Service Unavailable\r\nServer: mtdb\r\nContent-Type: application/json\r\n"
    "Content-Length: 78\r\nRetry-After: 1\r\nConnection: close\r\n\r\n"
    "{\"error\": \"the server is out of memory; try again later\", \"code\": \"no_space\"}\n";

std::string HttpDate() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  char text[40];
  std::strftime(text, sizeof(text), "%a, %d %b %Y %H:%M:%S GMT", &parts);
  return text;
}

// Counts a request from when it was read to when it was answered.
class RequestCount {
 public:
  explicit RequestCount(ServerMetrics& metrics) : metrics_(metrics) { ++metrics_.in_flight; }
  ~RequestCount() {
    --metrics_.in_flight;
    metrics_.Finish(status, SecondsSince(begin));
  }
  RequestCount(const RequestCount&) = delete;
  RequestCount& operator=(const RequestCount&) = delete;

  const Clock::time_point begin = Clock::now();
  unsigned status = 499;

 private:
  ServerMetrics& metrics_;
};

// One connection: reads a request, has it answered, sends the answer, and again. All of it runs on
// the loop's thread, but ServerService::Answer. A request for a session hands the stream over to a
// ServerWebSocket.
class Connection final : public ServerPeer, public std::enable_shared_from_this<Connection> {
  template <typename F>
  auto Then(F f) {
    return Guarded(shared_from_this(), std::move(f));
  }

 public:
  Connection(ServerLoop& loop, Tcp::socket socket, ServerClient client, bool refused)
      : ServerPeer(loop, std::move(client)), stream_(std::move(socket)), refused_(refused) {}

  void Read() {
    state_ = State::kReading;
    parser_.emplace();
    parser_->header_limit(kMaxHeaderBytes);
    parser_->body_limit(kMaxBodyBytes);
    stream_.expires_after(Seconds(loop_.options.idle_seconds));
    http::async_read_header(stream_, buffer_, *parser_,
                            Then([](Connection& self, ErrorCode error, size_t) {
                              error ? self.OnReadError(error) : self.OnHeader();
                            }));
  }

  void Tick(Clock::time_point now) override {
    if (state_ != State::kAnswering && state_ != State::kSending) return;
    const auto self = shared_from_this();
    const bool evicted = call_ != nullptr && call_->temporary && call_->temporary->evicted();
    if (state_ == State::kSending) {
      if (evicted) End(503);
      return;
    }
    if (evicted) call_->Cancel(ServerCall::Stop::kNoRoom);
    if (ClientIsGone()) call_->Cancel(ServerCall::Stop::kClientGone);
    if (now > deadline_) call_->Cancel(ServerCall::Stop::kTimeout);
    EndIfStopped();
  }
  void Drain() override {
    keep_alive_ = false;
    if (state_ == State::kReading || state_ == State::kLingering) Close();
  }
  void Abort() override {
    Drain();
    if (state_ == State::kSending) Close();
    if (state_ != State::kAnswering) return;
    const auto self = shared_from_this();
    call_->Cancel(ServerCall::Stop::kShutdown);
    EndIfStopped();
  }
  void GiveUp() noexcept override {
    if (state_ == State::kReading || state_ == State::kAnswering) {
      if (count_) count_->status = 503;
      ::send(stream_.socket().native_handle(), kOutOfMemory.data(), kOutOfMemory.size(),
             MSG_NOSIGNAL | MSG_DONTWAIT);
    }
    Close();
  }

 private:
  enum class State : uint8_t { kReading, kAnswering, kSending, kLingering, kClosed };

  ServerMetrics& metrics() { return loop_.service.metrics(); }
  // Nothing more happens here; what was begun ends by itself.
  void Close() {
    const State was = state_;
    if (was == State::kAnswering) {
      call_->Cancel(ServerCall::Stop::kClientGone);
      loop_.pool(effort_).Withdraw(job_);
    }
    state_ = State::kClosed;
    stream_.close();
    answer_ = {};
    if (was != State::kAnswering) call_.reset();
    count_.reset();
  }

  // ---- the request ----

  // What two programs on the way may understand differently is refused. Empty: nothing.
  std::string Ambiguity() const {
    const auto& message = parser_->get();
    if (message.count(http::field::host) > 1) return "the header Host is there twice";
    if (message.count(http::field::content_length) > 1) {
      return "the header Content-Length is there twice";
    }
    const size_t codings = message.count(http::field::transfer_encoding);
    if (codings == 0) return "";
    if (message.count(http::field::content_length) > 0) {
      return "the headers Transfer-Encoding and Content-Length are both there";
    }
    if (codings > 1 || !beast::iequals(message[http::field::transfer_encoding], "chunked")) {
      return "the header Transfer-Encoding: expected chunked or none";
    }
    return "";
  }

  void OnHeader() {
    if (const std::string problem = Ambiguity(); !problem.empty()) {
      keep_alive_ = false;
      return Reject(400, "bad_request", problem);
    }
    if (!beast::iequals(parser_->get()[http::field::expect], "100-continue")) return ReadBody();
    constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
    asio::async_write(stream_, asio::buffer(kContinue),
                      Then([](Connection& self, ErrorCode error, size_t) {
                        error ? self.Close() : self.ReadBody();
                      }));
  }

  void ReadBody() {
    http::async_read(stream_, buffer_, *parser_,
                     Then([](Connection& self, ErrorCode error, size_t) {
                       error ? self.OnReadError(error) : self.OnRequest();
                     }));
  }

  void OnReadError(ErrorCode error) {
    keep_alive_ = false;
    if (error == http::error::body_limit) {
      return Reject(413, "body_too_large",
                    "expected a body of at most " + std::to_string(kMaxBodyBytes) + " bytes");
    }
    if (error == http::error::header_limit || error == http::error::buffer_overflow) {
      return Reject(431, "header_too_large",
                    "expected a request line and header of at most " +
                        std::to_string(kMaxHeaderBytes) + " bytes");
    }
    if (error == beast::error::timeout && parser_->got_some()) {
      // The stream closed itself with its time.
      count_.emplace(metrics());
      return End(408);
    }
    const bool malformed =
        error.category() == http::make_error_code(http::error::bad_method).category();
    if (malformed && error != http::error::end_of_stream && error != http::error::partial_message) {
      return Reject(400, "bad_request", "this is not HTTP/1.1: " + error.message());
    }
    Close();
  }

  void Reject(unsigned status, const char* code, const std::string& message) {
    count_.emplace(metrics());
    Send(ErrorAnswer(status, code, message));
  }

  void OnRequest() {
    auto message = parser_->release();
    count_.emplace(metrics());
    deadline_ = count_->begin + Seconds(loop_.options.timeout_seconds);
    head_ = message.method() == http::verb::head;
    keep_alive_ = message.keep_alive() && !refused_ && !loop_.stopping;
    if (refused_) {
      return Send(ErrorAnswer(503, "too_many_connections",
                              "the server has as many connections as it takes; try again later"));
    }
    const std::string host(message[http::field::host]);
    if (!IsOwnHost(host, loop_.options.allowed_hosts)) {
      return Send(ErrorAnswer(403, "foreign_host",
                              "this server does not go by the name of '" + host +
                                  "'; ask by its address, or have whoever runs it allow the name "
                                  "(--allowed-host)"));
    }
    if (websocket::is_upgrade(message) && ServerService::IsSession(std::string(message.target()))) {
      return OpenSession(std::move(message));
    }
    request_ = std::make_shared<ServerRequest>(
        ServerRequest{std::string(message.method_string()), std::string(message.target()),
                      std::move(message.body()), std::string(message[http::field::range]),
                      std::string(message[http::field::if_range]),
                      std::string(message[http::field::if_none_match])});
    effort_ = loop_.service.EffortOf(request_->target);
    if (effort_ == ServerService::Effort::kNone) {
      ServerCall call;
      return Send(loop_.service.Answer(*request_, call));
    }
    Ask(false);
  }

  // Has the request answered. `is_long`: it was tried, and took long while others waited.
  void Ask(bool is_long) {
    const auto answer = std::make_shared<ServerAnswer>();
    BeginJob(is_long);
    call_->temporary = std::make_unique<ServerLedger::Account>(loop_.service.temporary(), client_);
    call_->memory = std::make_unique<ServerLedger::Account>(loop_.service.memory(), client_);
    job_->work = [&service = loop_.service, request = request_, call = call_, answer] {
      *answer = service.Answer(*request, *call);
    };
    job_->done = Then([answer](Connection& self) mutable { self.OnAnswer(std::move(*answer)); });
    job_->stop_soon = [call = call_, waits = effort_ == ServerService::Effort::kUpstream] {
      // What waits for another server would only begin to wait anew.
      if (!waits) call->Cancel(ServerCall::Stop::kPreempted);
    };
    loop_.pool(effort_).Submit(job_);
  }

  void BeginJob(bool is_long) {
    call_ = std::make_shared<ServerCall>();
    job_ = std::make_shared<ServerPool::Job>();
    job_->client = client_;
    job_->is_long = is_long;
    state_ = State::kAnswering;
    stream_.expires_never();
  }

  // ---- sessions ----

  void OpenSession(ServerWebSocket::Request message) {
    keep_alive_ = false;
    if (!MayOpenSession(std::string(message[http::field::origin]),
                        std::string(message[http::field::host]), loop_.options.allowed_origin)) {
      return Send(ErrorAnswer(403, "foreign_origin",
                              "web pages of another origin may not open sessions here; whoever "
                              "runs the server may allow it (--allowed-origin)"));
    }
    if (buffer_.size() > 0) {
      return Send(ErrorAnswer(400, "bad_request", "wait for the upgrade before you send more"));
    }
    if (metrics().sessions >= loop_.options.max_sessions) {
      return Send(ErrorAnswer(503, "too_many_sessions",
                              "the server has as many sessions as it takes; try again later"));
    }
    ++metrics().sessions;
    const std::shared_ptr<void> ticket(nullptr,
                                       [&sessions = metrics().sessions](void*) { --sessions; });
    const auto request = std::make_shared<ServerWebSocket::Request>(std::move(message));
    const auto opening = std::make_shared<Opening>();
    // Not where it would wait for queries.
    effort_ = loop_.service.SessionEffort();
    BeginJob(false);
    job_->work = [&service = loop_.service, client = client_, call = call_, request, opening] {
      opening->opened =
          service.OpenSession(std::string(request->target()), client, *call, &opening->refusal);
    };
    job_->done = Then([ticket, request, opening](Connection& self) {
      if (opening->opened == nullptr) return self.OnAnswer(std::move(opening->refusal));
      self.OnOpened(std::move(opening->opened), ticket, std::move(*request));
    });
    loop_.pool(effort_).Submit(job_);
  }

  struct Opening {
    std::shared_ptr<ServerService::OpenedSession> opened;
    ServerAnswer refusal;
  };

  void OnOpened(std::shared_ptr<ServerService::OpenedSession> opened, std::shared_ptr<void> ticket,
                ServerWebSocket::Request request) {
    if (state_ != State::kAnswering) return;
    state_ = State::kSending;
    if (loop_.stopping) {
      return OnAnswer(ErrorAnswer(503, "shutting_down", "the server is shutting down"));
    }
    if (call_->control.cancelled()) {
      return OnAnswer(ErrorAnswer(503, "timeout", "the time for opening a session is over"));
    }
    const auto session = std::make_shared<ServerWebSocket>(loop_, client_, std::move(stream_),
                                                           std::move(opened), std::move(ticket));
    End(101);
    session->Accept(std::move(request));
  }

  // ---- while it is answered ----

  // It closed the connection, or its sending half.
  bool ClientIsGone() {
    pollfd entry{stream_.socket().native_handle(), POLLRDHUP, 0};
    return ::poll(&entry, 1, 0) == 1 && (entry.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
  }

  // What was cancelled and has not begun need not begin.
  void EndIfStopped() {
    if (!call_->control.cancelled() || call_->stop == ServerCall::Stop::kPreempted) return;
    if (!loop_.pool(effort_).Withdraw(job_)) return;
    try {
      OnAnswer(ErrorAnswer(loop_.service.Stopped(*call_)));
    } catch (const std::exception&) {
      GiveUp();
    }
  }

  void OnAnswer(ServerAnswer answer) {
    if (state_ == State::kClosed) return;
    if (job_->failed) throw std::bad_alloc();
    const bool preempted = call_->stop == ServerCall::Stop::kPreempted;
    if (preempted && answer.status == ServerError::kPreempted) {
      if (loop_.aborting) {
        return Send(ErrorAnswer(503, "shutting_down", "the server is shutting down"));
      }
      return Ask(true);
    }
    if (call_->stop == ServerCall::Stop::kClientGone) return End(499);
    if (loop_.stopping) keep_alive_ = false;
    Send(std::move(answer));
  }

  // ---- the answer ----

  void Send(ServerAnswer answer) {
    state_ = State::kSending;
    answer_ = std::move(answer);
    // An error has its time, also when it is that the time is over.
    if (answer_.status >= 400) {
      deadline_ = Clock::now() + Seconds(loop_.options.idle_seconds);
    }
    const uint64_t size = answer_.file.is_open() ? answer_.file.size_bytes() : answer_.body.size();
    chunk_ = "HTTP/1.1 " + std::to_string(answer_.status) + " " +
             std::string(http::obsolete_reason(http::int_to_status(answer_.status))) +
             "\r\nDate: " + HttpDate() + "\r\nServer: mtdb\r\n";
    const bool has_content = answer_.status != 204 && answer_.status != 304;
    if (has_content) {
      chunk_ += "Content-Type: " + answer_.content_type +
                "\r\nContent-Length: " + std::to_string(size) + "\r\n";
    }
    if (answer_.for_pages && !loop_.options.allowed_origin.empty()) {
      chunk_ += "Access-Control-Allow-Origin: " + loop_.options.allowed_origin +
                "\r\nAccess-Control-Expose-Headers: ETag, Content-Range\r\n";
    }
    for (const auto& [name, value] : answer_.headers) chunk_ += name + ": " + value + "\r\n";
    chunk_ += keep_alive_ ? "Connection: keep-alive\r\n\r\n" : "Connection: close\r\n\r\n";
    if (!head_ && !answer_.file.is_open()) chunk_ += answer_.body;
    chunk_sent_ = 0;
    file_sent_ = 0;
    Write();
  }

  void Write() {
    if (chunk_sent_ == chunk_.size()) {
      const uint64_t left =
          answer_.file.is_open() && !head_ ? answer_.file.size_bytes() - file_sent_ : 0;
      if (left == 0) return OnSent();
      chunk_.resize(std::min<uint64_t>(left, kBlockBytes));
      chunk_.resize(answer_.file.ReadAt(file_sent_, chunk_.data(), chunk_.size()));
      chunk_sent_ = 0;
      file_sent_ += chunk_.size();
      if (chunk_.empty()) return End(500);
    }
    const Clock::time_point now = Clock::now();
    if (now >= deadline_) return End(503);
    stream_.expires_after(std::min(deadline_ - now, Seconds(loop_.options.idle_seconds)));
    stream_.async_write_some(asio::buffer(chunk_.data() + chunk_sent_, chunk_.size() - chunk_sent_),
                             Then([](Connection& self, ErrorCode error, size_t size) {
                               if (error)
                                 return self.End(error == beast::error::timeout ? 503 : 499);
                               self.chunk_sent_ += size;
                               self.metrics().sent_bytes += size;
                               self.Write();
                             }));
  }

  // The connection ends with the request at hand.
  void End(unsigned status) {
    if (count_) count_->status = status;
    Close();
  }

  void OnSent() {
    if (!head_) metrics().triangles_sent += answer_.triangles;
    count_->status = answer_.status;
    count_.reset();
    answer_ = {};
    call_.reset();
    job_.reset();
    request_.reset();
    head_ = false;
    if (keep_alive_) return Read();
    ErrorCode ignored;
    stream_.socket().shutdown(Tcp::socket::shutdown_send, ignored);
    if (loop_.stopping) return Close();
    state_ = State::kLingering;
    stream_.expires_after(kLingerTime);
    chunk_.resize(kBlockBytes);
    Linger(0);
  }

  void Linger(uint64_t bytes) {
    stream_.async_read_some(asio::buffer(chunk_),
                            Then([bytes](Connection& self, ErrorCode error, size_t size) {
                              if (error || bytes > kLingerBytes) return self.Close();
                              self.Linger(bytes + size);
                            }));
  }

  beast::tcp_stream stream_;
  const bool refused_;
  beast::flat_buffer buffer_{kBlockBytes};
  std::optional<http::request_parser<http::string_body>> parser_;
  State state_ = State::kReading;
  bool head_ = false;
  bool keep_alive_ = true;
  std::optional<RequestCount> count_;
  Clock::time_point deadline_;
  std::shared_ptr<const ServerRequest> request_;
  ServerService::Effort effort_ = ServerService::Effort::kNone;
  ServerPool::JobPtr job_;  // while it is answered
  std::shared_ptr<ServerCall> call_;
  ServerAnswer answer_;
  std::string chunk_;  // of the answer: its header and a body in memory, then blocks of a file
  size_t chunk_sent_ = 0;
  uint64_t file_sent_ = 0;
};

}  // namespace

void ServeConnection(ServerLoop& loop, Tcp::socket socket, ServerClient client, bool refused) {
  const auto connection =
      std::make_shared<Connection>(loop, std::move(socket), std::move(client), refused);
  try {
    connection->Read();
  } catch (const std::exception&) {
    connection->GiveUp();
  }
}

}  // namespace mtdb::internal
