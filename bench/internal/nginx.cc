// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/nginx.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sched.h>
#include <sstream>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace mtdb {
namespace {

constexpr int kPort = 18080;  // of a network namespace that nobody else has

}  // namespace

double CpuSecondsOf(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string line;
  std::getline(file, line);
  // The program's name, in parentheses, may have blanks.
  const size_t end = line.rfind(')');
  if (end == std::string::npos) return 0;
  std::istringstream rest(line.substr(end + 1));
  std::string skipped;
  for (int i = 0; i < 11; ++i) rest >> skipped;
  double user = 0, system = 0;
  rest >> user >> system;
  const double ticks = (user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
  // To the nanosecond, of threads that are there.
  double exact = 0;
  std::error_code error;
  for (const auto& task :
       std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/task", error)) {
    double nanoseconds = 0;
    std::ifstream(task.path() / "schedstat") >> nanoseconds;
    exact += 1e-9 * nanoseconds;
  }
  return std::max(ticks, exact);
}

Nginx::Nginx(const std::string& root, const std::string& address, int network) : address_(address) {
  Configure(root);
  const std::string& f = folder_.path();
  process_ = ::fork();
  if (process_ == 0) {
    if (network >= 0 && ::setns(network, CLONE_NEWNET) != 0) ::_exit(127);
    for (const char* program : {"/usr/sbin/nginx", "/usr/bin/nginx"}) {
      ::execl(program, "nginx", "-e", (f + "/error.log").c_str(), "-c", (f + "/nginx.conf").c_str(),
              nullptr);
    }
    ::_exit(127);
  }
  // Its process id is written when it listens.
  for (int i = 0; i < 1000 && !runs_; ++i) {
    if (::waitpid(process_, nullptr, WNOHANG) == process_) {
      process_ = 0;
      return;
    }
    runs_ = std::filesystem::exists(f + "/pid");
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

void Nginx::Configure(const std::string& root) const {
  const std::string& f = folder_.path();
  std::ofstream config(f + "/nginx.conf");
  config << "daemon off; master_process off; error_log " << f << "/error.log; pid " << f
         << "/pid;\nevents {}\nhttp {\n  access_log off; keepalive_requests 1000000;\n";
  for (const char* kind : {"client_body", "proxy", "fastcgi", "uwsgi", "scgi"}) {
    config << "  " << kind << "_temp_path " << f << "/" << kind << ";\n";
  }
  config << "  server { listen " << address_ << ":" << kPort << "; root " << root << "; }\n}\n";
}

Nginx::~Nginx() {
  if (process_ <= 0) return;
  ::kill(process_, SIGTERM);
  ::waitpid(process_, nullptr, 0);
}

std::string Nginx::UrlOf(const std::string& file) const {
  return "http://" + address_ + ":" + std::to_string(kPort) + "/" + file;
}

double Nginx::CpuSeconds() const { return CpuSecondsOf(process_); }

}  // namespace mtdb
