// SPDX-License-Identifier: Apache-2.0
// What the connections and sessions of a server share: the loop that they live on, and threads for
// what takes long.
#pragma once

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <exception>
#include <memory>
#include <set>
#include <utility>

#include "tools/server/internal/server_pool.h"
#include "tools/server/internal/server_service.h"
#include "tools/server/server.h"

namespace mtdb::internal {

class ServerPeer;

// All but ServerService and ServerMail::Post is used by the loop's thread only.
class ServerLoop {
 public:
  ServerLoop(const ServerOptions& server_options, ServerService& server_service)
      : options(server_options),
        service(server_service),
        queries(mail, {server_options.threads, server_options.threads},
                server_service.metrics().query_jobs),
        catalog(mail, {1, 1}, server_service.metrics().catalog_jobs),
        upstream(mail, {kUpstreamThreads, kUpstreamThreads},
                 server_service.metrics().upstream_jobs) {}

  ServerPool& pool(ServerService::Effort effort) {
    if (effort == ServerService::Effort::kUpstream) return upstream;
    return effort == ServerService::Effort::kQuery ? queries : catalog;
  }
  ServerMetrics& metrics() { return service.metrics(); }

  const ServerOptions& options;
  ServerService& service;
  std::set<ServerPeer*> peers;
  uint64_t next_connection = 0;
  bool stopping = false;  // no more queries
  bool aborting = false;  // and those that run are cancelled
  boost::asio::io_context io{1};
  ServerMail mail;
  // Last, so that their threads end first.
  ServerPool queries;
  ServerPool catalog;
  ServerPool upstream;

 private:
  static constexpr unsigned kUpstreamThreads = 8;  // which mostly wait
};

// Somebody who is connected.
class ServerPeer {
 public:
  ServerPeer(ServerLoop& loop, ServerClient client) : loop_(loop), client_(std::move(client)) {
    loop_.peers.insert(this);
    loop_.metrics().connections = loop_.peers.size();
  }
  virtual ~ServerPeer() {
    loop_.peers.erase(this);
    loop_.metrics().connections = loop_.peers.size();
  }
  ServerPeer(const ServerPeer&) = delete;
  ServerPeer& operator=(const ServerPeer&) = delete;

  // Several times a second: what must not go on for ever is looked at.
  virtual void Tick(Clock::time_point now) = 0;
  // The server stops: finish what runs.
  virtual void Drain() = 0;
  // The server has waited long enough.
  virtual void Abort() = 0;
  // Something could not be done, for want of memory as a rule: the connection ends, the server
  // goes on.
  virtual void GiveUp() noexcept = 0;

 protected:
  // `f`, called with the peer and what comes with the call, as something that keeps it alive and
  // lets nothing be thrown.
  template <typename Peer, typename F>
  static auto Guarded(std::shared_ptr<Peer> self, F f) {
    return [self = std::move(self), f = std::move(f)](auto&&... arguments) mutable {
      try {
        f(*self, std::forward<decltype(arguments)>(arguments)...);
      } catch (const std::exception&) {
        self->GiveUp();
      }
    };
  }

  ServerLoop& loop_;
  const ServerClient client_;
};

}  // namespace mtdb::internal
