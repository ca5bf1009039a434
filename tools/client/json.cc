// SPDX-License-Identifier: Apache-2.0
#include "tools/client/json.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <new>

#include "store/base/json_depth.h"

namespace mtdb {

namespace {

constexpr size_t kAlignment = alignof(std::max_align_t);

// One thread's lists at a time: the mutex is held as long as there is one.
struct Reserve {
  std::recursive_mutex mutex;
  size_t lists = 0;
  size_t used = 0;  // of kept
};
constinit Reserve reserve;
alignas(kAlignment) constinit std::byte kept[1 << 20] = {};

constexpr int kDeepest = 70;  // braces and brackets within each other; a query has less

}  // namespace

void* AllocateDestructorList(size_t bytes) noexcept {
  if (void* const at = ::operator new(bytes, std::nothrow)) return at;
  reserve.mutex.lock();
  const size_t needed = (bytes + kAlignment - 1) / kAlignment * kAlignment;
  if (needed > sizeof(kept) - reserve.used) {
    std::fputs("mtdb: out of memory for the end of a JSON value\n", stderr);
    std::abort();
  }
  void* const at = kept + reserve.used;
  reserve.used += needed;
  ++reserve.lists;
  return at;
}

void FreeDestructorList(void* at) noexcept {
  const auto* const byte = static_cast<std::byte*>(at);
  if (byte < std::begin(kept) || byte >= std::end(kept)) {
    ::operator delete(at);
    return;
  }
  if (--reserve.lists == 0) reserve.used = 0;
  reserve.mutex.unlock();
}

JsonTree ParseJsonObject(std::string_view text) {
  const JsonTree none(JsonTree::value_t::discarded);
  if (TooDeepAt(text, kDeepest) != std::string_view::npos) return none;
  JsonTree json = JsonTree::parse(text, nullptr, false);
  return json.is_object() ? json : none;
}

bool IsWord(std::string_view text) {
  return !text.empty() && text.size() <= 32 &&
         std::ranges::all_of(text, [](char c) { return c >= 'a' && c <= 'z'; });
}

}  // namespace mtdb
