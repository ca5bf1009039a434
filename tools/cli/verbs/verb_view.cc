// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstdio>
#include <spawn.h>
#include <string>
#include <sys/wait.h>
#include <utility>
#include <vector>

#include "tools/cli/options.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/drape.h"
#include "tools/cli/verbs/serve_and_tell.h"
#include "tools/request/arguments.h"
#include "tools/server/server.h"

extern char** environ;

namespace mtdb {

namespace {

struct ViewArguments {
  std::string store;
  OpenOptions open;
  std::optional<Endpoint> listen;  // none: `port` on 127.0.0.1
  uint16_t port = 0;               // 0: any free one
  bool browser = true;
  std::string drape;                 // an image; empty: none
  std::string page;                  // the folder, to write the page only
  std::vector<std::string> sources;  // origins of files that it may read then, beside its own
};
// Asks the desktop to show the URL, and does not wait for it. Where there is none, the URL that was
// printed has to do.
void OpenBrowser(const std::string& url) {
  std::string script = "xdg-open \"$0\" > /dev/null 2>&1 < /dev/null &";
  std::string shell = "sh", option = "-c", argument = url;
  char* const arguments[] = {shell.data(), option.data(), script.data(), argument.data(), nullptr};
  pid_t process = 0;
  if (::posix_spawn(&process, "/bin/sh", nullptr, nullptr, arguments, environ) == 0) {
    ::waitpid(process, nullptr, 0);
  }
}

// The image, and its place as the world file that the page looks for beside it.
std::vector<ServedFile> FilesOf(PlacedImage image) {
  const auto& g = image.geotransform;
  std::string world;
  // A world file places the middle of the first pixel.
  for (const double number :
       {g[1], g[4], g[2], g[5], g[0] + (g[1] + g[2]) / 2, g[3] + (g[4] + g[5]) / 2}) {
    std::array<char, 40> line{};
    std::snprintf(line.data(), line.size(), "%.17g\n", number);
    world += line.data();
  }
  const bool png = image.mime_type == "image/png";
  return {{png ? "drape.png" : "drape.jpg", image.mime_type, std::move(image.bytes)},
          {png ? "drape.pgw" : "drape.jgw", "text/plain; charset=utf-8", world}};
}

// Serves the store on this machine, and has the desktop's browser show it; or writes the page.
Status View(const ViewArguments& arguments) {
  if (!arguments.page.empty()) return WritePage(arguments.page, arguments.sources);
  MTDB_RETURN_IF_ERROR(CheckViewer());
  ServerOptions options;
  options.service.store = arguments.store;
  options.service.open = arguments.open;
  options.listen.port = arguments.port;
  if (arguments.listen) options.listen = *arguments.listen;
  std::string page;
  if (!arguments.drape.empty()) {
    MTDB_ASSIGN_OR_RETURN(PlacedImage image, ReadPlacedImage(arguments.drape));
    options.service.files = FilesOf(std::move(image));
    page = "/?drape=" + options.service.files.front().name;
  }
  return ServeAndTell(options, page, [&](const std::string& url) {
    if (arguments.browser) OpenBrowser(page.empty() ? url + "/" : url);
  });
}

RunVerb AddView(VerbOptions* verb) {
  const auto a = std::make_shared<ViewArguments>();
  const VerbOption store =
      verb->Add("STORE", a->store, "the store file, or a packed file or its URL");
  const VerbOption page =
      verb->Add("--write-page", a->page,
                "only write the page's files into DIR, for any web server: beside them, "
                "index.html?src=FILE shows a packed file")
          .Form("DIR");
  verb->Add("--allowed-source", a->sources,
            "let the page of --write-page also read files of ORIGIN, as "
            "https://example.org (repeatable)")
      .Form("ORIGIN")
      .Repeatable()
      .Needs(page);
  verb->CheckAll([store, page, a]() -> Status {
    if (!store.is_given() && !page.is_given()) return InvalidArgument("STORE is required");
    if (store.is_given() && page.is_given()) {
      return InvalidArgument(
          "--write-page writes the page alone, without STORE; beside it: "
          "mtdb pack STORE " +
          a->page + "/scan.mtdbp, which index.html?src=scan.mtdbp shows");
    }
    return Status::Ok();
  });
  AddParsed(verb, "--listen", "WHERE", &a->listen, ParseEndpoint,
            "ADDRESS:PORT, or PORT on 127.0.0.1, as for serve: whoever can connect can read the "
            "whole store");
  verb->Add("--port", a->port, "listen on this port (default: any free one)")
      .Form("N")
      .Between(1, 65535)
      .Excludes("--listen");
  verb->AddFlag(
      "--no-browser", [a] { a->browser = false; }, "only print the URL");
  verb->Add("--drape", a->drape,
            "lay IMAGE, a PNG or JPEG with a world file or a GeoTIFF, over the surface")
      .Form("IMAGE")
      .Excludes(page);
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation&) { return View(*a); };
}

}  // namespace

const Verb kViewVerb{"view", "look at a store's objects in the browser",
                     "Serves STORE on this machine alone, prints the URL, and opens it by "
                     "xdg-open. Ends with SIGINT (Ctrl-C) or SIGTERM.\n"
                     "Example: mtdb view scans.mtdb\n"
                     "To choose limits, or to let others look: mtdb serve, whose URL shows "
                     "the same page.\n"
                     "For web servers without mtdb: mtdb view --write-page www; mtdb pack "
                     "scans.mtdb www/scan.mtdbp; then index.html?src=scan.mtdbp",
                     AddView};

}  // namespace mtdb
