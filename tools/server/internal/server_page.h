// SPDX-License-Identifier: Apache-2.0
// The viewer's page (tools/viewer), which the server shows at /.
#pragma once

#include <string>

#include "tools/server/internal/server_service.h"

namespace mtdb::internal {

// Whether /`path` is the page's: "", or one of its files. Also true of "" in an mtdb without the
// page, whose answer says why there is none.
bool IsPagePath(const std::string& path);
// The file, compressed by gzip, with the headers that keep other content and scripts out.
ServerAnswer PageAnswer(const std::string& path);

}  // namespace mtdb::internal
