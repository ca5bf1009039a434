#include "tools/internal/server.h"

#include <algorithm>
#include <array>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <boost/beast/http/status.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <csignal>
#include <ctime>
#include <memory>
#include <optional>
#include <poll.h>
#include <thread>
#include <utility>
#include <vector>

#include "tools/internal/network.h"
#include "tools/internal/server_loop.h"
#include "tools/internal/server_websocket.h"

namespace mtdb {

namespace {

constexpr uint32_t kMaxHeaderBytes = 16 << 10;
constexpr uint64_t kMaxBodyBytes = 1 << 20;
constexpr auto kWatchPeriod = std::chrono::milliseconds(50);
constexpr auto kAcceptPause = std::chrono::milliseconds(100);
// What a client still sends when its connection is about to be closed is read for so long: a reset
// would take the answer away from it.
constexpr auto kLingerTime = std::chrono::seconds(2);
constexpr uint64_t kLingerBytes = 8 << 20;
// Connections above the limit that are told so; those above these are just closed.
constexpr size_t kMaxRefused = 64;

std::string HttpDate() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  char text[40];
  std::strftime(text, sizeof(text), "%a, %d %b %Y %H:%M:%S GMT", &parts);
  return text;
}

// One connection: reads a request, has it answered, sends the answer, and again. All of it runs on
// the loop's thread, but ServerService::Answer. A request for a session hands the stream over to a
// ServerWebSocket.
class Connection final : public ServerPeer, public std::enable_shared_from_this<Connection> {
 public:
  Connection(ServerLoop& loop, Tcp::socket socket, bool refused)
      : ServerPeer(loop), stream_(std::move(socket)), watch_(loop.io), refused_(refused) {}

  void Read() {
    state_ = State::kReading;
    parser_.emplace();
    parser_->header_limit(kMaxHeaderBytes);
    parser_->body_limit(kMaxBodyBytes);
    stream_.expires_after(Seconds(loop_.options.idle_seconds));
    http::async_read_header(stream_, buffer_, *parser_,
                            [self = shared_from_this()](ErrorCode error, size_t) {
                              error ? self->OnReadError(error) : self->OnHeader();
                            });
  }

  void Drain() override {
    keep_alive_ = false;
    if (state_ == State::kReading || state_ == State::kLingering) stream_.close();
  }
  void Abort() override {
    Drain();
    if (state_ == State::kAnswering) call_->Cancel(ServerCall::Stop::kShutdown);
    if (state_ == State::kSending) stream_.close();
  }

 private:
  enum class State : uint8_t { kReading, kAnswering, kSending, kLingering };

  ServerMetrics& metrics() { return loop_.service.metrics(); }

  // ---- the request ----

  void OnHeader() {
    if (!beast::iequals(parser_->get()[http::field::expect], "100-continue")) return ReadBody();
    constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
    asio::async_write(stream_, asio::buffer(kContinue),
                      [self = shared_from_this()](ErrorCode error, size_t) {
                        if (!error) self->ReadBody();
                      });
  }

  void ReadBody() {
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](ErrorCode error, size_t) {
                       error ? self->OnReadError(error) : self->OnRequest();
                     });
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
      ++metrics().in_flight;
      begin_ = Clock::now();
      return Finish(408);
    }
    const bool malformed =
        error.category() == http::make_error_code(http::error::bad_method).category();
    if (malformed && error != http::error::end_of_stream && error != http::error::partial_message) {
      return Reject(400, "bad_request", "this is not HTTP/1.1: " + error.message());
    }
    stream_.close();
  }

  void Reject(unsigned status, const char* code, const std::string& message) {
    ++metrics().in_flight;
    begin_ = Clock::now();
    Send(ErrorAnswer(status, code, message));
  }

  void OnRequest() {
    auto message = parser_->release();
    ++metrics().in_flight;
    begin_ = Clock::now();
    deadline_ = begin_ + Seconds(loop_.options.timeout_seconds);
    head_ = message.method() == http::verb::head;
    keep_alive_ = message.keep_alive() && !refused_ && !loop_.stopping;
    if (refused_) {
      return Send(ErrorAnswer(503, "too_many_connections",
                              "the server has as many connections as it takes; try again later"));
    }
    if (websocket::is_upgrade(message) && ServerService::IsSession(std::string(message.target()))) {
      return OpenSession(std::move(message));
    }
    ServerRequest request{std::string(message.method_string()), std::string(message.target()),
                          std::move(message.body())};
    call_ = std::make_shared<ServerCall>();
    const ServerService::Effort effort = ServerService::EffortOf(request.target);
    if (effort == ServerService::Effort::kNone) {
      return Send(loop_.service.Answer(request, *call_));
    }
    state_ = State::kAnswering;
    stream_.expires_never();
    const bool query = effort == ServerService::Effort::kQuery;
    if (query) ++metrics().queries_waiting;
    Watch();
    asio::post(loop_.pool(effort), [self = shared_from_this(), call = call_, query,
                                    work = asio::make_work_guard(loop_.io),
                                    request = std::move(request)]() mutable {
      ServerService& service = self->loop_.service;
      if (query) {
        --service.metrics().queries_waiting;
        ++service.metrics().queries_running;
      }
      auto answer = std::make_shared<ServerAnswer>(service.Answer(request, *call));
      if (query) --service.metrics().queries_running;
      // The last owner of a session is on its own thread.
      asio::io_context& io = self->loop_.io;
      asio::post(io, [moved = std::move(self), answer] { moved->OnAnswer(std::move(*answer)); });
    });
  }

  // ---- sessions ----

  void OpenSession(ServerWebSocket::Request message) {
    keep_alive_ = false;
    if (!ServerWebSocket::MayOpen(message, loop_.options.allowed_origin)) {
      return Send(ErrorAnswer(403, "foreign_origin",
                              "web pages of another origin may not open sessions here; whoever "
                              "runs the server may allow it (--allow-origin)"));
    }
    if (buffer_.size() > 0) {
      return Send(ErrorAnswer(400, "bad_request", "wait for the upgrade before you send more"));
    }
    if (metrics().sessions >= loop_.options.max_sessions) {
      return Send(ErrorAnswer(503, "too_many_sessions",
                              "the server has as many sessions as it takes; try again later"));
    }
    ++metrics().sessions;
    std::shared_ptr<void> ticket(nullptr, [&sessions = metrics().sessions](void*) { --sessions; });
    call_ = std::make_shared<ServerCall>();
    state_ = State::kAnswering;
    stream_.expires_never();
    Watch();
    // Not where it would wait for queries.
    asio::post(loop_.catalog, [self = shared_from_this(), ticket, message = std::move(message),
                               work = asio::make_work_guard(loop_.io)]() mutable {
      auto refusal = std::make_shared<ServerAnswer>();
      std::shared_ptr<ServerService::OpenedSession> opened =
          self->loop_.service.OpenSession(std::string(message.target()), refusal.get());
      asio::io_context& io = self->loop_.io;
      asio::post(io, [moved = std::move(self), held = std::move(ticket), opened = std::move(opened),
                      refusal, request = std::move(message)]() mutable {
        if (opened == nullptr) return moved->OnAnswer(std::move(*refusal));
        moved->OnOpened(std::move(opened), std::move(held), std::move(request));
      });
    });
  }

  void OnOpened(std::shared_ptr<ServerService::OpenedSession> opened, std::shared_ptr<void> ticket,
                ServerWebSocket::Request request) {
    watch_.cancel();
    state_ = State::kSending;
    if (loop_.stopping) {
      return OnAnswer(ErrorAnswer(503, "shutting_down", "the server is shutting down"));
    }
    if (call_->control.cancelled()) {
      return OnAnswer(ErrorAnswer(503, "timeout", "the time for opening a session is over"));
    }
    Finish(101);
    std::make_shared<ServerWebSocket>(loop_, std::move(stream_), std::move(opened),
                                      std::move(ticket))
        ->Accept(std::move(request));
  }

  // ---- while it is answered ----

  // Looks now and then whether somebody still waits for the answer.
  void Watch() {
    watch_.expires_after(kWatchPeriod);
    watch_.async_wait([self = shared_from_this()](ErrorCode error) {
      if (error || self->state_ != State::kAnswering) return;
      if (self->ClientIsGone()) self->call_->Cancel(ServerCall::Stop::kClientGone);
      if (Clock::now() > self->deadline_) self->call_->Cancel(ServerCall::Stop::kTimeout);
      if (!self->call_->control.cancelled()) self->Watch();
    });
  }

  // It closed the connection, or its sending half.
  bool ClientIsGone() {
    pollfd entry{stream_.socket().native_handle(), POLLRDHUP, 0};
    return ::poll(&entry, 1, 0) == 1 && (entry.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
  }

  void OnAnswer(ServerAnswer answer) {
    watch_.cancel();
    if (call_->stop == ServerCall::Stop::kClientGone) {
      stream_.close();
      return Finish(499);
    }
    if (loop_.stopping) keep_alive_ = false;
    Send(std::move(answer));
  }

  // ---- the answer ----

  void Send(ServerAnswer answer) {
    state_ = State::kSending;
    answer_ = std::move(answer);
    // An error has its time, also when it is that the time is over.
    if (answer_.status != 200) {
      deadline_ = Clock::now() + Seconds(loop_.options.idle_seconds);
    }
    const uint64_t size = answer_.file.is_open() ? answer_.file.size_bytes() : answer_.body.size();
    chunk_ = "HTTP/1.1 " + std::to_string(answer_.status) + " " +
             std::string(http::obsolete_reason(http::int_to_status(answer_.status))) +
             "\r\nDate: " + HttpDate() +
             "\r\nServer: mtdb\r\nContent-Type: " + answer_.content_type +
             "\r\nContent-Length: " + std::to_string(size) + "\r\n";
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
      if (chunk_.empty()) return Break(500);
    }
    const Clock::time_point now = Clock::now();
    if (now >= deadline_) return Break(503);
    stream_.expires_after(std::min(deadline_ - now, Seconds(loop_.options.idle_seconds)));
    stream_.async_write_some(asio::buffer(chunk_.data() + chunk_sent_, chunk_.size() - chunk_sent_),
                             [self = shared_from_this()](ErrorCode error, size_t size) {
                               if (error)
                                 return self->Break(error == beast::error::timeout ? 503 : 499);
                               self->chunk_sent_ += size;
                               self->metrics().sent_bytes += size;
                               self->Write();
                             });
  }

  // An answer that is not whole: all that is left is to close.
  void Break(unsigned code) {
    stream_.close();
    answer_ = {};
    Finish(code);
  }

  void OnSent() {
    if (!head_) metrics().triangles_sent += answer_.triangles;
    Finish(answer_.status);
    answer_ = {};
    head_ = false;
    if (keep_alive_) return Read();
    ErrorCode ignored;
    stream_.socket().shutdown(Tcp::socket::shutdown_send, ignored);
    if (loop_.stopping) return stream_.close();
    state_ = State::kLingering;
    stream_.expires_after(kLingerTime);
    chunk_.resize(kBlockBytes);
    Linger(0);
  }

  void Linger(uint64_t bytes) {
    stream_.async_read_some(asio::buffer(chunk_),
                            [self = shared_from_this(), bytes](ErrorCode error, size_t size) {
                              if (error || bytes > kLingerBytes) return self->stream_.close();
                              self->Linger(bytes + size);
                            });
  }

  void Finish(unsigned code) {
    --metrics().in_flight;
    metrics().Finish(code, std::chrono::duration<double>(Clock::now() - begin_).count());
  }

  beast::tcp_stream stream_;
  asio::steady_timer watch_;
  const bool refused_;
  beast::flat_buffer buffer_{kBlockBytes};
  std::optional<http::request_parser<http::string_body>> parser_;
  State state_ = State::kReading;
  bool head_ = false;
  bool keep_alive_ = true;
  std::shared_ptr<ServerCall> call_;
  Clock::time_point begin_, deadline_;
  ServerAnswer answer_;
  std::string chunk_;  // of the answer: its header and a body in memory, then blocks of a file
  size_t chunk_sent_ = 0;
  uint64_t file_sent_ = 0;
};

// ---- the server ---------------------------------------------------------------------------------

class Server {
 public:
  Server(const ServerOptions& options, ServerService& service) : loop_(options, service) {
    loop_.on_last_left = [this] {
      ErrorCode ignored;
      signals_.cancel(ignored);
      grace_.cancel();
    };
  }

  Status Run(const std::function<void(const std::string& url)>& listening);

 private:
  void Accept();
  void OnAccept(Tcp::socket socket);
  void AwaitSignal();
  void Stop();
  void Abort();

  ServerLoop loop_;
  Tcp::acceptor acceptor_{loop_.io};
  asio::signal_set signals_{loop_.io};
  asio::steady_timer pause_{loop_.io};
  asio::steady_timer grace_{loop_.io};
};

Status Server::Run(const std::function<void(const std::string& url)>& listening) {
  const Endpoint& listen = loop_.options.listen;
  const std::string where = listen.text();
  ErrorCode error;
  const auto address = asio::ip::make_address(listen.address, error);
  if (error) {
    return InvalidArgument(where + ": expected an address of this machine such as 127.0.0.1");
  }
  const Tcp::endpoint endpoint(address, listen.port);
  acceptor_.open(endpoint.protocol(), error);
  if (!error) acceptor_.set_option(Tcp::acceptor::reuse_address(true), error);
  if (!error) acceptor_.bind(endpoint, error);
  if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
  if (error) {
    return IoError(where + ": cannot listen there: " + error.message() +
                   "; choose another with --listen, port 0 for any free one");
  }
  signals_.add(SIGINT);
  signals_.add(SIGTERM);
  AwaitSignal();
  Accept();
  listening("http://" + Endpoint{listen.address, acceptor_.local_endpoint().port()}.text());
  loop_.io.run();
  loop_.queries.join();
  loop_.catalog.join();
  return Status::Ok();
}

void Server::Accept() {
  acceptor_.async_accept([this](ErrorCode error, Tcp::socket socket) {
    if (loop_.stopping) return;
    if (!error) {
      OnAccept(std::move(socket));
      return Accept();
    }
    // Most likely out of descriptors: others must finish first.
    pause_.expires_after(kAcceptPause);
    pause_.async_wait([this](ErrorCode) {
      if (!loop_.stopping) Accept();
    });
  });
}

void Server::OnAccept(Tcp::socket socket) {
  if (loop_.peers.size() >= loop_.options.max_connections + kMaxRefused) return;
  ErrorCode ignored;
  socket.set_option(Tcp::no_delay(true), ignored);
  const bool refused = loop_.peers.size() >= loop_.options.max_connections;
  std::make_shared<Connection>(loop_, std::move(socket), refused)->Read();
}

void Server::AwaitSignal() {
  signals_.async_wait([this](ErrorCode error, int) {
    if (error) return;
    loop_.stopping ? Abort() : Stop();
    AwaitSignal();
  });
}

void Server::Stop() {
  loop_.stopping = true;
  ErrorCode ignored;
  acceptor_.close(ignored);
  pause_.cancel();
  const std::set<ServerPeer*> peers = loop_.peers;
  for (ServerPeer* peer : peers) peer->Drain();
  if (peers.empty()) return loop_.io.stop();
  grace_.expires_after(Seconds(loop_.options.grace_seconds));
  grace_.async_wait([this](ErrorCode error) {
    if (!error) Abort();
  });
}

void Server::Abort() {
  const std::set<ServerPeer*> peers = loop_.peers;
  for (ServerPeer* peer : peers) peer->Abort();
}

}  // namespace

Status RunServer(const ServerOptions& options,
                 const std::function<void(const std::string& url)>& listening) {
  ServerOptions filled = options;
  if (filled.threads == 0) filled.threads = std::max(1u, std::thread::hardware_concurrency());
  filled.service.threads = filled.threads;
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ServerService> service,
                        ServerService::Open(filled.service));
  return Server(filled, *service).Run(listening);
}

}  // namespace mtdb
