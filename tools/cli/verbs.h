// SPDX-License-Identifier: Apache-2.0
// The verbs of mtdb. Each is a row of the table in main.cc, and help, manual and completion follow
// from it.
#pragma once

#include <functional>
#include <string>

#include "store/base/status.h"
#include "tools/cli/verb_options.h"

namespace mtdb {

// What a verb knows of the command line besides its own options.
struct Invocation {
  std::string command;  // the whole line, as a shell reads it
  bool quiet = false;   // print nothing but errors; false where JSON is asked for
  bool failed = false;  // set by the verb: something is wrong, and was printed already
  // Set by the verb: the exit status where nothing is wrong, for answers that scripts ask for.
  int exit_status = 0;
};
// Prints the verb's result to standard output; an error is returned, and printed by main.
using RunVerb = std::function<Status(Invocation&)>;

struct Verb {
  const char* name;
  const char* summary;
  const char* footer;  // of its help: examples, and where more is said
  // Adds the arguments and options. What it returns is run when they have been read; it keeps what
  // they fill.
  RunVerb (*add)(VerbOptions* verb);
};

extern const Verb kIngestVerb, kInfoVerb, kListVerb, kExtractVerb, kVerifyVerb, kRenderVerb,
    kProbeVerb, kProfileVerb, kServeVerb, kFetchVerb, kViewVerb, kFollowVerb, kPackVerb, kTileVerb,
    kUnpackVerb, kRemoveVerb, kRenameVerb, kCopyVerb, kCompactVerb, kGenerateVerb, kDiffVerb;

}  // namespace mtdb
