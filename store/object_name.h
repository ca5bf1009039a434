// SPDX-License-Identifier: Apache-2.0
// What an object may be called.
#pragma once

#include <string>

#include "store/base/status.h"

namespace mtdb {

// 1..500 bytes of UTF-8 without control characters; not "." and "..", which no URL can have.
// Errors: kInvalidArgument.
Status CheckObjectName(const std::string& name);

}  // namespace mtdb
