// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <sys/resource.h>

#include "tools/cli/verbs.h"
#include "tools/server/server.h"

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

Status Serve(const ServerOptions& options) {
  return ServeAndTell(options, "", [](const std::string&) {});
}

}  // namespace mtdb
