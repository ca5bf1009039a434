// SPDX-License-Identifier: Apache-2.0
// What an object may be called, and a page of its texture.
#pragma once

#include <string>

#include "store/base/status.h"

namespace mtdb {

// 1..500 bytes of UTF-8 without control characters; not "." and "..", which no URL can have.
// Errors: kInvalidArgument.
Status CheckObjectName(const std::string& name);

// A file's name in any folder: 1..255 bytes of UTF-8 without control characters and without / and
// \; not "." and "..". Errors: kInvalidArgument.
Status CheckPageName(const std::string& name);

}  // namespace mtdb
