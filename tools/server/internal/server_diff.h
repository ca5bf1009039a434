// SPDX-License-Identifier: Apache-2.0
// What `POST /diff` answers: how far two objects are apart (docs/protocol.md).
#pragma once

#include "query/compare.h"
#include "store/base/json.h"
#include "tools/request/compare_request.h"
#include "tools/server/http/server_request.h"
#include "tools/server/internal/server_ledger.h"

namespace mtdb::internal {

inline bool IsDiff(const RequestTarget& target) {
  return target.path.size() == 1 && target.path[0] == "diff";
}

// The comparison in JSON. It runs on this thread alone, whose time is counted as its client's; it
// holds what `memory` grants, and no places beyond those that an answer has. Errors: those of
// Compare.
Result<Json> CompareForClient(const Surface& a, const Surface& b, const CompareRequest& request,
                              QueryControl* control, ServerLedger::Account* memory);

}  // namespace mtdb::internal
