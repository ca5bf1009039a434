// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <deque>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "codecs/stream/update_stream.h"
#include "store/base/json.h"
#include "tools/client/client.h"
#include "tools/client/internal/blocking_connection.h"
#include "tools/client/internal/remote_object.h"
#include "tools/client/session_message.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr auto kReconnectPause = std::chrono::milliseconds(100);

double Milliseconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

StatusCode CodeOf(const std::string& code) {
  if (code == "gone") return StatusCode::kNotFound;
  if (code == "budget_exceeded" || code == "too_many_triangles") return StatusCode::kBudgetExceeded;
  if (code == "timeout" || code == "no_space" || code == "shutting_down") return StatusCode::kBusy;
  return code == "store_error" ? StatusCode::kIoError : StatusCode::kInvalidArgument;
}

}  // namespace

class RemoteSession::Impl {
 public:
  Impl(HttpUrl url, std::string path, const RemoteSessionOptions& options)
      : options_(options),
        url_(std::move(url)),
        where_(url_.origin() + path),
        path_(std::move(path)) {}

  // A new connection, and a new mesh.
  Status Start();
  Result<RemoteUpdate> Update(const std::string& query, const OnMessage& on_message);
  Result<uint64_t> Send(const std::string& query);
  Result<RemoteUpdate> Receive(const OnMessage& on_message);
  void Close();

  const RemoteSessionOptions options_;
  const HttpUrl url_;
  const std::string where_;  // in messages
  const std::string path_;
  bool connected_ = false;
  SessionHello hello_;
  uint64_t start_bytes_ = 0;
  uint64_t answered_ = 0;  // by the last answer; 0: none
  std::optional<UpdateDecoder> decoder_;

 private:
  struct Connection {
    BlockingConnection base;
    websocket::stream<beast::tcp_stream&> socket{base.stream()};
  };
  struct Query {
    uint64_t id = 0;
    Clock::time_point sent;
    std::optional<Clock::time_point> first;  // bytes of the stream
  };
  // Of a whole message: the text, or how many bytes the stream went on by.
  struct Message {
    bool is_text = false;
    std::string text;
    uint64_t bytes = 0;
  };

  Status Handshake();
  Result<Message> Read();
  uint64_t MostBytes() const;
  // A query's error when the reply is one.
  Result<RemoteUpdate> Answer(const SessionReply& reply);
  Status Lost(const std::string& what, ErrorCode error);
  Status Broken(const Status& why);

  std::unique_ptr<Connection> connection_;
  std::vector<std::byte> block_ = std::vector<std::byte>(kBlockBytes);
  uint64_t next_id_ = 1;
  std::deque<Query> queries_;  // without an answer
  uint64_t bytes_ = 0, messages_ = 0;
  uint64_t unanswered_bytes_ = 0;  // of the update stream, since the last answer of any kind
  bool restarted_ = false;
};

// The connection is of no use any more.
Status RemoteSession::Impl::Broken(const Status& why) {
  connected_ = false;
  queries_.clear();
  if (connection_) connection_->base.stream().close();
  return {why.code(), where_ + ": " + why.message()};
}

Status RemoteSession::Impl::Lost(const std::string& what, ErrorCode error) {
  const Status status = connection_->base.Failure(what, error);
  const std::string reason(connection_->socket.reason().reason.c_str());
  static_cast<void>(Broken(status));
  return {status.code(), status.message() + (reason.empty() ? "" : " (" + reason + ")")};
}

Status RemoteSession::Impl::Handshake() {
  auto& socket = connection_->socket;
  socket.set_option(websocket::stream_base::decorator(
      [](websocket::request_type& request) { request.set(http::field::user_agent, "mtdb"); }));
  socket.read_message_max(0);  // what it says is taken piece by piece
  const std::string target = path_ +
                             "/session?remember=" + std::to_string(options_.remembered_vertices) +
                             "&triangles=" + std::to_string(options_.max_triangles);
  const std::string host = url_.origin().substr(7);
  websocket::response_type response;
  const ErrorCode error = connection_->base.Await([&](auto&& done) {
    socket.async_handshake(response, host, target, std::forward<decltype(done)>(done));
  });
  if (error == websocket::error::upgrade_declined) {
    return Refused(where_, response.result_int(), response.body());
  }
  return error ? Lost("opening a session", error) : Status::Ok();
}

Status RemoteSession::Impl::Start() {
  connection_.reset(new Connection{{url_, options_.timeout_seconds}});
  connected_ = false;
  queries_.clear();
  bytes_ = messages_ = unanswered_bytes_ = 0;
  MTDB_RETURN_IF_ERROR(connection_->base.Connect());
  MTDB_RETURN_IF_ERROR(Handshake());
  // The decoder has room for two triangles before it takes one in. Of vertices, triangles that do
  // not touch have three each.
  const uint64_t triangles = uint64_t{options_.max_triangles} + 2;
  const uint64_t vertices = 3 * triangles + options_.remembered_vertices;
  decoder_.emplace(UpdateDecoder::Limits{static_cast<uint32_t>(std::min<uint64_t>(triangles, ~0u)),
                                         static_cast<uint32_t>(std::min<uint64_t>(vertices, ~0u))});
  MTDB_ASSIGN_OR_RETURN(const Message message, Read());
  if (!message.is_text) return Broken(BadInput("a session must begin with a hello"));
  const Result<SessionReply> reply = ParseSessionReply(message.text);
  if (!reply.ok()) return Broken(reply.status());
  if (reply->kind != SessionReply::Kind::kHello) {
    return Broken(BadInput("a session must begin with a hello"));
  }
  hello_ = reply->hello;
  while (!decoder_->started()) {
    MTDB_ASSIGN_OR_RETURN(const Message start, Read());
    if (start.is_text) return Broken(BadInput("the base mesh must come first"));
  }
  start_bytes_ = std::exchange(bytes_, 0);
  messages_ = unanswered_bytes_ = 0;
  connected_ = true;
  return Status::Ok();
}

// Of the update stream until an answer. What a server can need to take the whole mesh away and to
// make all of another is far less.
uint64_t RemoteSession::Impl::MostBytes() const {
  const uint64_t row_bytes = decoder_->mesh().options().attributes.row_bytes();
  return (uint64_t{16} << 20) + options_.max_triangles * (256 + 4 * row_bytes);
}

Result<RemoteSession::Impl::Message> RemoteSession::Impl::Read() {
  auto& socket = connection_->socket;
  Message message;
  connection_->base.Progress();
  do {
    size_t size = 0;
    const ErrorCode error = connection_->base.AwaitMore([&](auto&& done) {
      socket.async_read_some(
          asio::buffer(block_),
          [&size, then = std::forward<decltype(done)>(done)](ErrorCode result, size_t n) mutable {
            size = n;
            then(result);
          });
    });
    if (error) return Lost("the session broke off", error);
    connection_->base.Received(size);
    message.is_text = socket.got_text();
    const ByteSpan piece = ByteSpan(block_).first(size);
    if (message.is_text) {
      if (message.text.size() + size > kMaxSessionMessageBytes) {
        return Broken(BadInput("a control message is longer than 1 MiB"));
      }
      message.text += AsString(piece);
      continue;
    }
    message.bytes += size;
    const Status status = decoder_->Feed(piece);
    if (!status.ok()) return Broken(status);
    unanswered_bytes_ += size;
    if (decoder_->started() && unanswered_bytes_ > MostBytes()) {
      return Broken(BadInput("the server sent " + std::to_string(unanswered_bytes_) +
                             " bytes without an answer, more than a mesh of " +
                             std::to_string(options_.max_triangles) + " triangles can need"));
    }
  } while (!socket.is_message_done());
  if (!message.is_text) {
    if (message.bytes == 0) return Broken(BadInput("the server sent an empty message"));
    bytes_ += message.bytes;
    ++messages_;
    for (Query& query : queries_) {
      if (!query.first) query.first = Clock::now();
    }
  }
  return message;
}

Result<uint64_t> RemoteSession::Impl::Send(const std::string& query) {
  if (!Json::ParseObject(query).is_object())
    return InvalidArgument("the query is not a JSON object");
  if (!connected_) return IoError(where_ + ": the session is closed");
  const std::string text = SessionRequestText({next_id_, query});
  if (text.size() > hello_.max_message_bytes) {
    return InvalidArgument(where_ + ": the query is longer than the " +
                           std::to_string(hello_.max_message_bytes) + " bytes that it may have");
  }
  connection_->socket.text(true);
  const Clock::time_point sent = Clock::now();
  const ErrorCode error = connection_->base.Await([&](auto&& done) {
    connection_->socket.async_write(asio::buffer(text), std::forward<decltype(done)>(done));
  });
  if (error) return Lost("sending a query", error);
  queries_.push_back({next_id_, sent, {}});
  return next_id_++;
}

Result<RemoteUpdate> RemoteSession::Impl::Answer(const SessionReply& reply) {
  const auto query = std::find_if(queries_.begin(), queries_.end(),
                                  [&](const Query& q) { return reply.id == q.id; });
  if (query == queries_.end()) {
    if (reply.kind == SessionReply::Kind::kError) {
      return Broken({CodeOf(reply.code), reply.error});
    }
    return Broken(BadInput("the server answered what was not asked"));
  }
  if (reply.kind == SessionReply::Kind::kSuperseded && query->id + 1 == next_id_) {
    return Broken(BadInput("the server gave up a query for a later one that there is not"));
  }
  unanswered_bytes_ = 0;
  RemoteUpdate update;
  update.id = answered_ = query->id;
  update.done_ms = Milliseconds(query->sent, Clock::now());
  update.first_ms = query->first ? Milliseconds(query->sent, *query->first) : update.done_ms;
  queries_.erase(query);
  update.superseded = reply.kind == SessionReply::Kind::kSuperseded;
  update.restarted = std::exchange(restarted_, false);
  if (update.superseded) return update;
  update.bytes = std::exchange(bytes_, 0);
  update.messages = std::exchange(messages_, 0);
  if (reply.kind != SessionReply::Kind::kDone) {
    return Status(CodeOf(reply.code), where_ + ": " + reply.error);
  }
  const SessionDone& done = reply.done;
  const ClientMesh& mesh = decoder_->mesh();
  if (mesh.triangle_count() != done.triangles || mesh.vertex_count() != done.vertices) {
    return Broken(BadInput("the update stream ends with " + std::to_string(mesh.triangle_count()) +
                           " triangles, the server has " + std::to_string(done.triangles)));
  }
  update.triangles = done.triangles;
  update.vertices = done.vertices;
  update.active_triangles = done.active_triangles;
  update.insertions = done.insertions;
  update.removals = done.removals;
  update.error_bound = done.error_bound;
  update.shortfall = done.shortfall;
  update.server_ms = done.milliseconds;
  update.limit = done.limit;
  return update;
}

Result<RemoteUpdate> RemoteSession::Impl::Receive(const OnMessage& on_message) {
  answered_ = 0;
  if (!connected_) return IoError(where_ + ": the session is closed");
  if (queries_.empty()) return InvalidArgument("there is no query without an answer");
  while (true) {
    MTDB_ASSIGN_OR_RETURN(const Message message, Read());
    if (!message.is_text) {
      if (on_message) MTDB_RETURN_IF_ERROR(on_message(message.bytes));
      continue;
    }
    const Result<SessionReply> reply = ParseSessionReply(message.text);
    if (!reply.ok()) return Broken(reply.status());
    if (reply->kind == SessionReply::Kind::kHello) {
      return Broken(BadInput("the server said hello twice"));
    }
    return Answer(*reply);
  }
}

Result<RemoteUpdate> RemoteSession::Impl::Update(const std::string& query,
                                                 const OnMessage& on_message) {
  std::optional<Clock::time_point> end;  // of the attempts to connect
  while (true) {
    Status status;
    if (!connected_ && options_.reconnect_seconds > 0) {
      status = Start();
      if (status.ok()) {
        restarted_ = true;
        bytes_ = start_bytes_;
      }
      if (!status.ok() && status.code() != StatusCode::kIoError &&
          status.code() != StatusCode::kBusy) {
        return status;
      }
    }
    if (status.ok()) {
      const Result<uint64_t> id = Send(query);
      status = id.status();
      while (status.ok()) {
        Result<RemoteUpdate> update = Receive(on_message);
        if (connected_ && answered_ != 0 && answered_ != *id) continue;  // those sent before
        if (update.ok() || connected_) return update;
        status = update.status();
      }
      if (connected_ || status.code() != StatusCode::kIoError) return status;
    }
    if (!end) end = Clock::now() + Seconds(options_.reconnect_seconds);
    if (options_.reconnect_seconds <= 0 || Clock::now() + kReconnectPause > *end) return status;
    std::this_thread::sleep_for(kReconnectPause);
  }
}

void RemoteSession::Impl::Close() {
  if (!connected_) return;
  // What is still on its way is read and dropped.
  (void)connection_->base.Await([&](auto&& done) {
    connection_->socket.async_close(websocket::close_code::normal,
                                    std::forward<decltype(done)>(done));
  });
  connected_ = false;
  connection_->base.stream().close();
}

// ---- the public face ----------------------------------------------------------------------------

RemoteSession::RemoteSession(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RemoteSession::~RemoteSession() = default;

Result<std::unique_ptr<RemoteSession>> RemoteSession::Open(const std::string& url,
                                                           const RemoteSessionOptions& options) {
  MTDB_ASSIGN_OR_RETURN(const HttpUrl parsed, ParseHttpUrl(url));
  MTDB_ASSIGN_OR_RETURN(std::string path, ObjectPath(parsed, options.name));
  if (path.empty()) {
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<HttpClient> client,
                          HttpClient::Connect(parsed, options.timeout_seconds));
    MTDB_ASSIGN_OR_RETURN(path, OnlyObjectPath(parsed, *client));
  }
  auto impl = std::make_unique<Impl>(parsed, std::move(path), options);
  MTDB_RETURN_IF_ERROR(impl->Start());
  return std::unique_ptr<RemoteSession>(new RemoteSession(std::move(impl)));
}

Result<RemoteUpdate> RemoteSession::Update(const std::string& query, const OnMessage& on_message) {
  return impl_->Update(query, on_message);
}
Result<uint64_t> RemoteSession::Send(const std::string& query) { return impl_->Send(query); }
Result<RemoteUpdate> RemoteSession::Receive(const OnMessage& on_message) {
  return impl_->Receive(on_message);
}
uint64_t RemoteSession::answered() const { return impl_->answered_; }
bool RemoteSession::connected() const { return impl_->connected_; }
void RemoteSession::Close() { impl_->Close(); }
const std::string& RemoteSession::object() const { return impl_->hello_.object; }
double RemoteSession::diagonal() const { return impl_->hello_.diagonal; }
uint64_t RemoteSession::object_triangles() const { return impl_->hello_.triangles; }
uint64_t RemoteSession::start_bytes() const { return impl_->start_bytes_; }
uint32_t RemoteSession::remembered_vertices() const { return mesh().options().remembered_vertices; }
const ClientMesh& RemoteSession::mesh() const { return impl_->decoder_->mesh(); }
ClientMesh::Changes RemoteSession::TakeChanges() { return impl_->decoder_->TakeChanges(); }

Status RemoteSession::SendMesh(MeshSink& sink) const {
  const ClientMesh& client = mesh();
  TriangleMesh mesh;
  mesh.header.attributes = client.options().attributes;
  mesh.header.double_positions = impl_->hello_.double_positions;
  const Grid& grid = client.options().grid;
  if (grid.mode == PositionMode::kGrid) mesh.header.position_step = grid.step;
  mesh.header.vertex_count = client.vertex_count();
  mesh.header.triangle_count = client.triangle_count();
  std::vector<VertexIndex> number(client.vertex_slots());
  for (uint32_t v = 0; v < client.vertex_slots(); ++v) {
    if (!client.has_vertex(v)) continue;
    number[v] = mesh.positions.size();
    mesh.positions.push_back(client.options().grid.Position(client.position(v)));
    mesh.header.bounds.Add(mesh.positions.back());
    const ByteSpan row = client.row(v);
    mesh.rows.insert(mesh.rows.end(), row.begin(), row.end());
  }
  for (uint32_t slot = 0; slot < client.triangle_slots(); ++slot) {
    if (!client.has_triangle(slot)) continue;
    const auto& c = client.triangle(slot).corners;
    mesh.triangles.push_back({number[c[0]], number[c[1]], number[c[2]]});
  }
  return mtdb::SendMesh(mesh, sink);
}

}  // namespace mtdb
