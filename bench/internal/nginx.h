// SPDX-License-Identifier: Apache-2.0
// Nginx: Debian's nginx, one worker, serving one folder.
#pragma once

#include <string>
#include <sys/types.h>

#include "tests/support/temporary_folder.h"

namespace mtdb {

class Nginx {
 public:
  // On `address`, at a port of its own, in the network namespace of that descriptor; -1: in this.
  Nginx(const std::string& root, const std::string& address, int network = -1);
  ~Nginx();
  Nginx(const Nginx&) = delete;
  Nginx& operator=(const Nginx&) = delete;

  // False when nginx is not installed, or does not start.
  bool runs() const { return runs_; }
  std::string UrlOf(const std::string& file) const;
  // That its process took so far.
  double CpuSeconds() const;

 private:
  void Configure(const std::string& root) const;

  const mtdb::testing::TemporaryFolder folder_;
  const std::string address_;
  pid_t process_ = 0;
  bool runs_ = false;
};

// Of a process: user and system time of all its threads; 0 when it is not there.
double CpuSecondsOf(pid_t process);

}  // namespace mtdb
