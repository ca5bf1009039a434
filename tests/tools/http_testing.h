// SPDX-License-Identifier: Apache-2.0
// `mtdb serve` as a process, and raw connections to it.
#pragma once

#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <memory>
#include <thread>

#include "tests/support/raw_connection.h"
#include "tests/tools/cli_testing.h"

namespace mtdb::test {

inline HttpAnswer AskServer(int port, const std::string& method, const std::string& target,
                            const std::string& body = "") {
  RawConnection connection(port);
  if (!connection.connected()) return {};
  connection.Send(RequestText(method, target, body));
  return connection.ReceiveAnswer(method == "HEAD");
}

// A server of one store; stopped by the destructor.
class ServerProcess {
 public:
  // On any free port, or on `port`.
  explicit ServerProcess(const std::string& store, const Arguments& options = {}, int port = 0) {
    const std::string listen = "127.0.0.1:" + std::to_string(port);
    Arguments arguments{"serve", store, "--listen", listen, "--tmp", TmpFolder()};
    arguments.insert(arguments.end(), options.begin(), options.end());
    process_ = Start(arguments, folder_.File("out"), folder_.File("err"));
    for (int i = 0; i < 2000 && port_ == 0; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      const std::string line = ReadText(folder_.File("out"));
      if (!line.ends_with('\n')) continue;
      url_ = line.substr(0, line.size() - 1);
      port_ = std::stoi(url_.substr(url_.rfind(':') + 1));
    }
    INFO(errors());
    REQUIRE(port_ > 0);
  }
  ~ServerProcess() {
    if (process_ == 0) return;
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
  }

  const std::string& url() const { return url_; }
  int port() const { return port_; }
  std::string errors() const { return ReadText(folder_.File("err")); }
  // Temporary files that are there now.
  size_t temporary_files() const {
    size_t files = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(TmpFolder())) {
      files += entry.is_regular_file() ? 1 : 0;
    }
    return files;
  }
  std::string TmpFolder() const {
    std::filesystem::create_directory(folder_.File("tmp"));
    return folder_.File("tmp");
  }

  void Signal(int signal) { ::kill(process_, signal); }
  // Waits for its end.
  Outcome Finish() { return test::Finish(std::exchange(process_, 0)); }
  Outcome Stop() {
    Signal(SIGTERM);
    return Finish();
  }

  HttpAnswer Ask(const std::string& method, const std::string& target,
                 const std::string& body = "") const {
    return AskServer(port_, method, target, body);
  }
  HttpAnswer Get(const std::string& target) const { return Ask("GET", target); }

  // A value of /metrics; -1 when there is none of that name.
  double Metric(const std::string& name) const {
    const std::string text = "\n" + Get("/metrics").body;
    const size_t at = text.find("\n" + name + " ");
    return at == std::string::npos ? -1 : std::stod(text.substr(at + name.size() + 2));
  }
  // Waits until a value of /metrics is at least `least`, or exactly `value`.
  bool Reaches(const std::string& name, double least) const {
    return Await([&] { return Metric(name) >= least; });
  }
  bool Becomes(const std::string& name, double value) const {
    return Await([&] { return Metric(name) == value; });
  }
  template <typename Condition>
  static bool Await(Condition&& condition) {
    for (int i = 0; i < 12000; ++i) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }
  pid_t process() const { return process_; }
  // What the server's process has in memory.
  uint64_t resident_bytes() const {
    std::istringstream statm(ReadText("/proc/" + std::to_string(process_) + "/statm"));
    uint64_t total = 0, resident = 0;
    statm >> total >> resident;
    return resident * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
  }

 private:
  Folder folder_;
  pid_t process_ = 0;
  std::string url_;
  int port_ = 0;
};

// What lies outside of many small polygons: each triangle is asked about each of them.
inline std::string OutsidePolygons(int count) {
  constexpr int kCorners = 12;
  std::string prisms;
  for (int i = 0; i < count; ++i) {
    std::string corners;
    for (int k = 0; k < kCorners; ++k) {
      const double angle = 6.283 * k / kCorners;
      const auto number = [](double value) {
        return std::to_string(std::lround(1e4 * value)) + "e-4";
      };
      corners += (k == 0 ? "[" : ",[") + number((i % 80 - 40) / 40.0 + 1e-3 * std::cos(angle)) +
                 "," + number((i / 80 - 25) / 25.0 + 1e-3 * std::sin(angle)) + "]";
    }
    prisms += (i == 0 ? "" : ",") + (R"({"prism":{"polygon":[)" + corners) + "]}}";
  }
  return R"({"region":{"outside":{"union":[)" + prisms + R"(]}},"clip":true})";
}
// Takes seconds.
inline std::string SlowQuery() { return OutsidePolygons(1000); }
// Takes ten seconds or more.
inline std::string EndlessQuery() { return OutsidePolygons(4000); }

}  // namespace mtdb::test
