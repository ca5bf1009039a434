// SPDX-License-Identifier: Apache-2.0
// The manual pages and the completion of bash, made of the verbs and options that --help shows.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "store/base/status.h"

namespace mtdb {

// Writes into the folder: in roff mtdb.1, of the whole program, and mtdb-VERB.1 of each verb; and
// mtdb.bash, the script that bash loads when somebody completes `mtdb`. Errors: kIoError, kNoSpace.
Status WriteManual(const CLI::App& program, const std::string& version, const std::string& folder);

}  // namespace mtdb
