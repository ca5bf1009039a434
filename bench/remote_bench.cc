// SPDX-License-Identifier: Apache-2.0
// A packed file (mtdb pack) on a web server, and an engine that never waits.
//   remote_bench pictures FILE [--delay-ms 50] [--megabits 20] [--gap-kib ...]
//     From nothing, by nginx on loopback and over a slow line between two network namespaces: round
//     trips, requests, bytes and seconds until a session that takes what is there has 5,000
//     triangles of a camera's view, and until a query for that view is answered exactly.
//   remote_bench flight FILE [--triangles 300000] [--milliseconds 4] [--queries OUT.json]
//     Everything in memory: the calls of such a session along a flight around the object.
//   remote_bench clients FILE [--clients 8]
//     Flights at one pixel by so many processes at once: what they cost nginx, which has one
//     thread; beside it as many sessions of `mtdb serve`, of the program --mtdb.
// All take --json FILE. Exit status 1 when an answer differs from that of the file on the disk; 0
// and a word where nginx or namespaces are not there.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sched.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "bench/internal/nginx.h"
#include "bench/internal/packet_line.h"
#include "bench/internal/remote_view.h"
#include "bench/internal/workload.h"
#include "query/query_json.h"
#include "query/session.h"
#include "tools/client/client.h"

namespace {

using namespace mtdb;

constexpr double kFrameMilliseconds = 4;
constexpr uint64_t kFirstTriangles = 5000;
constexpr double kMostSeconds = 600;

struct Arguments {
  std::string file;
  LineOptions line;
  std::vector<unsigned> gaps{16};  // KiB
  unsigned repeat = 3;
  uint64_t triangles = 300000;
  double milliseconds = 4;
  size_t frames = 240;
  size_t clients = 8;
  std::string queries, mtdb, json;
  std::filesystem::path path() const { return std::filesystem::absolute(file); }
};

// What a client had seen when it was content.
struct Measured {
  ExtractStats stats;
  uint64_t bytes = 0, requests = 0;
  size_t round_trips = 0;
  double seconds = 0;
};

Measured Look(const RemoteObject& object, ExtractStats stats, double seconds) {
  return {std::move(stats), object.ranges->bytes_read(), object.ranges->requests(),
          object.ranges->RoundTrips(), seconds};
}

// A client that draws what it has.
Result<Measured> FirstPicture(const std::string& place, const internal::PackedRequests& requests) {
  const auto begin = BenchClock::now();
  MTDB_ASSIGN_OR_RETURN(const RemoteObject object, OpenRemote(place, {}, requests));
  MTDB_ASSIGN_OR_RETURN(const auto session,
                        Session::Open(object.surface, {.available_only = true}));
  // Calls of a frame: without a time they would go on with what comes meanwhile.
  Query query = View(object.surface->record(), 0, 1);
  query.max_milliseconds = kFrameMilliseconds;
  std::vector<UpdateBatch> batches;
  while (SecondsSince(begin) < kMostSeconds) {
    Result<SessionUpdate> update = session->Update(query, &batches);
    if (!update.ok() && update.status().code() != StatusCode::kNotYet) return update.status();
    if (update.ok() && update->stats.triangles >= kFirstTriangles) {
      return Look(object, std::move(update->stats), SecondsSince(begin));
    }
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  return IoError(place + ": nothing comes");
}

Result<Measured> Exact(const std::string& place, const internal::PackedRequests& requests) {
  const auto begin = BenchClock::now();
  MTDB_ASSIGN_OR_RETURN(const RemoteObject object, OpenRemote(place, {}, requests));
  NullSink sink;
  MTDB_ASSIGN_OR_RETURN(ExtractStats stats,
                        object.surface->Extract(View(object.surface->record(), 0, 1), sink));
  return Look(object, std::move(stats), SecondsSince(begin));
}

// The middle one of several runs by their seconds.
template <typename Run>
Result<Measured> Middle(unsigned times, Run&& run) {
  std::vector<Measured> all;
  for (unsigned i = 0; i < times; ++i) {
    MTDB_ASSIGN_OR_RETURN(Measured m, run());
    all.push_back(std::move(m));
  }
  std::ranges::sort(all, {}, &Measured::seconds);
  return std::move(all[all.size() / 2]);
}

void AddPicture(const std::string& what, const std::string& line, unsigned gap, const Measured& m,
                const Measured& needed, Json* rows) {
  const double bytes = static_cast<double>(needed.stats.bytes_read);
  std::printf(
      "%-14s %-9s gap %3u KiB: %8llu triangles, %4llu clusters, %7.0f KB needed, %7.0f KB "
      "came (%.2f), %3llu requests, %2zu round trips, %.3f s\n",
      what.c_str(), line.c_str(), gap, static_cast<unsigned long long>(m.stats.triangles),
      static_cast<unsigned long long>(needed.stats.clusters_read), bytes / 1e3,
      static_cast<double>(m.bytes) / 1e3, static_cast<double>(m.bytes) / bytes,
      static_cast<unsigned long long>(m.requests), m.round_trips, m.seconds);
  rows->push_back({{"what", what},
                   {"line", line},
                   {"gap_bytes", gap << 10},
                   {"triangles", m.stats.triangles},
                   {"clusters", needed.stats.clusters_read},
                   {"bytes_needed", needed.stats.bytes_read},
                   {"bytes", m.bytes},
                   {"requests", m.requests},
                   {"round_trips", m.round_trips},
                   {"seconds", m.seconds}});
}

Status MeasurePictures(const Arguments& a, const std::string& line, const std::string& url,
                       Json* rows) {
  MTDB_ASSIGN_OR_RETURN(const Measured expected, Exact(a.path(), {}));
  for (const unsigned gap : a.gaps) {
    internal::PackedRequests requests;
    requests.gap_bytes = uint64_t{gap} << 10;
    MTDB_ASSIGN_OR_RETURN(const Measured first,
                          Middle(a.repeat, [&] { return FirstPicture(url, requests); }));
    MTDB_ASSIGN_OR_RETURN(const Measured exact,
                          Middle(a.repeat, [&] { return Exact(url, requests); }));
    // A picture of what is there needs what came.
    Measured own = first;
    own.stats.bytes_read = first.bytes;
    AddPicture("first picture", line, gap, first, own, rows);
    AddPicture("camera", line, gap, exact, expected, rows);
    if (exact.stats.triangles != expected.stats.triangles ||
        exact.stats.error_bound != expected.stats.error_bound) {
      return Corrupt(url + ": the mesh is another one than that of the file on the disk");
    }
  }
  return Status::Ok();
}

Status Pictures(const Arguments& a, Json* rows) {
  const auto line = PacketLine::Make(a.line);
  const std::filesystem::path path = a.path();
  const std::string name = path.filename();
  const Nginx near(path.parent_path(), "127.0.0.1");
  if (!near.runs()) {
    std::printf("skipped: nginx is not installed, or does not start\n");
    return Status::Ok();
  }
  MTDB_RETURN_IF_ERROR(MeasurePictures(a, "loopback", near.UrlOf(name), rows));
  if (!line.ok()) {
    std::printf("no slow line: %s\n", line.status().message().c_str());
    return Status::Ok();
  }
  const Nginx far(path.parent_path(), PacketLine::far_address(), (*line)->far_namespace());
  if (!far.runs()) return IoError("nginx does not start in a network namespace");
  return MeasurePictures(a, "line", far.UrlOf(name), rows);
}

double ThreadSeconds() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct Calls {
  std::vector<double> wall, cpu;  // seconds
  uint64_t on_the_way = 0;        // that ended before all was done
  uint64_t triangles = 0;         // of the last mesh
};

double Mean(const std::vector<double>& list) {
  double sum = 0;
  for (const double x : list) sum += x;
  return sum / static_cast<double>(list.size());
}

// One call a frame, which may take so long; nullopt: to the end of what is there.
Result<Calls> Fly(Session& session, const std::vector<Query>& path, std::optional<double> most) {
  Calls calls;
  std::vector<UpdateBatch> batches;
  for (Query query : path) {
    query.max_milliseconds = most;
    const auto begin = BenchClock::now();
    const double cpu = ThreadSeconds();
    MTDB_ASSIGN_OR_RETURN(const SessionUpdate update, session.Update(query, &batches));
    calls.cpu.push_back(ThreadSeconds() - cpu);
    calls.wall.push_back(SecondsSince(begin));
    calls.on_the_way += update.stats.limit == QueryLimit::kTime ? 1 : 0;
    if (update.stats.limit == QueryLimit::kMissing) return NotYet("a cluster was not in memory");
    calls.triangles = update.stats.triangles;
  }
  return calls;
}

// Until nothing of it is missing.
Status LoadAll(Session& session, const std::vector<Query>& path) {
  std::vector<UpdateBatch> batches;
  for (const Query& query : path) {
    for (;;) {
      const Result<SessionUpdate> update = session.Update(query, &batches);
      if (!update.ok() && update.status().code() != StatusCode::kNotYet) return update.status();
      if (update.ok() && update->stats.limit == QueryLimit::kThreshold) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  return Status::Ok();
}

Status MeasureFlight(const Arguments& a, Json* rows) {
  SurfaceOptions options;
  options.cache_bytes = size_t{4} << 30;
  MTDB_ASSIGN_OR_RETURN(const RemoteObject object, OpenRemote(a.path(), options));
  const ObjectRecord& record = object.surface->record();
  MTDB_ASSIGN_OR_RETURN(const double pixels, PixelsFor(*object.surface, a.triangles));
  const std::vector<std::string> texts = Flight(record, a.frames, pixels);
  if (!a.queries.empty()) {
    Json list = Json::array();
    for (const std::string& text : texts) list.push_back(Json::parse(text));
    std::ofstream(a.queries) << list.dump() << "\n";
  }
  std::vector<Query> path;
  for (const std::string& text : texts) {
    MTDB_ASSIGN_OR_RETURN(Query query, ParseQuery(text, record.diagonal()));
    path.push_back(std::move(query));
  }
  for (const std::optional<double> most : {std::optional<double>(), {a.milliseconds}}) {
    MTDB_ASSIGN_OR_RETURN(const auto session,
                          Session::Open(object.surface, {.available_only = true}));
    MTDB_RETURN_IF_ERROR(LoadAll(*session, path));
    MTDB_RETURN_IF_ERROR(LoadAll(*session, {path.front()}));
    MTDB_ASSIGN_OR_RETURN(const Calls calls, Fly(*session, path, most));
    std::printf(
        "flight, %s: %llu triangles at %.2f pixels; a call %.2f ms, the longest %.2f; of "
        "processor time %.2f, %.2f; %llu of %zu on the way\n",
        most ? "with a time" : "to the end", static_cast<unsigned long long>(calls.triangles),
        pixels, 1e3 * Mean(calls.wall), 1e3 * std::ranges::max(calls.wall), 1e3 * Mean(calls.cpu),
        1e3 * std::ranges::max(calls.cpu), static_cast<unsigned long long>(calls.on_the_way),
        calls.wall.size());
    rows->push_back({{"what", "flight"},
                     {"engine", "native"},
                     {"milliseconds", most ? Json(*most) : Json()},
                     {"pixels", pixels},
                     {"triangles", calls.triangles},
                     {"mean_ms", 1e3 * Mean(calls.wall)},
                     {"longest_ms", 1e3 * std::ranges::max(calls.wall)},
                     {"cpu_mean_ms", 1e3 * Mean(calls.cpu)},
                     {"cpu_longest_ms", 1e3 * std::ranges::max(calls.cpu)},
                     {"calls", calls.wall.size()},
                     {"on_the_way", calls.on_the_way}});
  }
  return Status::Ok();
}

// What a client does in a process of its own: flies around once, exact at each frame.
Status FlyAsClient(const Arguments& a) {
  if (a.mtdb.empty()) {
    MTDB_ASSIGN_OR_RETURN(const RemoteObject object, OpenRemote(a.file));
    MTDB_ASSIGN_OR_RETURN(const auto session, Session::Open(object.surface));
    const ObjectRecord& record = object.surface->record();
    std::vector<UpdateBatch> batches;
    for (const std::string& text : Flight(record, a.frames, 1)) {
      MTDB_ASSIGN_OR_RETURN(const Query query, ParseQuery(text, record.diagonal()));
      MTDB_RETURN_IF_ERROR(session->Update(query, &batches).status());
    }
    return Status::Ok();
  }
  // `file` is the URL of a session, `mtdb` the packed file, for the object's bounds.
  MTDB_ASSIGN_OR_RETURN(const RemoteObject object, OpenRemote(a.mtdb));
  MTDB_ASSIGN_OR_RETURN(const auto session, RemoteSession::Open(a.file));
  for (const std::string& text : Flight(object.surface->record(), a.frames, 1)) {
    MTDB_RETURN_IF_ERROR(session->Update(text).status());
  }
  return Status::Ok();
}

// Of so many processes at once; the seconds until the last one ended.
Result<double> FlyAll(const Arguments& a, const std::string& url, const std::string& bounds) {
  const auto begin = BenchClock::now();
  std::vector<pid_t> clients;
  for (size_t i = 0; i < a.clients; ++i) {
    const pid_t client = ::fork();
    if (client == 0) {
      const std::string frames = std::to_string(a.frames);
      ::execl("/proc/self/exe", "remote_bench", "fly", url.c_str(), "--frames", frames.c_str(),
              "--mtdb", bounds.c_str(), nullptr);
      ::_exit(127);
    }
    clients.push_back(client);
  }
  bool good = true;
  for (const pid_t client : clients) {
    int status = 0;
    ::waitpid(client, &status, 0);
    good &= status == 0;
  }
  if (!good) return IoError(url + ": a client failed");
  return SecondsSince(begin);
}

void AddClients(const Arguments& a, const std::string& server, double cpu, double wall,
                Json* rows) {
  // The flight's frames are 60 a second.
  const double flight = static_cast<double>(a.frames) / 60;
  const double each = cpu / static_cast<double>(a.clients);
  std::printf(
      "%-10s %3zu clients, a flight of %.1f s each: %.3f s of the server's processor time "
      "for each, so that one core serves %.0f; all ended after %.1f s\n",
      server.c_str(), a.clients, flight, each, flight / each, wall);
  rows->push_back({{"what", "clients"},
                   {"server", server},
                   {"clients", a.clients},
                   {"flight_seconds", flight},
                   {"cpu_seconds", each},
                   {"clients_per_core", flight / each},
                   {"wall_seconds", wall}});
}

// `mtdb serve` of the file, on one core.
class Server {
 public:
  Server(const std::string& mtdb, const std::string& file) {
    process_ = ::fork();
    if (process_ != 0) return;
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(0, &one);
    ::sched_setaffinity(0, sizeof(one), &one);
    ::execl(mtdb.c_str(), "mtdb", "serve", file.c_str(), "--listen", "18081", nullptr);
    ::_exit(127);
  }
  ~Server() {
    ::kill(process_, SIGTERM);
    ::waitpid(process_, nullptr, 0);
  }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  static std::string url() { return "http://127.0.0.1:18081"; }
  bool WaitUntilThere() const {
    for (int i = 0; i < 1000; ++i) {
      if (RemoteSession::Open(url()).ok()) return true;
      if (::waitpid(process_, nullptr, WNOHANG) == process_) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return false;
  }
  double CpuSeconds() const { return CpuSecondsOf(process_); }

 private:
  pid_t process_ = 0;
};

Status MeasureClients(const Arguments& a, Json* rows) {
  const std::filesystem::path path = a.path();
  // Namespaces give the servers ports of their own.
  const auto line = PacketLine::Make(a.line);
  const Nginx nginx(path.parent_path(), "127.0.0.1");
  if (!nginx.runs()) {
    std::printf("skipped: nginx is not installed, or does not start\n");
    return Status::Ok();
  }
  const double before = nginx.CpuSeconds();
  MTDB_ASSIGN_OR_RETURN(const double wall, FlyAll(a, nginx.UrlOf(path.filename()), ""));
  AddClients(a, "nginx", nginx.CpuSeconds() - before, wall, rows);
  if (a.mtdb.empty()) return Status::Ok();
  const Server server(a.mtdb, path);
  if (!server.WaitUntilThere()) return IoError(a.mtdb + " serve does not start");
  const double idle = server.CpuSeconds();
  MTDB_ASSIGN_OR_RETURN(const double all, FlyAll(a, Server::url(), path));
  AddClients(a, "mtdb serve", server.CpuSeconds() - idle, all, rows);
  return Status::Ok();
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  CLI::App app{"A packed file on a web server, and an engine that never waits"};
  app.require_subcommand(1);
  Arguments a;
  double delay_ms = 50, megabits = 20;
  const auto add = [&](const char* name, const char* what) {
    CLI::App* const command = app.add_subcommand(name, what);
    command->add_option("FILE", a.file, "a packed file (mtdb pack)")->required();
    command->add_option("--json", a.json, "write the rows to a file");
    command->add_option("--frames", a.frames, "of a flight");
    return command;
  };
  CLI::App* const pictures = add("pictures", "from nothing, over nginx");
  pictures->add_option("--delay-ms", delay_ms, "of a round trip");
  pictures->add_option("--megabits", megabits, "per second, each way");
  pictures->add_option("--gap-kib", a.gaps, "between parts of one request; several: each");
  pictures->add_option("--repeat", a.repeat, "runs, of which the middle one counts");
  CLI::App* const flight = add("flight", "a session that never waits");
  flight->add_option("--triangles", a.triangles, "of the flight's first mesh, more or less");
  flight->add_option("--milliseconds", a.milliseconds, "of a call");
  flight->add_option("--queries", a.queries, "write the flight's queries to a file");
  CLI::App* const clients = add("clients", "flights at once");
  clients->add_option("--clients", a.clients, "processes");
  clients->add_option("--mtdb", a.mtdb, "the program mtdb, to measure mtdb serve too");
  CLI::App* const fly = add("fly", "one of the clients");
  fly->group("");
  fly->add_option("--mtdb", a.mtdb);
  CLI11_PARSE(app, argc, argv);
  a.line = {delay_ms / 1e3, megabits * 1e6 / 8};
  Json rows = Json::array();
  const Status status = *pictures  ? Pictures(a, &rows)
                        : *flight  ? MeasureFlight(a, &rows)
                        : *clients ? MeasureClients(a, &rows)
                                   : FlyAsClient(a);
  if (!status.ok()) {
    std::fprintf(stderr, "FAILED: %s\n", status.message().c_str());
    return 1;
  }
  return a.json.empty() || WriteRows(a.json, rows) ? 0 : 1;
}
