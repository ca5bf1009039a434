// The client's side of `mtdb serve` (docs/protocol.md): one mesh at a time, or a session that is
// sent what changes from query to query. Link mtdb::client; it needs neither LMDB nor the query
// library. Queries are JSON texts, as docs/query.md has them.
//
//   mtdb::RemoteSessionOptions options;
//   auto session = mtdb::RemoteSession::Open("http://localhost:8080/objects/statue", options);
//   auto update = (*session)->Update(R"({"threshold": 0.5})");
//   draw((*session)->mesh());       // update->error_bound, bytes, done_ms, ...
//
// A URL is http://HOST:PORT/objects/NAME, or http://HOST:PORT with a name or for a server of one
// object. Calls block. Errors of all of them: kInvalidArgument and kNotFound for what the server
// refuses, kBudgetExceeded for what it takes to be too much, kBusy when it may be asked again
// later, kIoError when it does not answer or breaks off, kBadInput when it is no mtdb serve. A
// message begins with the URL.
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
  std::string name;            // of the object, when the URL has none
  std::string format = "ply";  // one that docs/protocol.md lists
  // Without progress: to connect, to take the query, to answer it, and for each KiB of the mesh.
  double timeout_seconds = 600;
};
struct FetchAnswer {
  std::string path;  // of the object: "/objects/statue"
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint64_t active_triangles = 0;
  double error_bound = 0;  // model units
  Shortfall shortfall;     // where it is above the error that was asked for
  std::string limit;       // what ended the refinement: "accuracy", "triangles", "bytes", "time"
  uint64_t clusters_read = 0, clusters_cached = 0, clusters_total = 0;
  uint64_t bytes_read = 0;  // by the server, from its store
  uint64_t bytes_received = 0;
};
// Hands the mesh file's bytes to `receive`, piece by piece (at most 64 KiB); its first error ends
// the transfer and is returned. What was received before an error is a part of a file.
Result<FetchAnswer> FetchMesh(const std::string& url, const std::string& query,
                              const FetchOptions& options,
                              const std::function<Status(std::string_view)>& receive);

struct RemoteSessionOptions {
  std::string name;                      // of the object, when the URL has none
  uint32_t remembered_vertices = 65536;  // removed ones that the client keeps, or fewer
  uint32_t max_triangles = 1u << 24;     // of the mesh; the server sends no more, or fewer
  // Without progress: to connect, to upgrade, to take a query, and for each KiB or message.
  double timeout_seconds = 600;
  double reconnect_seconds = 0;  // how long Update tries to replace a lost connection
};

// The answer to a query.
struct RemoteUpdate {
  uint64_t id = 0;
  // A later query came before it was done; then what follows up to `limit` is 0.
  bool superseded = false;
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint64_t active_triangles = 0;
  uint64_t insertions = 0, removals = 0;  // of vertices
  double error_bound = 0;                 // model units
  Shortfall shortfall;                    // where it is above the error that was asked for
  double server_ms = 0;                   // from the query's arrival to its last update
  std::string limit;                      // as in FetchAnswer
  // Of the update stream since the last answer that was not superseded.
  uint64_t bytes = 0, messages = 0;
  // From sending the query to the first of these bytes (done_ms when there were none), and to the
  // answer.
  double first_ms = 0, done_ms = 0;
  bool restarted = false;  // the connection was replaced: the mesh was made anew, bytes has all
};

// A mesh that follows queries. One thread. Memory: some 100 bytes a triangle. Pings of the server
// are answered within calls only: it closes a session without one for its --session-idle (300 s).
class RemoteSession {
 public:
  // Connects and receives the base mesh, the coarsest.
  static Result<std::unique_ptr<RemoteSession>> Open(const std::string& url,
                                                     const RemoteSessionOptions& options = {});
  ~RemoteSession();

  // Called after each message of the update stream, of `bytes` bytes: the mesh is conforming then
  // and better than before. May call Send. Its error ends the call under way; the session goes on
  // with the next one.
  using OnMessage = std::function<Status(uint64_t bytes)>;

  // Send, and Receive until the answer to it is there; answers to those sent before are dropped,
  // errors too. After an error that the server told, and
  // after errors of `on_message`, the session goes on; after others it is closed, and the next
  // Update fails, or starts anew from the base mesh (reconnect_seconds).
  Result<RemoteUpdate> Update(const std::string& query, const OnMessage& on_message = {});

  // For those who do not wait: the number of the query, which Receive's answer bears. The server
  // gives up what it was doing for the query before. Errors also: kInvalidArgument for what is no
  // JSON object.
  Result<uint64_t> Send(const std::string& query);
  // The next answer; every query has one. kInvalidArgument when none is due.
  Result<RemoteUpdate> Receive(const OnMessage& on_message = {});
  // The query that the last Receive brought the answer to, be it an error; 0: to none.
  uint64_t answered() const;

  bool connected() const;
  // Tells the server, and waits until it knows. The mesh stays.
  void Close();

  const std::string& object() const;     // its name
  double diagonal() const;               // of its bounds, model units
  uint64_t object_triangles() const;     // at full resolution
  uint64_t start_bytes() const;          // of the base mesh
  uint32_t remembered_vertices() const;  // as agreed
  // Good until the next call that may change it.
  const ClientMesh& mesh() const;
  ClientMesh::Changes TakeChanges();
  // Sends the mesh with its attributes, without gaps.
  Status SendMesh(MeshSink& sink) const;

 private:
  class Impl;
  explicit RemoteSession(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mtdb
