// SPDX-License-Identifier: Apache-2.0
#include "store/base/status.h"

#include <cstdio>
#include <cstdlib>

namespace mtdb {

const char* StatusCodeName(StatusCode code) {
  switch (code) {
    case StatusCode::kOk: return "ok";
    case StatusCode::kInvalidArgument: return "invalid argument";
    case StatusCode::kNotFound: return "not found";
    case StatusCode::kAlreadyExists: return "already exists";
    case StatusCode::kUnsupported: return "unsupported";
    case StatusCode::kCancelled: return "cancelled";
    case StatusCode::kBudgetExceeded: return "budget exceeded";
    case StatusCode::kBadInput: return "bad input";
    case StatusCode::kCorrupt: return "corrupt";
    case StatusCode::kIoError: return "i/o error";
    case StatusCode::kNoSpace: return "no space";
    case StatusCode::kBusy: return "busy";
    case StatusCode::kNotYet: return "not yet";
  }
  return "unknown";
}

void CheckFailed(const char* file, int line, const char* condition, const char* message) {
  std::fprintf(stderr, "mtdb: %s:%d: check failed: %s (%s)\n", file, line, condition, message);
  std::abort();
}

}  // namespace mtdb
