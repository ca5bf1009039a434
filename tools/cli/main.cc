// SPDX-License-Identifier: Apache-2.0
// mtdb: the command line. Exit status 0 success, 1 error, 2 usage: a command line that no store
// and no file could make right.

#include <csignal>
#include <cstdio>
#include <fcntl.h>
#include <new>
#include <unistd.h>

#include "tools/cli/command_line.h"
#include "tools/cli/verbs.h"

namespace {

// As help lists them.
constexpr const mtdb::Verb* kVerbs[] = {
    &mtdb::kIngestVerb, &mtdb::kInfoVerb,   &mtdb::kListVerb,    &mtdb::kExtractVerb,
    &mtdb::kVerifyVerb, &mtdb::kRenderVerb, &mtdb::kProbeVerb,   &mtdb::kProfileVerb,
    &mtdb::kServeVerb,  &mtdb::kFetchVerb,  &mtdb::kViewVerb,    &mtdb::kFollowVerb,
    &mtdb::kPackVerb,   &mtdb::kTileVerb,   &mtdb::kUnpackVerb,  &mtdb::kRemoveVerb,
    &mtdb::kRenameVerb, &mtdb::kCopyVerb,   &mtdb::kCompactVerb, &mtdb::kGenerateVerb,
    &mtdb::kDiffVerb,
};

// A store that is opened where standard input, output or error is closed would get its number, and
// what is printed.
void OccupyStandardDescriptors() {
  int file = ::open("/dev/null", O_RDWR);
  while (file >= 0 && file <= STDERR_FILENO) file = ::open("/dev/null", O_RDWR);
  if (file > STDERR_FILENO) ::close(file);
}

}  // namespace

// What memory runs out in unwinds, and so leaves nothing behind.
int main(int argc, char** argv) {
  OccupyStandardDescriptors();
  // A store on a full quota or a closed pipe is an error to report, not a reason to die.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  try {
    return mtdb::CommandLine(kVerbs, MTDB_VERSION).Run({argv + 1, argv + argc});
  } catch (const std::bad_alloc&) {
    std::fputs("mtdb: out of memory\n", stderr);
    return 1;
  }
}
