// SPDX-License-Identifier: Apache-2.0
// OutOfMemory: where a lack of memory becomes a Status.
//
// One rule: a public function that returns a Status or a Result returns kNoSpace, "out of memory",
// when memory runs out; no exception leaves it, nor a thread of mtdb's own. What it was to change
// is as before, or as after any other error. Functions that return neither (constructors, regions,
// thresholds) throw std::bad_alloc. Inside, memory is asked for as if there were enough, and
// destructors clean up.
#pragma once

#include <cstdlib>
#include <new>

#include "store/base/status.h"

namespace mtdb {

// So short that the message needs no memory.
inline Status OutOfMemory() { return {StatusCode::kNoSpace, "out of memory"}; }

#ifdef __cpp_exceptions

// Calls f(), which returns a Status or a Result.
template <typename F>
auto CatchOutOfMemory(F&& f) -> decltype(f()) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    return OutOfMemory();
  }
}

// Calls f(); false when memory ran out.
template <typename F>
bool TryAllocate(F&& f) {
  try {
    f();
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  }
}

[[noreturn]] inline void ThrowOutOfMemory() { throw std::bad_alloc(); }

#else  // A program without exceptions ends where memory does.

template <typename F>
auto CatchOutOfMemory(F&& f) -> decltype(f()) {
  return f();
}

template <typename F>
bool TryAllocate(F&& f) {
  f();
  return true;
}

[[noreturn]] inline void ThrowOutOfMemory() { std::abort(); }

#endif

}  // namespace mtdb
