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

HttpAnswer AskServer(int port, const std::string& method, const std::string& target,
                     const std::string& body = "");

// A server of one store; stopped by the destructor.
class ServerProcess {
 public:
  // On any free port, or on `port`.
  explicit ServerProcess(const std::string& store, const Arguments& options = {}, int port = 0);
  ~ServerProcess();

  const std::string& url() const { return url_; }
  int port() const { return port_; }
  std::string errors() const { return ReadText(folder_.File("err")); }
  // Temporary files that are there now.
  size_t temporary_files() const;
  std::string TmpFolder() const;

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
  double Metric(const std::string& name) const;
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
  uint64_t resident_bytes() const;

 private:
  Folder folder_;
  pid_t process_ = 0;
  std::string url_;
  int port_ = 0;
};

// What lies outside of many small polygons: each triangle is asked about each of them.
std::string OutsidePolygons(int count);
// Takes seconds.
std::string SlowQuery();
// Takes ten seconds or more.
std::string EndlessQuery();

}  // namespace mtdb::test
