// SPDX-License-Identifier: Apache-2.0
// CommandLine: verbs, their help, and the exit status of what they say.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "tools/cli/verbs.h"

namespace mtdb {

class CommandLine {
 public:
  CommandLine(std::span<const Verb* const> verbs, const std::string& version);

  // Runs the verb that the arguments begin with, and returns the exit status. "--write-manual DIR",
  // which is for the build and not for users, writes the manual and the completion.
  int Run(const std::vector<std::string>& arguments);

 private:
  // Exit status where the arguments ask for nothing that is to be run.
  std::optional<int> Parse(std::vector<std::string> arguments);
  int RunParsed(const CLI::App& verb, const RunVerb& run, const std::string& command);

  const std::string version_;
  CLI::App app_{"mtdb: an out-of-core database of triangle meshes"};
  std::vector<std::pair<const CLI::App*, RunVerb>> verbs_;
};

}  // namespace mtdb
