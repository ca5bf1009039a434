// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <sys/resource.h>

#include "tools/cli/options.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/serve_and_tell.h"

namespace mtdb {

Status ServeAndTell(const ServerOptions& options, const std::string& page,
                    const std::function<void(const std::string& url)>& listening) {
  // A connection takes up to two descriptors.
  rlimit files{};
  if (::getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur < files.rlim_max) {
    files.rlim_cur = files.rlim_max;
    (void)::setrlimit(RLIMIT_NOFILE, &files);
  }
  return RunServer(options, [&](const std::string& url) {
    std::printf("%s%s\n", url.c_str(), page.c_str());
    std::fflush(stdout);
    listening(url + page);
  });
}

namespace {

// How long what may take, who may come, and where temporary files go.
void AddServeTimes(VerbOptions* verb, ServerOptions* o) {
  AddParsed(verb, "--idle", "SECONDS", &o->idle_seconds, ParsePositiveSeconds,
            "close a connection that is silent for so long")
      .Default("30");
  AddParsed(verb, "--session-idle", "SECONDS", &o->session_idle_seconds, ParsePositiveSeconds,
            "close a session whose client has said nothing for so long, nor answered a ping")
      .Default("300");
  AddParsed(verb, "--timeout", "SECONDS", &o->timeout_seconds, ParsePositiveSeconds,
            "give up a request that takes longer, its sending included")
      .Default("600");
  AddParsed(verb, "--grace", "SECONDS", &o->grace_seconds, ParseSeconds,
            "when told to stop, let running requests finish for so long")
      .Default("5");
  verb->Add("--allowed-origin", o->allowed_origin,
            "let web pages of this origin open sessions and read tiles, e.g. "
            "http://localhost:3000; * is any (default: those that come from the server's own "
            "address only)")
      .Form("ORIGIN");
  verb->Add("--allowed-host", o->allowed_hosts,
            "let clients call the server by this name, e.g. scans.example.org; * is any "
            "(default: by address and localhost only)")
      .Form("NAME");
  verb->Add("--tmp", o->service.tmp, "folder of temporary files (default: the system's)")
      .Form("DIR");
}

RunVerb AddServe(VerbOptions* verb) {
  const auto o = std::make_shared<ServerOptions>();
  AddStore(verb, &o->service.store);
  const auto number = [&](const char* name, auto* value, int64_t smallest, int64_t largest,
                          const char* description) {
    return verb->Add(name, *value, description).Form("N").Between(smallest, largest);
  };
  AddParsed(verb, "--listen", "WHERE", &o->listen, ParseEndpoint,
            "ADDRESS:PORT, or PORT on 127.0.0.1; port 0 is any free one. Whoever can connect can "
            "read the whole store: there are no passwords")
      .Default("127.0.0.1:8080");
  number("--threads", &o->threads, 1, 1024, "answer N queries at once (default: one per core)");
  AddCache(verb, &o->service.cache_bytes, "256M");
  AddImplicit(verb, &o->service.implicit);
  number("--max-objects", &o->service.objects, 1, 10000, "keep the last N objects open");
  number("--max-connections", &o->max_connections, 1, 100000,
         "take at most N connections; others are told to try again");
  number("--max-sessions", &o->max_sessions, 1, 100000,
         "open at most N sessions among them; others are told to try again");
  AddParsed(verb, "--max-triangles", "N", &o->service.max_triangles, ParseCount,
            "send no mesh of more triangles")
      .Default("20000000");
  AddParsed(verb, "--session-triangles", "N", &o->service.session_triangles, ParseCount,
            "let no session's mesh have more triangles; each takes some 250 to 700 bytes here")
      .Default("1000000");
  AddParsed(verb, "--session-memory", "SIZE", &o->service.session_memory_bytes, ParseSize,
            "let all sessions and comparisons take so much memory; then the largest give way")
      .Default("2G");
  AddParsed(verb, "--max-tmp", "SIZE", &o->service.temporary_bytes, ParseSize,
            "let all answers under way take so much of temporary files; then the largest give way")
      .Default("4G");
  AddParsed(verb, "--tile-space", "SIZE", &o->service.tile_space_bytes, ParseSize,
            "let what tiles are made of take so much of temporary files; then the objects that "
            "were asked for longest ago give way. An object takes some 80 bytes a triangle")
      .Default("4G");
  AddServeTimes(verb, o.get());
  AddCacheDirectory(verb, &o->service.open);
  return [o](Invocation&) { return ServeAndTell(*o, "", [](const std::string&) {}); };
}

}  // namespace

const Verb kServeVerb{
    "serve", "give meshes and sessions to clients over HTTP",
    "Prints the server's URL. Ends with SIGINT (Ctrl-C) or SIGTERM.\n"
    "Examples: mtdb serve scans.mtdb --listen 127.0.0.1:8080\n"
    "          curl http://127.0.0.1:8080/objects\n"
    "          curl 'http://127.0.0.1:8080/objects/statue/mesh?error=0.5&format=glb' "
    "-o statue.glb\n"
    "Tiles:    /objects/NAME/3dtiles/tileset.json, .../quantized-mesh/layer.json,\n"
    "          .../terrain-rgb/tiles.json, .../neuroglancer/info; options of mtdb tile\n"
    "          stand in the path:\n"
    "          /objects/statue/3dtiles/at=11.57,48.14,520&pixels=4/tileset.json\n"
    "More: docs/protocol.md, docs/tiles.md",
    AddServe};

}  // namespace mtdb
