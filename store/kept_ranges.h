// SPDX-License-Identifier: Apache-2.0
// What is read of files by URL may be kept on disk.
#pragma once

#include <cstdint>
#include <string>

#include "store/base/status.h"

namespace mtdb {

// For all databases that this process opens from now on by URL: what comes of the file is kept in
// `folder`, which is made, within `limit_bytes` as the disk counts them and 16 MiB more for each
// process that has the folder. It need not come again, whoever reads the same content, from
// whichever URL. Damaged entries come again. The first 64 KiB always come: they tell what the file
// is. Empty: no more. Errors: kIoError, kNoSpace (the folder). Safe for many threads.
Status KeepRangesIn(const std::string& folder, uint64_t limit_bytes = uint64_t{4} << 30);

}  // namespace mtdb
