// SPDX-License-Identifier: Apache-2.0
// Clients that mean no good, many of them, in a process of their own.
#pragma once

#include <csignal>
#include <string>
#include <sys/types.h>

namespace mtdb::test {

// Runs until it is destroyed. Each kind is one letter, each client goes on with the next life of
// its kind when the server has ended one:
//   e  a session that asks for everything, then for nothing, and so on, and never reads
//   c  a session with a memory that asks for clipped parts all over the object, and reads
//   s  a mesh that is read by a few bytes a second
//   p  costly regions, given up at any time
//   b  random bytes, truncated requests, wrong frames
//   m  sessions with messages of up to a MiB
//   f  connections that are opened and closed
class HostileClients {
 public:
  // `kinds`: one letter for each client. They come from the addresses 127.0.0.2 to
  // 127.0.0.`addresses`+1, or all from 127.0.0.1 when there are none.
  HostileClients(int port, const std::string& object, const std::string& kinds, int addresses = 0);
  ~HostileClients();
  HostileClients(const HostileClients&) = delete;
  HostileClients& operator=(const HostileClients&) = delete;

  bool running() const { return ::kill(process_, 0) == 0; }

 private:
  pid_t process_;
};

}  // namespace mtdb::test
