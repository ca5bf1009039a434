// SPDX-License-Identifier: Apache-2.0
// consumer_client URL: opens a session of a server, or prints why there is none.
#include "tools/client/client.h"

#include <cstdio>

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const auto session = mtdb::RemoteSession::Open(argv[1]);
  if (!session.ok()) return std::printf("%s\n", session.status().message().c_str()), 0;
  return std::printf("%u triangles\n", (*session)->mesh().triangle_count()), 0;
}
