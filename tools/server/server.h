// SPDX-License-Identifier: Apache-2.0
// The HTTP server of `mtdb serve`: connections, limits, shutdown. What it answers is ServerService.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "store/base/status.h"
#include "store/database.h"
#include "tools/request/endpoint.h"

namespace mtdb {

// A file beside the page's. It is in memory, and once more for each client that it is sent to.
struct ServedFile {
  std::string name;  // without slashes; one of the page's own goes before it
  std::string content_type;
  std::string bytes;
};

// What is served, and what it may take.
struct ServiceOptions {
  std::string store;
  OpenOptions open = {};  // of a URL: where what is read of it stays
  std::vector<ServedFile> files;
  std::string tmp;                             // folder of temporary files; empty: the system's
  uint64_t cache_bytes = uint64_t{256} << 20;  // of decoded clusters, for each open object
  bool implicit = false;                       // the cache keeps clusters as in the store
  unsigned objects = 4;                        // kept open, the last used
  unsigned threads = 1;                        // of one query's reading and decoding
  uint64_t max_triangles = 20'000'000;         // of one mesh
  uint64_t session_triangles = 1'000'000;      // of the mesh of a session's client
  uint64_t session_memory_bytes = uint64_t{2} << 30;  // of all sessions
  uint64_t temporary_bytes = uint64_t{4} << 30;       // of all answers under way
  uint64_t tile_space_bytes = uint64_t{4} << 30;      // of temporary files that tiles are made of
};

struct ServerOptions {
  ServiceOptions service;
  Endpoint listen{"127.0.0.1", 8080};  // port 0: any free one
  unsigned threads = 0;                // queries at once; 0: as many as the machine has
  unsigned max_connections = 256;      // those above are answered with 503
  unsigned max_sessions = 64;          // likewise
  double idle_seconds = 30;            // for a request to arrive, or between two bytes of an answer
  double session_idle_seconds = 300;   // of a session's client that answers no ping
  // Of web pages that may open sessions and read tiles; "*": any.
  std::string allowed_origin;
  // Names that clients may call the server by, beside addresses and localhost; "*": any.
  std::vector<std::string> allowed_hosts;
  double timeout_seconds = 600;  // from a request's last byte to its answer's last
  double grace_seconds = 5;      // for running requests when the server is told to stop
};

// Serves until SIGINT or SIGTERM, then lets running requests finish for grace_seconds, cancels what
// is left and returns. A second signal cancels at once. What does not stop within two seconds after
// that is left: the process ends, with status 0 and a line on standard error. `listening` is called
// with the URL once clients can connect. All connections are served by the calling thread, queries
// by a pool that gives each client its share of time (fair_queue.h); an answer on its way takes 64
// KiB of memory, whatever its size, and a session's updates wait when a MiB of them is on its way.
// Without memory a request gets 503 or its connection ends, and the next one is served. Errors:
// those of ServerService::Open, kInvalidArgument and kIoError when it cannot listen, kNoSpace
// without memory for a thread.
Status RunServer(const ServerOptions& options,
                 const std::function<void(const std::string& url)>& listening);

// The same in a thread of its own, for programs that have another job. Signals stay the program's:
// Stop() ends it. What was cancelled is waited for, however long it takes.
class BackgroundServer {
 public:
  // Returns when clients can connect. Errors: those of RunServer.
  static Result<std::unique_ptr<BackgroundServer>> Start(const ServerOptions& options);
  // Stops at once. In a child that was forked it leaves the parent's server alone.
  ~BackgroundServer();
  BackgroundServer(const BackgroundServer&) = delete;
  BackgroundServer& operator=(const BackgroundServer&) = delete;

  const std::string& url() const;
  // Lets running requests finish for so long, cancels what is left, and waits for it. Again: the
  // same answer. Threads may call it at once. Returns how the server ended. Errors:
  // kInvalidArgument in a child that was forked, too.
  Status Stop(double grace_seconds);

 private:
  struct Impl;
  explicit BackgroundServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Whether this server has a page to show at / (tools/viewer). kUnsupported says why not.
Status CheckViewer();

// Writes the page's files into `folder`, which is made if need be, for any web server: beside a
// packed file, index.html?src=FILE shows it. The page reads files of its own origin, and of those
// in `sources` ("https://example.org:8443"). Files of the same names are replaced, one by one.
// Errors: kInvalidArgument (no origin), those of CheckViewer and of writing.
Status WritePage(const std::string& folder, const std::vector<std::string>& sources);

}  // namespace mtdb
