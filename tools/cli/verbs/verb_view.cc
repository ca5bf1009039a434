// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstdio>
#include <spawn.h>
#include <string>
#include <sys/wait.h>
#include <utility>
#include <vector>

#include "tools/cli/verbs.h"
#include "tools/cli/verbs/drape.h"
#include "tools/server/server.h"

extern char** environ;

namespace mtdb {

namespace {

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

}  // namespace

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

}  // namespace mtdb
