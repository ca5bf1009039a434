// SPDX-License-Identifier: Apache-2.0
#include "store/base/status.h"

#include <cstdio>
#include <cstdlib>

namespace mtdb {

void CheckFailed(const char* file, int line, const char* condition, const char* message) {
  std::fprintf(stderr, "mtdb: %s:%d: check failed: %s (%s)\n", file, line, condition, message);
  std::abort();
}

}  // namespace mtdb
