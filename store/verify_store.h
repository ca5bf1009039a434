// VerifyStore: everything that can be checked without understanding a payload.
#pragma once

#include <string>
#include <vector>

#include "store/base/status.h"

namespace mtdb {

struct CheckReport {
  std::vector<std::string> checks;    // what was checked, a phrase each
  std::vector<std::string> failures;  // what is wrong: object, place, expected, found
  bool ok() const { return failures.empty(); }
};

// Walks every page that the live meta page reaches with a bounds-checked reader (LMDB's own code
// trusts its pages), accounts for every page of the file (live, free, meta), then reads every
// value of `object` (all objects when empty) and checks its checksum, the index, the counts and
// the digest. Uses memory of a few bytes per page. Appends to `report`; the Status is an error only
// when nothing could be examined (no such file, i/o error). Safe beside readers and writers; kBusy
// when it was overtaken by writers again and again, since it cannot use the lock file to pin a
// snapshot.
Status VerifyStore(const std::string& path, const std::string& object, CheckReport* report);

}  // namespace mtdb
