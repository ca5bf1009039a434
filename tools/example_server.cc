// SPDX-License-Identifier: Apache-2.0
// A program with a job of its own that also serves a store: clients get meshes and sessions from it
// until its standard input ends. It links libmtdb.so alone. example_server STORE
#include <cstdio>
#include <memory>

#include "tools/c/mtdb_show.h"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  mtdb_error error;
  mtdb_server* started = nullptr;
  mtdb_serve_options options;
  MTDB_INIT(options);
  options.port = 0;  // any free one
  if (mtdb_serve(argv[1], &options, &started, &error) != MTDB_OK) {
    return std::fprintf(stderr, "%s\n", error.message), 1;
  }
  const std::unique_ptr<mtdb_server, void (*)(mtdb_server*)> server(started, mtdb_free_server);
  std::printf("%s\n", mtdb_get_server_url(server.get()));
  std::fflush(stdout);
  while (std::getchar() != EOF) {  // the program's own job
  }
  if (mtdb_stop_server(server.get(), 2, &error) != MTDB_OK) {
    return std::fprintf(stderr, "%s\n", error.message), 1;
  }
  return 0;
}
