// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/process.h"

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace mtdb::everything {

namespace {

using Clock = std::chrono::steady_clock;

std::vector<char*> Pointers(const Arguments& arguments) {
  std::vector<char*> pointers;
  for (const std::string& a : arguments) pointers.push_back(const_cast<char*>(a.c_str()));
  pointers.push_back(nullptr);
  return pointers;
}

std::string NextStem(const std::string& scratch) {
  static std::atomic<int> next{0};
  return scratch + "/child" + std::to_string(::getpid()) + "-" + std::to_string(next++);
}

}  // namespace

Child::Child(const Arguments& arguments, const std::string& scratch, const RunOptions& options)
    : stem_(NextStem(scratch)), options_(options), begin_(Clock::now()) {
  Arguments all = arguments;
  if (options.measure) {
    const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
    all.insert(all.begin(), {self, "--measure", stem_ + ".peak"});
  }
  const std::vector<char*> argv = Pointers(all);
  process_ = ::fork();
  if (process_ != 0) return;
  Redirect();
  ::execv(argv[0], argv.data());
  ::_exit(127);
}

Child::Child(const std::function<int()>& body, const std::string& scratch,
             const RunOptions& options)
    : stem_(NextStem(scratch)), options_(options), begin_(Clock::now()) {
  process_ = ::fork();
  if (process_ != 0) return;
  Redirect();
  ::_exit(body());
}

// In the child.
void Child::Redirect() const {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int out = ::open((stem_ + ".out").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  const int err = ::open((stem_ + ".err").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (out < 0 || err < 0 || ::dup2(out, 1) < 0 || ::dup2(err, 2) < 0) ::_exit(126);
  if (!options_.input.empty()) {
    const int in = ::open(options_.input.c_str(), O_RDONLY);
    if (in < 0 || ::dup2(in, 0) < 0) ::_exit(126);
  }
  for (const std::string& setting : options_.environment) {
    const size_t equals = setting.find('=');
    ::setenv(setting.substr(0, equals).c_str(), setting.substr(equals + 1).c_str(), 1);
  }
  if (!options_.folder.empty() && ::chdir(options_.folder.c_str()) != 0) ::_exit(126);
}

Child::~Child() {
  if (process_ > 0) {
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
  }
  std::error_code error;
  for (const char* end : {".out", ".err", ".peak"}) std::filesystem::remove(stem_ + end, error);
}

std::string Child::out() const { return ReadText(stem_ + ".out"); }
std::string Child::err() const { return ReadText(stem_ + ".err"); }

Ran Child::Wait() {
  Ran ran;
  int status = 0;
  const auto until = begin_ + std::chrono::duration<double>(options_.timeout_seconds);
  while (::waitpid(process_, &status, WNOHANG) == 0) {
    if (!ran.killed && options_.kill_when && options_.kill_when()) {
      ran.killed = true;
      ::kill(process_, SIGKILL);
    } else if (!ran.timed_out && Clock::now() > until) {
      ran.timed_out = true;
      ::kill(process_, SIGKILL);
    }
    std::this_thread::sleep_for(std::chrono::microseconds(500));
  }
  process_ = 0;
  ran.seconds = std::chrono::duration<double>(Clock::now() - begin_).count();
  if (WIFEXITED(status)) ran.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) ran.signal = WTERMSIG(status);
  ran.out = out();
  ran.err = err();
  if (options_.measure) {
    ran.peak_bytes = std::strtoull(ReadText(stem_ + ".peak").c_str(), nullptr, 10) << 10;
  }
  return ran;
}

Ran Run(const Arguments& arguments, const std::string& scratch, const RunOptions& options) {
  return Child(arguments, scratch, options).Wait();
}

Ran RunBody(const std::function<int()>& body, const std::string& scratch,
            const RunOptions& options) {
  return Child(body, scratch, options).Wait();
}

// A process's peak begins with what its parent had when it forked: hence the small one between.
int MeasureMain(int count, char** arguments) {
  if (count < 2) return 126;
  const pid_t child = ::fork();
  if (child == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::execv(arguments[1], arguments + 1);
    ::_exit(127);
  }
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  WriteText(arguments[0], std::to_string(usage.ru_maxrss));
  if (WIFSIGNALED(status)) {
    ::signal(WTERMSIG(status), SIG_DFL);
    ::raise(WTERMSIG(status));
  }
  return WEXITSTATUS(status);
}

std::string ReadText(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) return "";
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void WriteText(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

std::string CommandLine(const Arguments& arguments) {
  std::string line;
  for (const std::string& a : arguments) line += (line.empty() ? "" : " ") + a;
  return line;
}

}  // namespace mtdb::everything
