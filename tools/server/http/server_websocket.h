// SPDX-License-Identifier: Apache-2.0
// A session's connection: WebSocket (RFC 6455) between a client and a ServerSession, as
// docs/protocol.md has it.
#pragma once

#include <atomic>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "tools/client/network.h"
#include "tools/server/http/server_loop.h"

namespace mtdb::internal {

// A query of a session on its way.
struct SessionWork {
  SessionRequest request;
  Clock::time_point begin, deadline;
  ServerSession::Progress progress;
  uint64_t messages = 0, bytes = 0;
  bool is_long = false;              // it took long before its first round while others waited
  std::shared_ptr<ServerCall> call;  // while it waits for a thread or one works on it
  ServerPool::JobPtr job;            // likewise
};

// All of it runs on the loop's thread, but ServerService::Update. One query is worked on at a time,
// the latest waits, and those between are superseded. When a MiB of the stream is on its way to the
// client, an update stops after its round, holding neither a thread nor clusters, and goes on when
// the client has taken it.
class ServerWebSocket final : public ServerPeer,
                              public std::enable_shared_from_this<ServerWebSocket> {
 public:
  using Request = http::request<http::string_body>;

  // `ticket` counts the session as long as it lives.
  ServerWebSocket(ServerLoop& loop, ServerClient client, beast::tcp_stream stream,
                  std::shared_ptr<ServerService::OpenedSession> opened,
                  std::shared_ptr<void> ticket);
  ~ServerWebSocket() override;

  // Answers the upgrade and goes on by itself.
  void Accept(Request request);

  void Tick(Clock::time_point now) override;
  void Drain() override;
  void Abort() override;
  void GiveUp() noexcept override { Drop(); }

 private:
  struct Message {
    bool is_text = false;
    std::string text;  // this
    Bytes bytes;       // or this
    const void* data() const;
    size_t size() const { return is_text ? text.size() : bytes.size(); }
  };

  ServerMetrics& metrics() { return loop_.metrics(); }
  const ServerOptions& options() const { return loop_.options; }
  template <typename F>
  auto Then(F f) {
    return Guarded(shared_from_this(), std::move(f));
  }

  void Read();
  void OnMessage();
  void Take(Result<SessionRequest> request, std::optional<uint64_t> id);
  void Begin();
  void Run();
  void OnOutcome(ServerService::SessionOutcome outcome);
  void Watch(Clock::time_point now);
  void EndWork();
  void Reply(SessionReply reply);
  void ReplyDone(const SessionUpdate& update);
  void ReplyError(std::optional<uint64_t> id, const ServerError& error);
  void ReplySuperseded(uint64_t id);

  void Push(Message message);
  void Write();
  void OnWritten(size_t size);
  void AwaitProgress();
  void TryDrain();
  void TryAbort();
  void Close(websocket::close_code code, const std::string& reason);
  void CloseWhenSent();
  void Drop() noexcept;

  websocket::stream<beast::tcp_stream> socket_;
  const std::shared_ptr<ServerService::OpenedSession> opened_;
  const std::shared_ptr<void> ticket_;
  std::optional<Clock::time_point> stall_;  // when something must have been written
  bool open_ = false;                       // the client was told that there is a session
  bool ended_ = false;                      // the connection is of no use any more
  bool hurry_ = false;                      // the server has waited long enough

  beast::flat_buffer buffer_;
  bool reading_ = false;
  ServerPool::JobPtr parsing_;  // a message that is read by a thread
  std::optional<SessionWork> waiting_;
  std::optional<SessionWork> work_;
  Clock::duration patience_;         // with an update that a later one supersedes
  std::atomic<bool> newer_{false};   // a query waits
  std::atomic<uint64_t> on_way_{0};  // bytes of the stream

  std::deque<Message> outbox_;
  size_t sent_ = 0;     // of its first message
  size_t replies_ = 0;  // texts in it
  bool writing_ = false;
  std::optional<websocket::close_reason> closing_;
  bool close_sent_ = false;
};

}  // namespace mtdb::internal
