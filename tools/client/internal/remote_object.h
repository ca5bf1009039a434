// SPDX-License-Identifier: Apache-2.0
// Which object of which server a URL means, and what a server's refusal means.
#pragma once

#include <string>
#include <string_view>

#include "store/base/status.h"
#include "tools/client/http_client.h"

namespace mtdb::internal {

// "/objects/NAME", escaped as it is in the URL; empty when neither `url` nor `name` says.
// kInvalidArgument.
Result<std::string> ObjectPath(const HttpUrl& url, const std::string& name);
// That of the server's only object. kInvalidArgument when it has several.
Result<std::string> OnlyObjectPath(const HttpUrl& url, HttpClient& client);

// An answer that is no success, as an error; `text` is its body.
Status Refused(const std::string& where, unsigned status, const std::string& text);
// Appends to a text that must not become long: a catalog, or an error.
Status AppendText(const std::string& where, std::string_view piece, std::string* text);

}  // namespace mtdb::internal
