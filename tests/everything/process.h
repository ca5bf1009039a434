// SPDX-License-Identifier: Apache-2.0
// Child processes of a walk: started, watched, killed, measured.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <sys/types.h>
#include <vector>

namespace mtdb::everything {

using Arguments = std::vector<std::string>;

struct Ran {
  int exit_code = -1;  // -1: a signal ended it
  int signal = 0;
  bool timed_out = false;
  bool killed = false;      // by RunOptions::kill_when
  uint64_t peak_bytes = 0;  // of resident memory; 0: not measured
  double seconds = 0;
  std::string out, err;

  bool ok() const { return exit_code == 0; }
};

struct RunOptions {
  std::string folder = {};       // to run in; empty: this process's
  std::string input = {};        // the file that is standard input; empty: this process's
  double timeout_seconds = 900;  // for what hangs, on a machine that is busy
  // Asked every half millisecond; the process is killed (SIGKILL) when it says so.
  std::function<bool()> kill_when = {};
  bool measure = false;        // peak_bytes
  Arguments environment = {};  // NAME=VALUE, beside this process's
};

// A process under way; killed by the destructor.
class Child {
 public:
  // What it prints goes to files in `scratch`, which must exist.
  Child(const Arguments& arguments, const std::string& scratch, const RunOptions& options = {});
  // A function in a process of its own, whose exit code is what it returns.
  Child(const std::function<int()>& body, const std::string& scratch,
        const RunOptions& options = {});
  ~Child();
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  pid_t id() const { return process_; }
  Ran Wait();
  // What it has printed so far.
  std::string out() const;
  std::string err() const;

 private:
  void Redirect() const;
  std::string stem_;
  RunOptions options_;
  pid_t process_ = 0;
  std::chrono::steady_clock::time_point begin_;
};

Ran Run(const Arguments& arguments, const std::string& scratch, const RunOptions& options = {});
Ran RunBody(const std::function<int()>& body, const std::string& scratch,
            const RunOptions& options = {});

// The mode that a child with RunOptions::measure goes through: runs argv[1...] in a process that
// was never larger than a page or two, and writes its peak memory to the file argv[0].
int MeasureMain(int count, char** arguments);

// Empty when it is no file.
std::string ReadText(const std::string& path);
void WriteText(const std::string& path, const std::string& text);
std::string CommandLine(const Arguments& arguments);

}  // namespace mtdb::everything
