// MTDB_CHECK: a caller's bug, never bad bytes. Says where and aborts.
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
