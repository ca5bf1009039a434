// SPDX-License-Identifier: Apache-2.0
#include "tests/memory/allocation_peak.h"

#include <algorithm>
#include <cstdlib>
#include <malloc.h>
#include <new>

namespace mtdb::testing {
namespace {

thread_local size_t t_held = 0;
thread_local size_t t_peak = 0;

void* TakeIfThere(void* memory) {
  if (memory == nullptr) return nullptr;
  t_held += ::malloc_usable_size(memory);
  t_peak = std::max(t_peak, t_held);
  return memory;
}

void* Take(void* memory) {
  if (memory == nullptr) throw std::bad_alloc();
  return TakeIfThere(memory);
}

void GiveBack(void* memory) {
  if (memory == nullptr) return;
  // What another thread took is not counted here.
  t_held -= std::min(t_held, ::malloc_usable_size(memory));
  std::free(memory);
}

size_t RoundedUp(size_t size, std::align_val_t alignment) {
  const auto a = static_cast<size_t>(alignment);
  return (size + a - 1) / a * a;
}

}  // namespace

AllocationPeak::AllocationPeak() : before_(t_held) { t_peak = t_held; }
size_t AllocationPeak::bytes() const { return t_peak - std::min(t_peak, before_); }

}  // namespace mtdb::testing

using mtdb::testing::GiveBack;
using mtdb::testing::RoundedUp;
using mtdb::testing::Take;
using mtdb::testing::TakeIfThere;

// Of its own, since what replaces only the others is not what a sanitizer calls here.
void* operator new(size_t size, const std::nothrow_t&) noexcept {
  return TakeIfThere(std::malloc(std::max<size_t>(size, 1)));
}
void* operator new[](size_t size, const std::nothrow_t&) noexcept {
  return TakeIfThere(std::malloc(std::max<size_t>(size, 1)));
}
void* operator new(size_t size) { return Take(std::malloc(std::max<size_t>(size, 1))); }
void* operator new[](size_t size) { return Take(std::malloc(std::max<size_t>(size, 1))); }
void* operator new(size_t size, std::align_val_t a) {
  return Take(std::aligned_alloc(static_cast<size_t>(a), RoundedUp(size, a)));
}
void* operator new[](size_t size, std::align_val_t a) {
  return Take(std::aligned_alloc(static_cast<size_t>(a), RoundedUp(size, a)));
}
void operator delete(void* memory) noexcept { GiveBack(memory); }
void operator delete[](void* memory) noexcept { GiveBack(memory); }
void operator delete(void* memory, size_t) noexcept { GiveBack(memory); }
void operator delete[](void* memory, size_t) noexcept { GiveBack(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { GiveBack(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept { GiveBack(memory); }
void operator delete(void* memory, size_t, std::align_val_t) noexcept { GiveBack(memory); }
void operator delete[](void* memory, size_t, std::align_val_t) noexcept { GiveBack(memory); }
