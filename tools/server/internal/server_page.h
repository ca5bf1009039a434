// SPDX-License-Identifier: Apache-2.0
// The viewer's page (tools/viewer), which the server shows at /.
#pragma once

#include <string>
#include <vector>

#include "tools/server/internal/server_service.h"

namespace mtdb::internal {

// Whether /`path` is the page's: "", one of its files, or one of `files` beside them. Also true of
// "" in an mtdb without the page, whose answer says why there is none.
bool IsPagePath(const std::string& path, const std::vector<ServedFile>& files);
// The file, with the headers that keep other content and scripts out; the page's are compressed by
// gzip.
ServerAnswer PageAnswer(const std::string& path, const std::vector<ServedFile>& files);

}  // namespace mtdb::internal
