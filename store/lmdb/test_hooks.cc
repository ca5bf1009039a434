// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/test_hooks.h"

namespace mtdb::internal {

std::function<void(const char* point)>& TestPointHook() {
  static std::function<void(const char*)> hook;
  return hook;
}

}  // namespace mtdb::internal
