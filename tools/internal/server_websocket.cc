#include "tools/internal/server_websocket.h"

#include <algorithm>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <utility>

#include "tools/internal/http_client.h"
#include "tools/internal/report_json.h"

namespace mtdb {

namespace {

constexpr uint64_t kMostOnWay = 1 << 20;     // bytes of the stream, before a round begins
constexpr int kSendBufferBytes = 256 << 10;  // of the system, so that a slow client shows soon
constexpr size_t kMostReplies = 32;          // that the client has not taken
constexpr auto kWatchPeriod = std::chrono::milliseconds(20);
// How long an update may go on without a round when a later query waits. Doubled when that was
// too short, so that a client that asks all the time gets somewhere.
constexpr auto kPatience = std::chrono::milliseconds(100);
// For the last words, when the server has waited long enough.
constexpr auto kHurry = std::chrono::seconds(1);

ServerError ShuttingDown() { return {503, "shutting_down", "the server is shutting down"}; }

}  // namespace

const void* ServerWebSocket::Message::data() const {
  return is_text ? static_cast<const void*>(text.data()) : bytes.data();
}

ServerWebSocket::ServerWebSocket(ServerLoop& loop, beast::tcp_stream stream,
                                 std::shared_ptr<ServerService::OpenedSession> opened,
                                 std::shared_ptr<void> ticket)
    : ServerPeer(loop),
      socket_(std::move(stream)),
      opened_(std::move(opened)),
      ticket_(std::move(ticket)),
      watch_(loop.io),
      stall_(loop.io),
      buffer_(kMaxSessionMessageBytes),
      patience_(kPatience) {}

ServerWebSocket::~ServerWebSocket() = default;

bool ServerWebSocket::MayOpen(const Request& request, const std::string& allowed) {
  const std::string origin(request[http::field::origin]);
  const std::string host(request[http::field::host]);
  if (origin.empty() || allowed == "*" || origin == allowed) return true;
  if (origin != "http://" + host) return false;
  // Under a name the page may be anybody's, who makes the name mean this machine (DNS rebinding).
  const Result<HttpUrl> url = ParseHttpUrl(origin);
  ErrorCode error;
  if (url.ok()) asio::ip::make_address(url->host, error);
  return url.ok() && (!error || url->host == "localhost");
}

void ServerWebSocket::Accept(Request request) {
  websocket::stream_base::timeout timeout{};
  timeout.handshake_timeout = Seconds(options().idle_seconds);
  timeout.idle_timeout = Seconds(options().session_idle_seconds);
  timeout.keep_alive_pings = true;
  socket_.set_option(timeout);
  socket_.set_option(websocket::stream_base::decorator(
      [](websocket::response_type& response) { response.set(http::field::server, "mtdb"); }));
  socket_.read_message_max(kMaxSessionMessageBytes);
  ErrorCode ignored;
  beast::get_lowest_layer(socket_).socket().set_option(
      asio::socket_base::send_buffer_size(kSendBufferBytes), ignored);
  const auto kept = std::make_shared<Request>(std::move(request));
  socket_.async_accept(*kept, [self = shared_from_this(), kept](ErrorCode error) {
    if (error) return self->Drop();
    self->open_ = true;
    ++self->metrics().sessions_opened;
    SessionReply hello;
    hello.kind = SessionReply::Kind::kHello;
    hello.hello = self->opened_->session->Hello();
    self->Reply(std::move(hello));
    self->on_way_ += self->opened_->session->start().size();
    self->Push({false, "", self->opened_->session->start()});
    self->Read();
    if (self->loop_.stopping) self->Drain();
  });
}

// ---- what the client says -----------------------------------------------------------------------

void ServerWebSocket::Read() {
  if (ended_ || closing_ || reading_ || replies_ >= kMostReplies) return;
  reading_ = true;
  socket_.async_read(buffer_, [self = shared_from_this()](ErrorCode error, size_t) {
    self->reading_ = false;
    error ? self->Drop() : self->OnMessage();
  });
}

void ServerWebSocket::OnMessage() {
  const std::string text = beast::buffers_to_string(buffer_.data());
  buffer_.consume(buffer_.size());
  if (!socket_.got_text()) {
    return Close(websocket::close_code::unknown_data, "expected text");
  }
  std::optional<uint64_t> id;
  Result<SessionRequest> request = ParseSessionRequest(text, &id);
  if (!request.ok()) {
    ReplyError(id, {400, "bad_message", request.status().message()});
    return Read();
  }
  if (loop_.stopping) {
    ReplyError(request->id, ShuttingDown());
    return Read();
  }
  if (waiting_) ReplySuperseded(waiting_->request.id);
  waiting_.emplace();
  waiting_->request = *std::move(request);
  waiting_->begin = Clock::now();
  waiting_->deadline = waiting_->begin + Seconds(options().timeout_seconds);
  newer_ = true;
  Begin();
  Read();
}

// ---- updates ------------------------------------------------------------------------------------

// Takes up what there is to do, if it can be done now.
void ServerWebSocket::Begin() {
  if (ended_ || closing_ || (work_ && work_->call)) return;
  if (work_ && waiting_) {
    ReplySuperseded(work_->request.id);
    work_.reset();
  }
  if (!work_) {
    if (!waiting_) {
      if (loop_.stopping) Drain();
      return;
    }
    work_ = std::move(waiting_);
    waiting_.reset();
    newer_ = false;
    Watch();
  }
  if (on_way_ < kMostOnWay) Run();
}

void ServerWebSocket::Run() {
  work_->call = std::make_shared<ServerCall>();
  ++metrics().queries_waiting;
  asio::post(loop_.queries, [self = shared_from_this(), call = work_->call, work = &*work_,
                             guard = asio::make_work_guard(loop_.io)]() mutable {
    asio::io_context& io = self->loop_.io;
    ServerMetrics& metrics = self->metrics();
    --metrics.queries_waiting;
    ++metrics.queries_running;
    ServerSession::Pace pace;
    pace.superseded = [&] { return self->newer_.load(); };
    pace.full = [&] { return self->on_way_ >= kMostOnWay; };
    pace.send = [&](Bytes bytes) {
      self->on_way_ += bytes.size();
      ++work->messages;
      work->bytes += bytes.size();
      asio::post(io, [self, sent = std::move(bytes)]() mutable {
        self->Push({false, "", std::move(sent)});
      });
    };
    auto outcome = std::make_shared<ServerService::SessionOutcome>(self->loop_.service.Update(
        *self->opened_->session, work->request, pace, *call, &work->progress));
    --metrics.queries_running;
    // The last owner is on the loop's thread.
    asio::post(io, [moved = std::move(self), outcome] { moved->OnOutcome(std::move(*outcome)); });
  });
}

void ServerWebSocket::OnOutcome(ServerService::SessionOutcome outcome) {
  const ServerCall::Stop stop = work_->call->stop;
  work_->call.reset();
  if (ended_) return;
  const uint64_t id = work_->request.id;
  const bool superseded = outcome.end == ServerSession::End::kSuperseded ||
                          (!outcome.end && stop == ServerCall::Stop::kSuperseded);
  if (outcome.end == ServerSession::End::kPaused) return hurry_ ? Drop() : Begin();
  patience_ = superseded && work_->progress.rounds == 0 ? 2 * patience_ : kPatience;
  if (superseded) {
    ReplySuperseded(id);
  } else if (outcome.end) {
    ReplyDone(outcome.update);
  } else {
    ReplyError(id, outcome.error);
  }
  work_.reset();
  watch_.cancel();
  if (outcome.broken) {
    return Close(websocket::close_code::internal_error, outcome.error.message);
  }
  Begin();
}

// Looks now and then whether the query at hand should go on.
void ServerWebSocket::Watch() {
  watch_.expires_after(kWatchPeriod);
  watch_.async_wait([self = shared_from_this()](ErrorCode error) {
    if (error || self->ended_ || !self->work_) return;
    SessionWork& work = *self->work_;
    const Clock::time_point now = Clock::now();
    if (!work.call) {
      if (now > work.deadline) {
        self->ReplyError(work.request.id, {503, "timeout", "the time for a query is over"});
        self->work_.reset();
        return self->Begin();
      }
      return self->Watch();
    }
    const ServerSession& session = *self->opened_->session;
    // Each node that was applied is one of the cut, and has brought a triangle at least.
    const uint64_t at_least =
        session.surface().record().root_triangles + work.call->control.nodes_applied();
    if (at_least > session.max_triangles()) work.call->Cancel(ServerCall::Stop::kTooLarge);
    if (now > work.deadline) work.call->Cancel(ServerCall::Stop::kTimeout);
    if (self->waiting_ && now > work.begin + self->patience_) {
      work.call->Cancel(ServerCall::Stop::kSuperseded);
    }
    self->Watch();
  });
}

void ServerWebSocket::Reply(SessionReply reply) {
  ++replies_;
  Push({true, SessionReplyText(reply), {}});
}

void ServerWebSocket::ReplyDone(const SessionUpdate& update) {
  ++metrics().updates;
  SessionReply reply;
  reply.kind = SessionReply::Kind::kDone;
  reply.id = work_->request.id;
  reply.done.triangles = opened_->session->mesh().triangle_count();
  reply.done.vertices = opened_->session->mesh().vertex_count();
  reply.done.active_triangles = update.stats.active_triangles;
  reply.done.error_bound = update.stats.error_bound;
  reply.done.limit = LimitName(update.stats.limit);
  reply.done.insertions = work_->progress.insertions;
  reply.done.removals = work_->progress.removals;
  reply.done.messages = work_->messages;
  reply.done.bytes = work_->bytes;
  reply.done.milliseconds = 1e3 * SecondsSince(work_->begin);
  Reply(std::move(reply));
}

void ServerWebSocket::ReplyError(std::optional<uint64_t> id, const ServerError& error) {
  SessionReply reply;
  reply.id = id;
  reply.error = error.message;
  reply.code = error.code;
  Reply(std::move(reply));
}

void ServerWebSocket::ReplySuperseded(uint64_t id) {
  ++metrics().updates_superseded;
  SessionReply reply;
  reply.kind = SessionReply::Kind::kSuperseded;
  reply.id = id;
  Reply(std::move(reply));
}

// ---- what it is told ----------------------------------------------------------------------------

void ServerWebSocket::Push(Message message) {
  if (ended_ || closing_) return;
  outbox_.push_back(std::move(message));
  if (!writing_) Write();
}

// A message goes out block by block, so that it shows whether the client takes any.
void ServerWebSocket::Write() {
  const Message& message = outbox_.front();
  const size_t size = std::min(message.size() - sent_, kBlockBytes);
  const bool last = sent_ + size == message.size();
  writing_ = true;
  AwaitProgress();
  socket_.text(message.is_text);
  socket_.async_write_some(last,
                           asio::buffer(static_cast<const char*>(message.data()) + sent_, size),
                           [self = shared_from_this(), size](ErrorCode error, size_t) {
                             self->stall_.cancel();
                             error ? self->Drop() : self->OnWritten(size);
                           });
}

void ServerWebSocket::AwaitProgress() {
  stall_.expires_after(hurry_ ? Clock::duration(kHurry) : Seconds(options().idle_seconds));
  stall_.async_wait([self = shared_from_this()](ErrorCode error) {
    if (!error) self->Drop();
  });
}

void ServerWebSocket::OnWritten(size_t size) {
  if (ended_) return;
  writing_ = false;
  sent_ += size;
  metrics().sent_bytes += size;
  const Message& message = outbox_.front();
  if (!message.is_text) {
    metrics().stream_bytes += size;
    on_way_ -= size;
  }
  if (sent_ == message.size()) {
    if (message.is_text) --replies_;
    outbox_.pop_front();
    sent_ = 0;
    Read();
  }
  Begin();
  if (writing_ || ended_) return;  // Begin has said something
  if (!outbox_.empty()) return Write();
  CloseWhenSent();
}

// ---- the end ------------------------------------------------------------------------------------

// Sends what was said before, and then that it is over.
void ServerWebSocket::Close(websocket::close_code code, const std::string& reason) {
  if (ended_ || closing_) return;
  closing_.emplace(code, reason.substr(0, 120));
  if (work_ && work_->call) work_->call->Cancel(ServerCall::Stop::kClientGone);
  CloseWhenSent();
}

void ServerWebSocket::CloseWhenSent() {
  if (!closing_ || close_sent_ || writing_ || !outbox_.empty()) return;
  close_sent_ = true;
  AwaitProgress();
  socket_.async_close(*closing_, [self = shared_from_this()](ErrorCode) { self->Drop(); });
}

// The connection ends at once. An update that runs is cancelled, and holds the session till then.
void ServerWebSocket::Drop() {
  if (ended_) return;
  ended_ = true;
  if (work_ && work_->call) work_->call->Cancel(ServerCall::Stop::kClientGone);
  watch_.cancel();
  stall_.cancel();
  outbox_.clear();
  beast::get_lowest_layer(socket_).close();
}

void ServerWebSocket::Drain() {
  if (ended_ || !open_ || (work_ && !waiting_)) return;
  if (waiting_) {
    ReplyError(waiting_->request.id, ShuttingDown());
    waiting_.reset();
    newer_ = false;
    if (work_) return;
  }
  Close(websocket::close_code::going_away, "the server is shutting down");
}

void ServerWebSocket::Abort() {
  if (ended_ || hurry_ || !work_ || !work_->call) return Drop();
  // Its outcome is the last that the client hears.
  hurry_ = true;
  work_->call->Cancel(ServerCall::Stop::kShutdown);
  if (writing_) AwaitProgress();
}

}  // namespace mtdb
