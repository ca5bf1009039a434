// What the connections and sessions of a server share: the loop that they live on, and threads for
// what takes long.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <functional>
#include <set>

#include "tools/internal/server.h"
#include "tools/internal/server_service.h"

namespace mtdb {

class ServerPeer;

// All but ServerService is used by the loop's thread only.
class ServerLoop {
 public:
  ServerLoop(const ServerOptions& server_options, ServerService& server_service)
      : options(server_options),
        service(server_service),
        queries(server_options.threads),
        catalog(1) {}

  boost::asio::thread_pool& pool(ServerService::Effort effort) {
    return effort == ServerService::Effort::kQuery ? queries : catalog;
  }
  ServerMetrics& metrics() { return service.metrics(); }

  const ServerOptions& options;
  ServerService& service;
  std::set<ServerPeer*> peers;
  bool stopping = false;
  std::function<void()> on_last_left;  // while stopping
  boost::asio::io_context io{1};
  // Last, so that their threads end first.
  boost::asio::thread_pool queries;
  boost::asio::thread_pool catalog;
};

// Somebody who is connected.
class ServerPeer {
 public:
  explicit ServerPeer(ServerLoop& loop) : loop_(loop) {
    loop_.peers.insert(this);
    loop_.metrics().connections = loop_.peers.size();
  }
  virtual ~ServerPeer() {
    loop_.peers.erase(this);
    loop_.metrics().connections = loop_.peers.size();
    if (loop_.stopping && loop_.peers.empty()) loop_.on_last_left();
  }
  ServerPeer(const ServerPeer&) = delete;
  ServerPeer& operator=(const ServerPeer&) = delete;

  // The server stops: finish what runs.
  virtual void Drain() = 0;
  // The server has waited long enough.
  virtual void Abort() = 0;

 protected:
  ServerLoop& loop_;
};

}  // namespace mtdb
