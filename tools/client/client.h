// SPDX-License-Identifier: Apache-2.0
// The client's side of `mtdb serve` (docs/protocol.md): FetchMesh gets one mesh, and a
// RemoteSession gets what changes from query to query. Link mtdb::client; it needs neither LMDB nor
// the query library. Queries are JSON texts as in docs/query.md.
//
//   mtdb::RemoteSessionOptions options;
//   auto session = mtdb::RemoteSession::Open("http://localhost:8080/objects/statue", options);
//   auto update = (*session)->Update(R"({"threshold": 0.5})");
//   draw((*session)->mesh());       // update->error_bound, bytes, done_ms, ...
//
// A URL is http://HOST:PORT/objects/NAME, or http://HOST:PORT when the options have the object's
// name or the server has only one object. Calls block. Errors of all calls: kInvalidArgument and
// kNotFound when the server refuses, kBudgetExceeded when the server says that it is too much,
// kBusy when the server may be asked again later, kIoError when the server does not answer or
// breaks off, kBadInput when it is no `mtdb serve`. A message begins with the URL.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "codecs/stream/client_mesh.h"
#include "store/base/mesh_sink.h"
#include "store/base/shortfall.h"
#include "store/base/status.h"

namespace mtdb {

// kInvalidArgument when `url` has none of the forms above.
Status CheckUrl(const std::string& url);

struct FetchOptions {
  std::string name;               // of the object, when the URL has none
  std::string format = "ply";     // one that docs/protocol.md lists
  bool double_positions = false;  // of ply: float64, also where float32 is enough
  // How long the server may take to connect, to take the query, to answer it, and for each KiB of
  // the mesh.
  double timeout_seconds = 600;
};
struct FetchAnswer {
  std::string path;  // of the object: "/objects/statue"
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint64_t active_triangles = 0;
  double error_bound = 0;  // model units
  Shortfall shortfall;     // where the mesh exceeds the error that was asked for
  std::string limit;       // what ended the refinement: "accuracy", "triangles", "bytes", "time"
  uint64_t clusters_read = 0, clusters_cached = 0, clusters_total = 0;
  uint64_t bytes_read = 0;  // by the server, from its store
  uint64_t bytes_received = 0;
  std::string file;  // JSON: what the file has of the mesh (docs/protocol.md, X-Mtdb-File)
};
// Hands the bytes of the mesh file to `receive`, at most 64 KiB at a time. An error of `receive`
// ends the transfer and is returned. What `receive` got before an error is an incomplete file.
Result<FetchAnswer> FetchMesh(const std::string& url, const std::string& query,
                              const FetchOptions& options,
                              const std::function<Status(std::string_view)>& receive);

struct RemoteSessionOptions {
  std::string name;                      // of the object, when the URL has none
  uint32_t remembered_vertices = 65536;  // how many removed vertices the client keeps, at most
  uint32_t max_triangles = 1u << 24;     // of the mesh; the server may have a lower limit
  // How long the server may take to connect, to upgrade, to take a query, and for each KiB or
  // message.
  double timeout_seconds = 600;
  double reconnect_seconds = 0;  // how long Update tries to replace a lost connection
};

// The answer to a query.
struct RemoteUpdate {
  uint64_t id = 0;
  // True when a later query arrived before this one was done; then all members up to `limit` are 0.
  bool superseded = false;
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint64_t active_triangles = 0;
  uint64_t insertions = 0, removals = 0;  // of vertices
  double error_bound = 0;                 // model units
  Shortfall shortfall;                    // where the mesh exceeds the error that was asked for
  double server_ms = 0;  // at the server, from the query's arrival to its last update
  std::string limit;     // as in FetchAnswer
  // Of the update stream, received since the last answer that was not superseded.
  uint64_t bytes = 0, messages = 0;
  // Milliseconds from sending the query to the first of these bytes (done_ms when there were none),
  // and to the answer.
  double first_ms = 0, done_ms = 0;
  // True when the connection was replaced: the mesh was made anew, and `bytes` counts all of it.
  bool restarted = false;
};

// A mesh that follows queries. One thread. Memory: some 100 bytes a triangle. The session answers
// pings of the server only during calls; when none is made for the server's --session-idle (300 s),
// the server closes the session.
class RemoteSession {
 public:
  // Connects and receives the base mesh, the coarsest.
  static Result<std::unique_ptr<RemoteSession>> Open(const std::string& url,
                                                     const RemoteSessionOptions& options = {});
  ~RemoteSession();

  // Called after each message of the update stream, which had `bytes` bytes; the mesh is then
  // conforming, and closer to the answer than before. May call Send. An error that it returns ends
  // the call that called it; the next call goes on with the session.
  using OnMessage = std::function<Status(uint64_t bytes)>;

  // Sends `query` and receives until its answer is there. Answers to earlier queries are dropped,
  // errors among them. After an error that the server sent as the answer, or that `on_message`
  // returned, the session goes on. After any other error it is closed; the next Update fails, or
  // starts from the base mesh on a new connection (reconnect_seconds).
  Result<RemoteUpdate> Update(const std::string& query, const OnMessage& on_message = {});

  // For callers that do not wait: sends `query` and returns its number, which RemoteUpdate::id of
  // its answer repeats. The server gives up the query before. Errors also: kInvalidArgument when
  // `query` is no JSON object.
  Result<uint64_t> Send(const std::string& query);
  // Waits for the next answer; every query gets one. kInvalidArgument when no answer is due.
  Result<RemoteUpdate> Receive(const OnMessage& on_message = {});
  // The number of the query that the last Receive returned the answer or error of; 0: it returned
  // none.
  uint64_t answered() const;

  bool connected() const;
  // Tells the server that the session ends, and waits until it has answered. The mesh stays.
  void Close();

  const std::string& object() const;     // its name
  double diagonal() const;               // of its bounds, model units
  uint64_t object_triangles() const;     // at full resolution
  uint64_t start_bytes() const;          // of the base mesh
  uint32_t remembered_vertices() const;  // as agreed
  // The reference is valid until the next call that may change the mesh.
  const ClientMesh& mesh() const;
  ClientMesh::Changes TakeChanges();
  // Sends the mesh with its attributes to `sink`; vertices are numbered anew, without gaps.
  Status SendMesh(MeshSink& sink) const;

 private:
  class Impl;
  explicit RemoteSession(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mtdb
