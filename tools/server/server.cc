// SPDX-License-Identifier: Apache-2.0
#include "tools/server/server.h"

#include <algorithm>
#include <atomic>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <future>
#include <memory>
#include <mutex>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <new>
#include <optional>
#include <sys/socket.h>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>

#include "store/base/out_of_memory.h"
#include "tools/client/network.h"
#include "tools/server/http/server_connection.h"
#include "tools/server/http/server_loop.h"
#include "tools/server/http/server_origin.h"
#include "tools/server/internal/freed_memory.h"

namespace mtdb {

using namespace internal;

namespace {

// How often everything is looked at: while there is something to wait for, and else.
constexpr auto kBusyPeriod = std::chrono::milliseconds(20);
constexpr auto kIdlePeriod = std::chrono::milliseconds(100);
constexpr auto kAcceptPause = std::chrono::milliseconds(100);
// What was cancelled is waited for so long.
constexpr auto kLastWait = std::chrono::seconds(2);
// Connections above the limit that are told so; those above these are just closed.
constexpr size_t kMaxRefused = 64;
// What the system takes of an answer before it is sent. It would take up to 4 MiB for a client that
// does not read, beside every limit, and the answer would look as if it was on its way.
constexpr int kMostUnsentBytes = 256 << 10;

// SIGINT and SIGTERM count here and wake the loop: that takes no memory.
class StopSignals {
 public:
  explicit StopSignals(const ServerMail& mail) {
    g_mail = &mail;
    g_count = 0;
    struct sigaction action {};
    action.sa_handler = [](int) {
      ++g_count;
      if (const ServerMail* woken = g_mail) woken->Wake();
    };
    action.sa_flags = SA_RESTART;
    ::sigaction(SIGINT, &action, &before_[0]);
    ::sigaction(SIGTERM, &action, &before_[1]);
  }
  ~StopSignals() {
    ::sigaction(SIGINT, &before_[0], nullptr);
    ::sigaction(SIGTERM, &before_[1], nullptr);
    g_mail = nullptr;
  }
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  static int count() { return g_count; }

 private:
  static inline std::atomic<int> g_count{0};
  static inline std::atomic<const ServerMail*> g_mail{nullptr};
  static_assert(std::atomic<int>::is_always_lock_free);
  struct sigaction before_[2];
};

// Told by another thread; the loop looks at it again and again.
struct StopOrders {
  std::atomic<int> count{0};  // 1: let running requests finish; 2: cancel them
  std::atomic<double> grace_seconds{0};
};

// The loop goes on whatever is thrown in it: what one handler could not do for want of memory ends
// with its connection, and what keeps the server going is looked at again and again.
class Server {
 public:
  Server(const ServerOptions& options, ServerService& service) : loop_(options, service) {}

  // Until a signal says so, or `orders` when there are any.
  Status Run(const std::function<void(const std::string& url)>& listening,
             const StopOrders* orders);

 private:
  Status Listen();
  void Step();
  void Await();
  void AwaitMail();
  void Accept();
  void OnAccept(Tcp::socket socket);
  void Tick();
  void Stop(double grace_seconds);
  void Abort();
  [[noreturn]] static void LeaveProcess(const ServerMetrics& metrics);

  ServerLoop loop_;
  FreedMemory freed_memory_{loop_.catalog};
  Tcp::acceptor acceptor_{loop_.io};
  asio::posix::stream_descriptor wake_{loop_.io};
  bool accepting_ = false;
  bool awaiting_mail_ = false;
  Clock::time_point accept_after_;
  Clock::time_point abort_at_, leave_at_;
};

Status Server::Listen() {
  const Endpoint& listen = loop_.options.listen;
  const std::string where = listen.text();
  ErrorCode error;
  const auto address = asio::ip::make_address(listen.address, error);
  if (error) {
    return InvalidArgument(where + ": expected an address of this machine such as 127.0.0.1");
  }
  const Tcp::endpoint endpoint(address, listen.port);
  acceptor_.open(endpoint.protocol(), error);
  if (!error) acceptor_.set_option(Tcp::acceptor::reuse_address(true), error);
  if (!error) acceptor_.bind(endpoint, error);
  if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
  if (!error) return Status::Ok();
  return IoError(where + ": cannot listen there: " + error.message() +
                 "; choose another with --listen, port 0 for any free one");
}

Status Server::Run(const std::function<void(const std::string& url)>& listening,
                   const StopOrders* orders) {
  MTDB_RETURN_IF_ERROR(Listen());
  MTDB_RETURN_IF_ERROR(loop_.queries.Start());
  MTDB_RETURN_IF_ERROR(loop_.catalog.Start());
  if (loop_.service.SessionEffort() == ServerService::Effort::kUpstream) {
    MTDB_RETURN_IF_ERROR(loop_.upstream.Start());
  }
  wake_.assign(::dup(loop_.mail.descriptor()));
  std::optional<StopSignals> signals;
  if (orders == nullptr) signals.emplace(loop_.mail);
  const auto told = [&] { return orders == nullptr ? StopSignals::count() : orders->count.load(); };
  listening("http://" +
            Endpoint{loop_.options.listen.address, acceptor_.local_endpoint().port()}.text());
  while (!loop_.stopping || !loop_.peers.empty()) {
    Step();
    if (!loop_.stopping && told() > 0) {
      Stop(orders == nullptr ? loop_.options.grace_seconds : orders->grace_seconds.load());
    }
    const Clock::time_point now = Clock::now();
    if (loop_.stopping && !loop_.aborting && (told() > 1 || now > abort_at_)) Abort();
    if (loop_.aborting && now > leave_at_) {
      if (orders == nullptr) LeaveProcess(loop_.metrics());
      Abort();  // whose client has not taken the last words by now is dropped
    }
  }
  return Status::Ok();
}

// Neither queries that still run nor clients hold anything that must not be lost.
void Server::LeaveProcess(const ServerMetrics& metrics) {
  const uint64_t running =
      metrics.query_jobs.running + metrics.catalog_jobs.running + metrics.upstream_jobs.running;
  if (running > 0) {
    std::fprintf(stderr, "mtdb: %llu running queries did not stop in time; left them\n",
                 static_cast<unsigned long long>(running));
  }
  std::fflush(nullptr);
  std::_Exit(0);
}

void Server::Step() {
  try {
    Await();
    const bool busy =
        loop_.stopping || loop_.metrics().in_flight > 0 || loop_.metrics().sessions > 0;
    loop_.io.restart();
    if (loop_.io.run_for(busy ? kBusyPeriod : kIdlePeriod) == 0 && loop_.io.stopped()) {
      std::this_thread::sleep_for(kBusyPeriod);  // there is no memory to wait for anything
    }
  } catch (const std::exception&) {
    // Whose handler it was has lost its connection.
  }
  try {
    loop_.mail.Deliver();
  } catch (const std::exception&) {
  }
  Tick();
}

void Server::Await() {
  if (!awaiting_mail_) AwaitMail();
  if (!accepting_ && !loop_.stopping && Clock::now() >= accept_after_) Accept();
}

void Server::AwaitMail() {
  awaiting_mail_ = true;
  try {
    wake_.async_wait(asio::posix::stream_descriptor::wait_read, [this](ErrorCode) {
      awaiting_mail_ = false;
      AwaitMail();
      loop_.mail.Deliver();
    });
  } catch (...) {
    awaiting_mail_ = false;
    throw;
  }
}

void Server::Accept() {
  accepting_ = true;
  try {
    acceptor_.async_accept([this](ErrorCode error, Tcp::socket socket) {
      accepting_ = false;
      if (loop_.stopping) return;
      // Most likely out of descriptors: others must finish first.
      accept_after_ = error ? Clock::now() + kAcceptPause : Clock::time_point();
      if (!error) OnAccept(std::move(socket));
      if (!error) Accept();
    });
  } catch (...) {
    accepting_ = false;
    throw;
  }
}

void Server::OnAccept(Tcp::socket socket) {
  if (loop_.peers.size() >= loop_.options.max_connections + kMaxRefused) return;
  ErrorCode error;
  socket.set_option(Tcp::no_delay(true), error);
  (void)setsockopt(socket.native_handle(), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &kMostUnsentBytes,
                   sizeof(kMostUnsentBytes));
  const Tcp::endpoint from = socket.remote_endpoint(error);
  if (error) return;  // gone already
  const bool refused = loop_.peers.size() >= loop_.options.max_connections;
  ServerClient client{ClientAddress(from.address()), loop_.next_connection++};
  ServeConnection(loop_, std::move(socket), std::move(client), refused);
}

void Server::Tick() {
  const Clock::time_point now = Clock::now();
  loop_.queries.Tick();
  loop_.catalog.Tick();
  loop_.upstream.Tick();
  freed_memory_.Tick(now);
  // A peer may go when it is looked at.
  for (auto at = loop_.peers.begin(); at != loop_.peers.end();) {
    ServerPeer* const peer = *at++;
    peer->Tick(now);
  }
}

void Server::Stop(double grace_seconds) {
  loop_.stopping = true;
  abort_at_ = Clock::now() + Seconds(grace_seconds);
  ErrorCode ignored;
  acceptor_.close(ignored);
  for (auto at = loop_.peers.begin(); at != loop_.peers.end();) {
    ServerPeer* const peer = *at++;
    peer->Drain();
  }
}

void Server::Abort() {
  loop_.aborting = true;
  leave_at_ = Clock::now() + kLastWait;
  for (auto at = loop_.peers.begin(); at != loop_.peers.end();) {
    ServerPeer* const peer = *at++;
    peer->Abort();
  }
}

Status RunServerUntil(const ServerOptions& options,
                      const std::function<void(const std::string& url)>& listening,
                      const StopOrders* orders) {
  ServerOptions filled = options;
  if (filled.threads == 0) filled.threads = std::max(1u, std::thread::hardware_concurrency());
  filled.service.threads = filled.threads;
  try {
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ServerService> service,
                          ServerService::Open(filled.service));
    return Server(filled, *service).Run(listening, orders);
  } catch (const std::bad_alloc&) {
    return {StatusCode::kNoSpace, "there is not enough memory to serve"};
  } catch (const std::system_error& error) {
    return IoError(std::string("cannot serve: ") + error.what());
  }
}

}  // namespace

Status RunServer(const ServerOptions& options,
                 const std::function<void(const std::string& url)>& listening) {
  return RunServerUntil(options, listening, nullptr);
}

struct BackgroundServer::Impl {
  StopOrders orders;
  const pid_t process = getpid();  // after a fork the thread is the parent's
  std::string url;
  std::promise<void> begun;  // it listens, or it has ended
  Status ended;
  std::mutex stopping;
  std::thread thread;  // last: it uses the others
};

BackgroundServer::BackgroundServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Result<std::unique_ptr<BackgroundServer>> BackgroundServer::Start(const ServerOptions& options) {
  return CatchOutOfMemory([&]() -> Result<std::unique_ptr<BackgroundServer>> {
    std::unique_ptr<BackgroundServer> server(new BackgroundServer(std::make_unique<Impl>()));
    Impl& impl = *server->impl_;
    const auto run = [&impl, options] {
      bool listens = false;
      impl.ended = RunServerUntil(
          options,
          [&](const std::string& url) {
            impl.url = url;
            listens = true;
            impl.begun.set_value();
          },
          &impl.orders);
      if (!listens) impl.begun.set_value();
    };
    std::future<void> begun = impl.begun.get_future();
    try {
      impl.thread = std::thread(run);
    } catch (const std::system_error&) {
      return Status(StatusCode::kNoSpace, "there is not enough memory for a thread to serve with");
    }
    begun.wait();
    if (!impl.url.empty()) return server;
    impl.thread.join();
    return impl.ended;
  });
}

BackgroundServer::~BackgroundServer() {
  (void)Stop(0);
  // There is no thread here that could be joined, and no lock that is surely free.
  if (impl_->process != getpid()) (void)impl_.release();
}

const std::string& BackgroundServer::url() const { return impl_->url; }

Status BackgroundServer::Stop(double grace_seconds) {
  if (impl_->process != getpid()) {
    return InvalidArgument(
        "the server runs in the parent of this process, which alone can stop it");
  }
  const std::lock_guard lock(impl_->stopping);
  impl_->orders.grace_seconds = grace_seconds;
  ++impl_->orders.count;
  if (impl_->thread.joinable()) impl_->thread.join();
  return impl_->ended;
}

}  // namespace mtdb
