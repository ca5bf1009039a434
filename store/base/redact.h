// SPDX-License-Identifier: Apache-2.0
// Passwords and signatures of URLs do not go where text goes: messages, answers, logs, notes.
#pragma once

#include <string>
#include <string_view>

namespace mtdb {

// The text with its URLs as far as anybody may see them: without "user:password@", and without
// what follows '?', where object stores have signatures and tokens ("X-Amz-Signature", "sig",
// "token", ...). The values of such parameters are taken away too behind a '#', or where the URL is
// not whole, and key ids of AWS wherever they are. Text without any of that stays as it is.
std::string WithoutSecrets(std::string_view text);

}  // namespace mtdb
