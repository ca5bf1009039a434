// SPDX-License-Identifier: Apache-2.0
// An HTTP connection of a server.
#pragma once

#include "tools/client/network.h"
#include "tools/server/http/server_loop.h"

namespace mtdb::internal {

// Reads requests from `socket` and answers them, until either side closes it. `refused`: says to
// the first one that there are too many.
void ServeConnection(ServerLoop& loop, Tcp::socket socket, ServerClient client, bool refused);

}  // namespace mtdb::internal
