// SPDX-License-Identifier: Apache-2.0
// MTDB_CHECK: for bugs of a caller, never for bad bytes. Prints where the check failed, and aborts.
#pragma once

namespace mtdb {

[[noreturn]] void CheckFailed(const char* file, int line, const char* condition,
                              const char* message);

}  // namespace mtdb

#define MTDB_CHECK(condition, message)                              \
  do {                                                              \
    if (!(condition)) [[unlikely]]                                  \
      ::mtdb::CheckFailed(__FILE__, __LINE__, #condition, message); \
  } while (false)
