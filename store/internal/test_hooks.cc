#include "store/internal/test_hooks.h"

namespace mtdb {

std::function<void(const char* point)>& TestPointHook() {
  static std::function<void(const char*)> hook;
  return hook;
}

}  // namespace mtdb
