// SPDX-License-Identifier: Apache-2.0
// What `mtdb serve` answers: the catalog, objects, meshes and metrics of one store, without the
// protocol's transport (server.h). Specified in docs/protocol.md.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "query/query_control.h"
#include "query/surface.h"
#include "store/base/status.h"
#include "store/database.h"
#include "tools/client/session_message.h"
#include "tools/server/http/server_request.h"
#include "tools/server/internal/anonymous_file.h"
#include "tools/server/internal/named_locks.h"
#include "tools/server/internal/server_ledger.h"
#include "tools/server/internal/server_metrics.h"
#include "tools/server/internal/server_packed.h"
#include "tools/server/internal/server_session.h"
#include "tools/server/internal/server_tiles.h"
#include "tools/server/server.h"

namespace mtdb::internal {

struct ServerRequest {
  std::string method;  // "GET"
  std::string target;
  std::string body;
  std::string range, if_range, if_none_match;  // the headers
};

struct ServerAnswer {
  unsigned status = 200;
  std::string content_type = "application/json";
  std::vector<std::pair<std::string, std::string>> headers;
  std::string body;        // or
  AnonymousFile file;      // when it is open
  uint64_t triangles = 0;  // in it
  // Web pages of the server's allowed origin may read it, where others may not.
  bool for_pages = false;
};
struct ServerError {
  static constexpr unsigned kPreempted = 0;  // as a status: to be asked again
  unsigned status = 500;                     // HTTP's
  const char* code = "";                     // for programs
  std::string message;
};
// {"error": message, "code": code}
ServerAnswer ErrorAnswer(const ServerError& error);
inline ServerAnswer ErrorAnswer(unsigned status, const char* code, const std::string& message) {
  return ErrorAnswer({status, code, message});
}

// One request on its way; shared by the connection and the thread that answers.
struct ServerCall {
  enum class Stop : uint8_t {
    kNone,
    kClientGone,
    kTimeout,
    kShutdown,
    kSuperseded,
    kTooLarge,
    kPreempted,
    kNoRoom
  };
  QueryControl control;
  std::atomic<Stop> stop{Stop::kNone};
  std::unique_ptr<ServerLedger::Account> temporary;  // of a mesh: what its file takes
  std::unique_ptr<ServerLedger::Account> memory;     // of a comparison: what it holds

  void Cancel(Stop why) {
    Stop none = Stop::kNone;
    stop.compare_exchange_strong(none, why);
    control.Cancel();
  }
};

// Safe for many threads.
class ServerService {
 public:
  // A session, and what goes with it.
  struct OpenedSession {
    ~OpenedSession();
    ServerService* service = nullptr;
    std::shared_ptr<Surface> surface;  // stays open with the session
    std::unique_ptr<ServerSession> session;
    std::unique_ptr<ServerLedger::Account> memory;
  };
  struct SessionOutcome {
    std::optional<ServerSession::End> end;  // none: an error
    SessionUpdate update;                   // of kDone
    ServerError error;
    bool broken = false;  // the session is of no use any more
  };

  // Errors: those of opening the store, kIoError when there is no place for temporary files.
  static Result<std::unique_ptr<ServerService>> Open(const ServiceOptions& options);

  // What answering takes: nothing, some reads of the catalog, a query, or waiting for another
  // server that has the store, which those who do not wait for it must not share threads with.
  enum class Effort : uint8_t { kNone, kCatalog, kQuery, kUpstream };
  Effort EffortOf(const std::string& target) const;
  // Of opening a session.
  Effort SessionEffort() const { return is_remote_ ? Effort::kUpstream : Effort::kCatalog; }

  // Never fails: errors are answers. What clients need not know of an error (paths, places in
  // files) goes to standard error.
  ServerAnswer Answer(const ServerRequest& request, ServerCall& call);

  // Why the call has no answer: for one that was cancelled.
  ServerError Stopped(const ServerCall& call);

  // Whether `target` asks for a session: /objects/NAME/session.
  static bool IsSession(const std::string& target);
  // The session, or the answer that says why there is none.
  std::unique_ptr<OpenedSession> OpenSession(const std::string& target, const ServerClient& client,
                                             ServerCall& call, ServerAnswer* refusal);
  // One thread at a time for each session. Adds to `progress`.
  // `pace` lacks what is asked of memory.
  SessionOutcome Update(OpenedSession& opened, const SessionRequest& request,
                        ServerSession::Pace pace, ServerCall& call,
                        ServerSession::Progress* progress);
  // That there is no memory for what a session wants to hold.
  ServerError NoSessionMemory() const;

  // What temporary files of answers take.
  ServerLedger& temporary() { return temporary_; }
  // What sessions and comparisons hold.
  ServerLedger& memory() { return session_memory_; }

  ServerMetrics& metrics() { return metrics_; }

 private:
  explicit ServerService(const ServiceOptions& options)
      : options_(options),
        images_(options.objects),
        tiles_(options.tile_space_bytes),
        temporary_(options.temporary_bytes),
        session_memory_(options.session_memory_bytes) {}
  ServerAnswer Route(const ServerRequest& request, ServerCall& call);
  Result<ServerAnswer> Catalog();
  Result<ServerAnswer> Info(const std::string& name);
  Result<ServerAnswer> Mesh(const std::string& name, const MeshRequest& request, ServerCall& call);
  Result<ServerAnswer> Probe(const std::string& name, const ProbeRequest& request,
                             ServerCall& call);
  ServerAnswer Diff(const ServerRequest& request, ServerCall& call);
  Result<ServerAnswer> Packed(const RequestTarget& target, const ServerRequest& request,
                              ServerCall& call);
  ServerAnswer TileAnswer(const RequestTarget& target, const ServerRequest& request,
                          ServerCall& call);
  Result<ServerAnswer> Tile(const RequestTarget& target, const ServerRequest& request,
                            ServerCall& call);
  ServerAnswer Metrics();
  ServerError Failure(const Status& status, const std::string& name, const ServerCall& call,
                      bool opened);

  Result<std::shared_ptr<Surface>> OpenSurface(const std::string& name);
  std::shared_ptr<Surface> FindOpen(const ObjectRecord& record);
  bool Pin(const Surface* surface);
  void Unpin(const Surface* surface);

  const ServiceOptions options_;
  // Of the file that the path leads to by now: the store may be compacted, or replaced by another.
  // Nobody waits long for a URL: until it has answered, what was open is served on.
  std::shared_ptr<Database> CurrentDatabase();
  struct Reopening;
  // With database_mutex_ held.
  void AdoptReopened(Result<std::shared_ptr<Database>> opened,
                     std::vector<std::shared_ptr<Surface>>* closed);
  std::string store_;                     // path or URL
  bool is_remote_ = false;                // a URL
  std::shared_ptr<Reopening> reopening_;  // guarded by database_mutex_; null: none is under way
  std::mutex database_mutex_;             // taken before mutex_
  std::shared_ptr<Database> database_;    // guarded by database_mutex_
  std::string folder_;                    // of temporary files
  PackedImages images_;
  ServedTiles tiles_;
  ServerLedger temporary_;
  ServerLedger session_memory_;
  ServerMetrics metrics_;

  NamedLocks opening_;  // held while an object is opened
  std::mutex mutex_;
  std::vector<std::shared_ptr<Surface>> surfaces_;  // the last used last
  std::map<const Surface*, size_t> pins_;           // sessions, by surface
  uint64_t decoded_before_ = 0;                     // by surfaces that were closed
};

}  // namespace mtdb::internal
