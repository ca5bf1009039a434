// SPDX-License-Identifier: Apache-2.0
// The server that tells where it is: serve and view.
#pragma once

#include <functional>
#include <string>

#include "tools/server/server.h"

namespace mtdb {

// Prints the URL, with `page` behind it, once it can be asked, and then calls `listening` with what
// it printed; returns when a signal ends it.
Status ServeAndTell(const ServerOptions& options, const std::string& page,
                    const std::function<void(const std::string& url)>& listening);

}  // namespace mtdb
