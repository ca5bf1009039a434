// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <spawn.h>
#include <string>
#include <sys/wait.h>

#include "tools/cli/verbs.h"
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

}  // namespace

Status View(const ViewArguments& arguments) {
  if (!arguments.page.empty()) return WritePage(arguments.page, arguments.sources);
  MTDB_RETURN_IF_ERROR(CheckViewer());
  ServerOptions options;
  options.service.store = arguments.store;
  options.listen.port = arguments.port;
  return ServeAndTell(options, [&](const std::string& url) {
    if (arguments.browser) OpenBrowser(url + "/");
  });
}

}  // namespace mtdb
