// SPDX-License-Identifier: Apache-2.0
// Watch: what looks on while something takes long.
#pragma once

#include "store/base/status.h"
#include "tools/c/mtdb_write.h"

namespace mtdb::internal {

inline constexpr uint32_t kMostThreads = 1024;

// kUnsupported when the program was compiled for another version.
Status CheckAbi(uint32_t abi_version);

class Watch {
 public:
  // Of a caller's struct, which may be null.
  static Result<Watch> Of(const mtdb_watch* watch);
  // kCancelled when the work is to stop.
  Status Look(const char* stage, double overall) const;

 private:
  explicit Watch(const mtdb_watch& watch) : watch_(watch) {}
  mtdb_watch watch_;
};

}  // namespace mtdb::internal
