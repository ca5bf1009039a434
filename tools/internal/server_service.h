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
#include "tools/internal/server_metrics.h"
#include "tools/internal/server_request.h"
#include "tools/internal/server_session.h"
#include "tools/internal/session_message.h"

namespace mtdb {

struct ServiceOptions {
  std::string store;
  std::string tmp;                             // folder of temporary files; empty: the system's
  uint64_t cache_bytes = uint64_t{256} << 20;  // of decoded clusters, for each open object
  bool implicit = false;                       // the cache keeps clusters as in the store
  unsigned objects = 4;                        // kept open, the last used
  unsigned threads = 1;                        // of one query's reading and decoding
  uint64_t max_triangles = 20'000'000;         // of one mesh
  uint64_t session_triangles = 1'000'000;      // of the mesh of a session's client
};

// A file without a name, open for reading.
class AnonymousFile {
 public:
  AnonymousFile() = default;
  // Takes the name away. kIoError.
  static Result<AnonymousFile> TakeOver(const std::string& path);
  AnonymousFile(AnonymousFile&& other) noexcept
      : descriptor_(std::exchange(other.descriptor_, -1)), size_bytes_(other.size_bytes_) {}
  AnonymousFile& operator=(AnonymousFile&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    std::swap(size_bytes_, other.size_bytes_);
    return *this;
  }
  ~AnonymousFile();

  bool is_open() const { return descriptor_ >= 0; }
  uint64_t size_bytes() const { return size_bytes_; }
  // Reads up to `size` bytes; 0 on an error.
  size_t ReadAt(uint64_t offset, char* out, size_t size) const;

 private:
  int descriptor_ = -1;
  uint64_t size_bytes_ = 0;
};

struct ServerRequest {
  std::string method;  // "GET"
  std::string target;
  std::string body;
};

struct ServerAnswer {
  unsigned status = 200;
  std::string content_type = "application/json";
  std::vector<std::pair<std::string, std::string>> headers;
  std::string body;        // or
  AnonymousFile file;      // when it is open
  uint64_t triangles = 0;  // in it
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
    kPreempted
  };
  QueryControl control;
  std::atomic<Stop> stop{Stop::kNone};

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
  };
  struct SessionOutcome {
    std::optional<ServerSession::End> end;  // none: an error
    SessionUpdate update;                   // of kDone
    ServerError error;
    bool broken = false;  // the session is of no use any more
  };

  // Errors: those of opening the store, kIoError when there is no place for temporary files.
  static Result<std::unique_ptr<ServerService>> Open(const ServiceOptions& options);
  ~ServerService();

  // What answering takes: nothing, some reads of the catalog, or a query.
  enum class Effort : uint8_t { kNone, kCatalog, kQuery };
  static Effort EffortOf(const std::string& target);

  // Never fails: errors are answers. What clients need not know of an error (paths, places in
  // files) goes to standard error.
  ServerAnswer Answer(const ServerRequest& request, ServerCall& call);

  // Why the call has no answer: for one that was cancelled.
  ServerError Stopped(const ServerCall& call);

  // Whether `target` asks for a session: /objects/NAME/session.
  static bool IsSession(const std::string& target);
  // The session, or the answer that says why there is none.
  std::unique_ptr<OpenedSession> OpenSession(const std::string& target, ServerAnswer* refusal);
  // One thread at a time for each session. Adds to `progress`.
  SessionOutcome Update(ServerSession& session, const SessionRequest& request,
                        const ServerSession::Pace& pace, ServerCall& call,
                        ServerSession::Progress* progress);

  ServerMetrics& metrics() { return metrics_; }

 private:
  explicit ServerService(const ServiceOptions& options) : options_(options) {}
  ServerAnswer Route(const ServerRequest& request, ServerCall& call);
  Result<ServerAnswer> Catalog();
  Result<ServerAnswer> Info(const std::string& name);
  Result<ServerAnswer> Mesh(const std::string& name, const MeshRequest& request, ServerCall& call);
  ServerAnswer Metrics();
  ServerError Failure(const Status& status, const std::string& name, const ServerCall& call,
                      bool opened);

  Result<std::shared_ptr<Surface>> OpenSurface(const std::string& name);
  std::shared_ptr<Surface> FindOpen(const ObjectRecord& record);
  bool Pin(const Surface* surface);
  void Unpin(const Surface* surface);

  const ServiceOptions options_;
  std::shared_ptr<Database> database_;
  std::string folder_;  // of temporary files; made and removed by this
  std::atomic<uint64_t> next_file_{0};
  ServerMetrics metrics_;

  std::mutex opening_;  // held while an object is opened
  std::mutex mutex_;
  std::vector<std::shared_ptr<Surface>> surfaces_;  // the last used last
  std::map<const Surface*, size_t> pins_;           // sessions, by surface
  uint64_t decoded_before_ = 0;                     // by surfaces that were closed
};

}  // namespace mtdb
