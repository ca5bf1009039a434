// SPDX-License-Identifier: Apache-2.0
// Every check of a packed file that needs no codec.
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "store/check_report.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// As VerifyStore.
Status VerifyPacked(std::shared_ptr<RangeReader> ranges, const std::string& object,
                    CheckReport* report, const std::function<bool()>& stopped = {});

}  // namespace mtdb::internal
