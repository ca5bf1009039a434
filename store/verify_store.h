// SPDX-License-Identifier: Apache-2.0
// VerifyStore: everything that can be checked without understanding a payload.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "store/base/status.h"
#include "store/check_report.h"
#include "store/open_options.h"

namespace mtdb {

// Walks every page that the live meta page reaches, with a reader that checks every field (LMDB's
// own code trusts its pages), and makes sure that every page of the file is live, free or meta.
// Then reads every value of `object` (of all objects when the name is empty) and checks its
// checksum, the files of textures, the index, the counts and the digest. Takes a few bytes of
// memory per page. Appends to `report`. Of a packed file, also by its URL, it reads every byte
// instead. The Status is an error only when nothing could be examined (no such file, i/o error).
// Safe beside readers and writers. Where it may not write the lock file it cannot pin a snapshot,
// and returns kBusy when writers overtake it again and again. `stopped`, when there is one, is
// asked before every page and value is read, of a packed file before some of its units: when it
// answers true, kCancelled, and the report is as it was. Of `options` the cache of a URL counts.
Status VerifyStore(const std::string& path, const std::string& object, CheckReport* report,
                   const std::function<bool()>& stopped = {}, const OpenOptions& options = {});

}  // namespace mtdb
