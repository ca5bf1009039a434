// SPDX-License-Identifier: Apache-2.0
// JSON values. nlohmann's, except that they go away without asking for memory.
//
// nlohmann's destructor lists all that is within a value, so that deep values take no deep
// recursion, and ends the process when there is no memory for the list. Here the list of those who
// find no memory lies in memory that is kept for it. Include this, not <nlohmann/json.hpp>.
// One thing is still to be avoided where memory may be short: null that becomes an object by [] or
// a list by push_back. Begin with Json::object() or Json::array().
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace mtdb {

// For all that lies within a value: what std::allocator does, with another name.
template <typename T>
struct JsonAllocator {
  using value_type = T;
  JsonAllocator() = default;
  template <typename U>
  JsonAllocator(const JsonAllocator<U>&) {}  // NOLINT: implicit, as of every allocator
  T* allocate(size_t count) { return static_cast<T*>(::operator new(count * sizeof(T))); }
  void deallocate(T* at, size_t) { ::operator delete(at); }
  friend bool operator==(const JsonAllocator&, const JsonAllocator&) { return true; }
};

template <template <typename, typename, typename...> class Object>
using BasicJson = nlohmann::basic_json<Object, std::vector, std::string, bool, int64_t, uint64_t,
                                       double, JsonAllocator>;

// Memory for the list of a destructor; waits while another thread's list lies in the memory that is
// kept. Never null: a list of more than a MiB ends the process after all.
void* AllocateDestructorList(size_t bytes) noexcept;
void FreeDestructorList(void* at) noexcept;

}  // namespace mtdb

// The list is nlohmann's only std::vector of values with the standard allocator. Others must not be
// made: a list of values is a Json::array_t.
template <template <typename, typename, typename...> class Object>
struct std::allocator<mtdb::BasicJson<Object>> {
  using value_type = mtdb::BasicJson<Object>;
  using is_always_equal = std::true_type;
  allocator() = default;
  template <typename U>
  allocator(const allocator<U>&) {}  // NOLINT: implicit, as of every allocator
  value_type* allocate(size_t count) {
    return static_cast<value_type*>(mtdb::AllocateDestructorList(count * sizeof(value_type)));
  }
  void deallocate(value_type* at, size_t) { mtdb::FreeDestructorList(at); }
  friend bool operator==(const allocator&, const allocator&) { return true; }
};

#include <nlohmann/json.hpp>

namespace mtdb {

using Json = BasicJson<nlohmann::ordered_map>;  // its keys keep their order
using JsonTree = BasicJson<std::map>;           // finds a key among many: for texts of others

// The object that a text of somebody else is; discarded when it is none, or nested too deep.
// (nlohmann's callbacks could watch the depth, but take quadratic time.)
JsonTree ParseJsonObject(std::string_view text);
// 1 to 32 small letters, such as the name of a limit.
bool IsWord(std::string_view text);

}  // namespace mtdb
