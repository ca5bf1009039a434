// SPDX-License-Identifier: Apache-2.0
// A packed file over HTTP from nginx: round trips, requests, bytes and seconds
//   - of the first picture: from nothing, the coarsest cut of 5,000 triangles or more;
//   - of a camera at one pixel of error, from nothing until exact;
// on loopback, and over a line of 50 ms and 20 Mbit/s. The line is a relay in this process, which
// keeps bytes back (netem needs a kernel module that many machines have not); it has no slow start.
//   remote_bench FILE.mtdbp... [--delay-ms 50] [--megabits 20] [--json FILE]
// Exit status 1 when an answer differs from that of the file on the disk; 0 and a word without
// nginx.
#include <CLI/CLI.hpp>
#include <arpa/inet.h>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <nlohmann/json.hpp>
#include <optional>
#include <sys/socket.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "query/camera.h"
#include "query/surface.h"
#include "query/threshold.h"
#include "store/base/mesh_sink.h"
#include "store/database.h"
#include "store/internal/open_ranges.h"
#include "store/internal/packed_reader.h"
#include "tests/support/temporary_folder.h"

namespace {

using namespace mtdb;
using namespace mtdb::internal;
using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

sockaddr_in Loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

int Listen(int* port) {
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address = Loopback(0);
  socklen_t size = sizeof(address);
  ::bind(listener, reinterpret_cast<sockaddr*>(&address), size);
  ::listen(listener, 64);
  ::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  *port = ntohs(address.sin_port);
  return listener;
}

int Connect(int port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in address = Loopback(port);
  if (::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    ::close(socket);
    return -1;
  }
  const int on = 1;
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  return socket;
}

// Carries bytes between clients and a server, each after half of the round trip, all of one
// direction one after the other at the line's rate.
class Line {
 public:
  Line(int server_port, double round_trip, double bytes_per_second)
      : server_port_(server_port), half_(round_trip / 2), rate_(bytes_per_second) {
    listener_ = Listen(&port_);
    acceptor_ = std::thread([this] { Accept(); });
  }
  ~Line() {
    stopping_ = true;
    ::shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    ::close(listener_);
    for (const int s : sockets_) ::shutdown(s, SHUT_RDWR);
    for (std::thread& t : threads_) t.join();
    for (const int s : sockets_) ::close(s);
  }
  int port() const { return port_; }

 private:
  struct Direction {
    std::mutex mutex;
    Clock::time_point free_at;  // when the line has sent what was given to it
  };
  struct Chunk {
    Clock::time_point due;
    std::string bytes;
  };

  void Accept() {
    while (!stopping_) {
      const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (client < 0) continue;
      const int server = Connect(server_port_);
      sockets_.push_back(client);
      sockets_.push_back(server);
      const int on = 1;
      ::setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
      threads_.emplace_back([=, this] { Carry(client, server, &up_, 2 * half_); });
      threads_.emplace_back([=, this] { Carry(server, client, &down_, 0); });
    }
  }

  // `first_delay`: what the handshake takes.
  void Carry(int from, int to, Direction* direction, double first_delay) {
    std::mutex mutex;
    std::deque<Chunk> chunks;
    std::atomic<bool> ended = false;
    const auto opened = Clock::now() + Duration(first_delay);
    std::thread sender([&] {
      for (;;) {
        std::optional<Chunk> chunk;
        {
          const std::lock_guard lock(mutex);
          if (!chunks.empty()) {
            chunk = std::move(chunks.front());
            chunks.pop_front();
          } else if (ended) {
            break;
          }
        }
        if (!chunk) {
          std::this_thread::sleep_for(std::chrono::microseconds(200));
          continue;
        }
        std::this_thread::sleep_until(chunk->due);
        for (size_t at = 0; at < chunk->bytes.size();) {
          const ssize_t n =
              ::send(to, chunk->bytes.data() + at, chunk->bytes.size() - at, MSG_NOSIGNAL);
          if (n <= 0) break;
          at += static_cast<size_t>(n);
        }
      }
      ::shutdown(to, SHUT_WR);
    });
    char block[1500];
    for (;;) {
      const ssize_t n = ::recv(from, block, sizeof(block), 0);
      if (n <= 0) break;
      const std::lock_guard line(direction->mutex);
      direction->free_at = std::max({direction->free_at, Clock::now(), opened}) +
                           Duration(static_cast<double>(n) / rate_);
      const std::lock_guard lock(mutex);
      chunks.push_back({direction->free_at + Duration(half_), {block, static_cast<size_t>(n)}});
    }
    ended = true;
    sender.join();
  }

  static Clock::duration Duration(double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }

  const int server_port_;
  const double half_, rate_;
  int listener_ = -1;
  int port_ = 0;
  std::atomic<bool> stopping_{false};
  Direction up_, down_;
  std::vector<int> sockets_;
  std::vector<std::thread> threads_;
  std::thread acceptor_;
};

// nginx, serving one folder.
class Nginx {
 public:
  explicit Nginx(const std::string& root) {
    ::close(Listen(&port_));
    const std::string f = folder_.path();
    std::ofstream config(f + "/nginx.conf");
    config << "daemon off; master_process off; error_log " << f << "/error.log; pid " << f
           << "/pid;\nevents {}\nhttp {\n  access_log off;\n";
    for (const char* kind : {"client_body", "proxy", "fastcgi", "uwsgi", "scgi"}) {
      config << "  " << kind << "_temp_path " << f << "/" << kind << ";\n";
    }
    config << "  server { listen 127.0.0.1:" << port_ << "; root " << root << "; }\n}\n";
    config.close();
    process_ = ::fork();
    if (process_ == 0) {
      for (const char* program : {"/usr/sbin/nginx", "/usr/bin/nginx"}) {
        ::execl(program, "nginx", "-e", (f + "/error.log").c_str(), "-c",
                (f + "/nginx.conf").c_str(), nullptr);
      }
      ::_exit(127);
    }
    for (int i = 0; i < 500 && !runs_; ++i) {
      const int socket = Connect(port_);
      runs_ = socket >= 0;
      if (runs_) ::close(socket);
      if (::waitpid(process_, nullptr, WNOHANG) == process_) process_ = 0;
      if (process_ == 0) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  ~Nginx() {
    if (process_ <= 0) return;
    ::kill(process_, SIGTERM);
    ::waitpid(process_, nullptr, 0);
  }
  bool runs() const { return runs_; }
  int port() const { return port_; }

 private:
  const mtdb::testing::TemporaryFolder folder_;
  int port_ = 0;
  pid_t process_ = 0;
  bool runs_ = false;
};

// Notes when requests begin and end.
class Recorder final : public RangeReader {
 public:
  explicit Recorder(std::shared_ptr<RangeReader> inner) : inner_(std::move(inner)) {}
  const std::string& name() const override { return inner_->name(); }
  uint64_t size() const override { return inner_->size(); }
  Ticket Read(ByteRange range, Answer answer) override {
    size_t at = 0;
    {
      const std::lock_guard lock(mutex_);
      at = times_.size();
      times_.push_back({Clock::now(), {}});
    }
    const Ticket ticket = inner_->Read(range, [this, at, answer](Result<Bytes> bytes) {
      {
        const std::lock_guard lock(mutex_);
        times_[at].end = Clock::now();
      }
      answer(std::move(bytes));
    });
    const std::lock_guard lock(mutex_);
    if (ticket == 0) times_[at].begin = times_[at].end = {};  // from memory
    return ticket;
  }
  void Cancel(Ticket ticket) override { inner_->Cancel(ticket); }
  bool answers_at_once() const override { return inner_->answers_at_once(); }
  uint64_t bytes_read() const override { return inner_->bytes_read(); }
  uint64_t requests() const override { return inner_->requests(); }

  // The longest chain of requests, each begun after the one before was answered; the one that
  // opened the file counts.
  size_t RoundTrips() const {
    const std::lock_guard lock(mutex_);
    std::vector<size_t> depth(times_.size());
    size_t most = 1;
    for (size_t i = 0; i < times_.size(); ++i) {
      if (times_[i].begin == Clock::time_point()) continue;
      depth[i] = 2;
      for (size_t j = 0; j < i; ++j) {
        if (depth[j] > 0 && times_[j].end != Clock::time_point() &&
            times_[j].end <= times_[i].begin) {
          depth[i] = std::max(depth[i], depth[j] + 1);
        }
      }
      most = std::max(most, depth[i]);
    }
    return most;
  }

 private:
  struct Times {
    Clock::time_point begin, end;
  };
  mutable std::mutex mutex_;
  std::vector<Times> times_;
  const std::shared_ptr<RangeReader> inner_;  // goes first: its answers come here
};

struct Measured {
  ExtractStats stats;
  uint64_t transferred = 0, requests = 0;
  size_t round_trips = 0;
  double seconds = 0;
};

class CountingSink final : public MeshSink {
 public:
  Status Begin(const MeshHeader&) override { return Status::Ok(); }
  Status AddVertices(std::span<const Vec3d>, ByteSpan) override { return Status::Ok(); }
  Status AddTriangles(std::span<const TriangleVertices>) override { return Status::Ok(); }
  Status End() override { return Status::Ok(); }
};

Result<Measured> Ask(const std::string& place, const Query& query) {
  const auto begin = Clock::now();
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<RangeReader> inner, OpenPackedRanges(place));
  const auto recorder = std::make_shared<Recorder>(std::move(inner));
  MTDB_ASSIGN_OR_RETURN(const auto file, PackedFile::Open(recorder));
  MTDB_ASSIGN_OR_RETURN(auto source,
                        PackedSource::Open(file, file->objects()[0], recorder->answers_at_once()));
  MTDB_ASSIGN_OR_RETURN(const auto surface, Surface::Open(std::move(source)));
  CountingSink sink;
  Measured m;
  MTDB_ASSIGN_OR_RETURN(m.stats, surface->Extract(query, sink));
  m.seconds = SecondsSince(begin);
  m.transferred = recorder->bytes_read();
  m.requests = recorder->requests();
  m.round_trips = recorder->RoundTrips();
  return m;
}

Query Uniform(double error) {
  Query query;
  query.threshold = ConstantThreshold(error);
  return query;
}

// The coarsest uniform cut of 5,000 triangles or more.
Query FirstPicture(const std::string& path, double diagonal) {
  double error = diagonal;
  while (Ask(path, Uniform(error)).value().stats.triangles < 5000 && error > 1e-9 * diagonal) {
    error /= 1.2;
  }
  return Uniform(error);
}

Query OnePixel(const ObjectRecord& record) {
  const Vec3d middle = (record.bounds.min + record.bounds.max) * 0.5;
  Camera camera;
  camera.eye = middle + Vec3d{0, -0.9 * record.diagonal(), 0.2 * record.diagonal()};
  camera.direction = middle - camera.eye;
  Query query;
  query.region = FrustumRegion(camera);
  query.threshold = ScreenThreshold(camera, 1);
  return query;
}

using Json = nlohmann::json;

// Prints a line; false when the answer is another than the file's own.
bool Measure(const std::string& name, const std::string& how, const std::string& path,
             const std::string& url, const Query& query, Json* rows) {
  const Result<Measured> expected = Ask(path, query);
  const Result<Measured> m = Ask(url, query);
  if (!expected.ok() || !m.ok()) {
    std::printf("FAILED: %s\n", (expected.ok() ? m : expected).status().message().c_str());
    return false;
  }
  const double needed = static_cast<double>(expected->stats.bytes_read);
  std::printf(
      "%-14s %-9s %8llu triangles %3llu of %llu clusters, %7.0f KB needed, %7.0f KB came "
      "(%.2f), %3llu requests, %2zu round trips, %.3f s\n",
      name.c_str(), how.c_str(), static_cast<unsigned long long>(m->stats.triangles),
      static_cast<unsigned long long>(expected->stats.clusters_read),
      static_cast<unsigned long long>(m->stats.clusters_total), needed / 1e3,
      static_cast<double>(m->transferred) / 1e3, static_cast<double>(m->transferred) / needed,
      static_cast<unsigned long long>(m->requests), m->round_trips, m->seconds);
  rows->push_back({{"what", name},
                   {"line", how},
                   {"triangles", m->stats.triangles},
                   {"clusters", expected->stats.clusters_read},
                   {"bytes_needed", expected->stats.bytes_read},
                   {"bytes", m->transferred},
                   {"requests", m->requests},
                   {"round_trips", m->round_trips},
                   {"seconds", m->seconds}});
  return m->stats.triangles == expected->stats.triangles &&
         m->stats.error_bound == expected->stats.error_bound;
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  CLI::App app{"A packed file from nginx, over loopback and over a slow line"};
  std::vector<std::string> files;
  double delay_ms = 50;
  double megabits = 20;
  std::string json;
  app.add_option("FILE", files, "packed files (mtdb pack)")->required();
  app.add_option("--delay-ms", delay_ms, "of a round trip");
  app.add_option("--megabits", megabits, "per second, each way");
  app.add_option("--json", json, "write the rows to a file");
  CLI11_PARSE(app, argc, argv);
  bool right = true;
  Json rows = Json::array();
  for (const std::string& file : files) {
    const std::filesystem::path path = std::filesystem::absolute(file);
    const Nginx nginx(path.parent_path());
    if (!nginx.runs()) {
      std::printf("skipped: nginx is not installed, or does not start\n");
      return 0;
    }
    const auto database = Database::Open(path);
    if (!database.ok()) {
      std::printf("%s\n", database.status().message().c_str());
      return 1;
    }
    const ObjectRecord record = (*database)->List().value().at(0);
    const Query first = FirstPicture(path, record.diagonal());
    const Query camera = OnePixel(record);
    Line line(nginx.port(), delay_ms / 1e3, megabits * 1e6 / 8);
    std::printf("%s: %llu triangles\n", file.c_str(),
                static_cast<unsigned long long>(record.triangles));
    const auto url = [&](int port) {
      return "http://127.0.0.1:" + std::to_string(port) + "/" + path.filename().string();
    };
    for (const auto& [how, port] :
         {std::pair<std::string, int>{"loopback", nginx.port()}, {"line", line.port()}}) {
      right &= Measure("first picture", how, path, url(port), first, &rows);
      right &= Measure("camera", how, path, url(port), camera, &rows);
    }
  }
  if (!json.empty()) std::ofstream(json) << rows.dump(1) << "\n";
  return right ? 0 : 1;
}
