// SPDX-License-Identifier: Apache-2.0
#include "tools/server/http/server_websocket.h"

#include <algorithm>
#include <boost/beast/core/buffers_to_string.hpp>
#include <new>
#include <utility>

#include "tools/request/report_json.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMostOnWay = 1 << 20;  // bytes of the stream, before a round begins
constexpr size_t kMostReplies = 32;       // that the client has not taken
// Longer messages are read by a thread, not by the loop's.
constexpr size_t kShortMessageBytes = 4096;
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

ServerWebSocket::ServerWebSocket(ServerLoop& loop, ServerClient client, beast::tcp_stream stream,
                                 std::shared_ptr<ServerService::OpenedSession> opened,
                                 std::shared_ptr<void> ticket)
    : ServerPeer(loop, std::move(client)),
      socket_(std::move(stream)),
      opened_(std::move(opened)),
      ticket_(std::move(ticket)),
      buffer_(kMaxSessionMessageBytes),
      patience_(kPatience) {}

ServerWebSocket::~ServerWebSocket() = default;

void ServerWebSocket::Accept(Request request) {
  websocket::stream_base::timeout timeout{};
  timeout.handshake_timeout = Seconds(options().idle_seconds);
  timeout.idle_timeout = Seconds(options().session_idle_seconds);
  timeout.keep_alive_pings = true;
  socket_.set_option(timeout);
  socket_.set_option(websocket::stream_base::decorator(
      [](websocket::response_type& response) { response.set(http::field::server, "mtdb"); }));
  socket_.read_message_max(kMaxSessionMessageBytes);
  const auto kept = std::make_shared<Request>(std::move(request));
  socket_.async_accept(*kept, Then([kept](ServerWebSocket& self, ErrorCode error) {
    if (error) return self.Drop();
    self.open_ = true;
    ++self.metrics().sessions_opened;
    SessionReply hello;
    hello.kind = SessionReply::Kind::kHello;
    hello.hello = self.opened_->session->Hello();
    self.Reply(std::move(hello));
    self.on_way_ += self.opened_->session->start().size();
    self.Push({false, "", self.opened_->session->start()});
    self.Read();
    if (self.loop_.stopping) self.Drain();
  }));
}

// ---- what the client says -----------------------------------------------------------------------

void ServerWebSocket::Read() {
  if (ended_ || closing_ || reading_ || parsing_ || replies_ >= kMostReplies) return;
  reading_ = true;
  socket_.async_read(buffer_, Then([](ServerWebSocket& self, ErrorCode error, size_t) {
                       self.reading_ = false;
                       error ? self.Drop() : self.OnMessage();
                     }));
}

void ServerWebSocket::OnMessage() {
  struct Parsed {
    std::string text;
    std::optional<uint64_t> id;
    Result<SessionRequest> request = Status(StatusCode::kInvalidArgument, "");
  };
  const auto message = std::make_shared<Parsed>();
  message->text = beast::buffers_to_string(buffer_.data());
  buffer_.consume(buffer_.size());
  if (!socket_.got_text()) {
    return Close(websocket::close_code::unknown_data, "expected text");
  }
  const auto parse = [message] {
    message->request = ParseSessionRequest(message->text, &message->id);
  };
  if (message->text.size() <= kShortMessageBytes) {
    parse();
    return Take(std::move(message->request), message->id);
  }
  parsing_ = std::make_shared<ServerPool::Job>();
  parsing_->client = client_;
  parsing_->work = parse;
  parsing_->done = Then([message](ServerWebSocket& self) {
    const bool failed = std::exchange(self.parsing_, nullptr)->failed;
    if (failed) throw std::bad_alloc();
    if (!self.ended_ && !self.closing_) self.Take(std::move(message->request), message->id);
  });
  loop_.catalog.Submit(parsing_);
}

void ServerWebSocket::Take(Result<SessionRequest> request, std::optional<uint64_t> id) {
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
  }
  if (on_way_ < kMostOnWay) Run();
}

void ServerWebSocket::Run() {
  const auto call = std::make_shared<ServerCall>();
  const auto job = std::make_shared<ServerPool::Job>();
  const auto outcome = std::make_shared<ServerService::SessionOutcome>();
  job->client = client_;
  job->is_long = work_->is_long;
  const auto self = shared_from_this();
  job->work = [self, call, outcome, work = &*work_, job = job.get()] {
    ServerMail& mail = self->loop_.mail;
    ServerSession::Pace pace;
    pace.superseded = [&] { return self->newer_.load(); };
    pace.pause = [&] {
      return self->on_way_ >= kMostOnWay || self->loop_.queries.ShouldYield(*job);
    };
    pace.send = [&](Bytes bytes) {
      self->on_way_ += bytes.size();
      ++work->messages;
      work->bytes += bytes.size();
      const auto sent = std::make_shared<Bytes>(std::move(bytes));
      mail.Post(ServerMail::Write(self->Then([sent](ServerWebSocket& session) {
        session.Push({false, "", std::move(*sent)});
      })));
    };
    *outcome =
        self->loop_.service.Update(*self->opened_, work->request, pace, *call, &work->progress);
  };
  job->done = Then([outcome, job = job.get()](ServerWebSocket& session) {
    if (job->failed) throw std::bad_alloc();
    session.OnOutcome(std::move(*outcome));
  });
  job->stop_soon = [call] { call->Cancel(ServerCall::Stop::kPreempted); };
  work_->call = call;
  work_->job = job;
  loop_.queries.Submit(job);
}

void ServerWebSocket::OnOutcome(ServerService::SessionOutcome outcome) {
  const ServerCall::Stop stop = work_->call->stop;
  work_->call.reset();
  work_->job.reset();
  if (ended_) return;
  const uint64_t id = work_->request.id;
  const bool superseded = outcome.end == ServerSession::End::kSuperseded ||
                          (!outcome.end && stop == ServerCall::Stop::kSuperseded);
  const bool preempted = !outcome.end && stop == ServerCall::Stop::kPreempted;
  if (outcome.end == ServerSession::End::kPaused || (preempted && !outcome.broken)) {
    work_->is_long = preempted;
    return hurry_ ? Drop() : Begin();
  }
  patience_ = superseded && work_->progress.rounds == 0 ? 2 * patience_ : kPatience;
  if (superseded) {
    ReplySuperseded(id);
  } else if (outcome.end) {
    ReplyDone(outcome.update);
  } else {
    ReplyError(id, outcome.error);
  }
  work_.reset();
  if (outcome.broken) {
    return Close(websocket::close_code::internal_error, outcome.error.message);
  }
  Begin();
}

void ServerWebSocket::Tick(Clock::time_point now) {
  if (ended_) return;
  const auto self = shared_from_this();
  try {
    if (stall_ && now > *stall_) return Drop();
    if (opened_->memory->evicted() && !closing_) {
      const ServerError error = loop_.service.NoSessionMemory();
      if (work_ && !work_->call) work_.reset();
      return Close(websocket::close_code::try_again_later, error.message);
    }
    if (work_) Watch(now);
  } catch (const std::exception&) {
    Drop();
  }
}

// Whether the query at hand should go on.
void ServerWebSocket::Watch(Clock::time_point now) {
  SessionWork& work = *work_;
  if (!work.call) {
    if (now <= work.deadline) return;
    ReplyError(work.request.id, {503, "timeout", "the time for a query is over"});
    work_.reset();
    return Begin();
  }
  const ServerSession& session = *opened_->session;
  // Each node that was applied is one of the cut, and has brought a triangle at least.
  const uint64_t at_least =
      session.surface().record().root_triangles + work.call->control.nodes_applied();
  if (at_least > session.max_triangles()) work.call->Cancel(ServerCall::Stop::kTooLarge);
  if (now > work.deadline) work.call->Cancel(ServerCall::Stop::kTimeout);
  if (waiting_ && now > work.begin + patience_) work.call->Cancel(ServerCall::Stop::kSuperseded);
  EndWork();
}

// What was cancelled and has not begun need not begin.
void ServerWebSocket::EndWork() {
  if (!work_->call->control.cancelled() || !loop_.queries.Withdraw(work_->job)) return;
  ServerService::SessionOutcome outcome;
  outcome.error = loop_.service.Stopped(*work_->call);
  OnOutcome(std::move(outcome));
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
  reply.done.shortfall = update.stats.shortfall;
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
                           Then([size](ServerWebSocket& self, ErrorCode error, size_t) {
                             self.stall_.reset();
                             error ? self.Drop() : self.OnWritten(size);
                           }));
}

void ServerWebSocket::AwaitProgress() {
  stall_ = Clock::now() + (hurry_ ? Clock::duration(kHurry) : Seconds(options().idle_seconds));
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
  socket_.async_close(*closing_, Then([](ServerWebSocket& self, ErrorCode) { self.Drop(); }));
}

// The connection ends at once. An update that runs is cancelled, and holds the session till then.
void ServerWebSocket::Drop() noexcept {
  if (ended_) return;
  ended_ = true;
  stall_.reset();
  if (parsing_ && loop_.catalog.Withdraw(parsing_)) parsing_.reset();
  if (work_ && work_->call) {
    work_->call->Cancel(ServerCall::Stop::kClientGone);
    if (loop_.queries.Withdraw(work_->job)) work_.reset();
  }
  outbox_.clear();
  beast::get_lowest_layer(socket_).close();
}

void ServerWebSocket::Drain() {
  const auto self = shared_from_this();
  try {
    TryDrain();
  } catch (const std::exception&) {
    Drop();
  }
}

void ServerWebSocket::Abort() {
  const auto self = shared_from_this();
  try {
    TryAbort();
  } catch (const std::exception&) {
    Drop();
  }
}

void ServerWebSocket::TryDrain() {
  if (ended_ || !open_ || (work_ && !waiting_)) return;
  if (waiting_) {
    ReplyError(waiting_->request.id, ShuttingDown());
    waiting_.reset();
    newer_ = false;
    if (work_) return;
  }
  Close(websocket::close_code::going_away, "the server is shutting down");
}

void ServerWebSocket::TryAbort() {
  if (ended_ || hurry_ || !work_ || !work_->call) return Drop();
  // Its outcome is the last that the client hears.
  hurry_ = true;
  work_->call->Cancel(ServerCall::Stop::kShutdown);
  if (writing_) AwaitProgress();
  EndWork();
}

}  // namespace mtdb::internal
