// SPDX-License-Identifier: Apache-2.0
// Status and Result<T>: what every call of mtdb that can fail returns. Errors are values, also when
// memory runs out (store/base/out_of_memory.h); functions that return a Status or a Result never
// throw, and libraries never print or exit. A message is one line that names the object and the
// place, and says what was expected, what was found, and what to do.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "store/base/check.h"

namespace mtdb {

// Pinned numbers by family: 1xx the caller, 2xx bytes, 3xx the system.
enum class StatusCode : uint16_t {
  kOk = 0,
  kInvalidArgument = 100,  // an option or request that cannot be served
  kNotFound = 101,         // no such object, file or cluster
  kAlreadyExists = 102,    // an object of that name is there
  kUnsupported = 103,      // a valid file of a kind or version that mtdb does not read
  kCancelled = 104,        // the caller asked to stop
  kBudgetExceeded = 105,   // the answer does not fit the budget that the caller set
  kBadInput = 200,         // a mesh file that breaks its own format
  kCorrupt = 201,          // a store whose bytes fail a check
  kIoError = 300,          // the operating system refused a read or write
  kNoSpace = 301,          // disk, map or memory is full
  kBusy = 302,             // another process holds what is needed
  kNotYet = 303,           // what is needed is on its way: ask again
};

class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(StatusCode code, std::string message) : code_(code), message_(std::move(message)) {}

  static Status Ok() { return {}; }

  bool ok() const { return code_ == StatusCode::kOk; }
  StatusCode code() const { return code_; }
  const std::string& message() const { return message_; }

 private:
  StatusCode code_ = StatusCode::kOk;
  std::string message_;
};

inline Status InvalidArgument(std::string m) {
  return {StatusCode::kInvalidArgument, std::move(m)};
}
inline Status NotFound(std::string m) { return {StatusCode::kNotFound, std::move(m)}; }
inline Status BadInput(std::string m) { return {StatusCode::kBadInput, std::move(m)}; }
inline Status Corrupt(std::string m) { return {StatusCode::kCorrupt, std::move(m)}; }
inline Status IoError(std::string m) { return {StatusCode::kIoError, std::move(m)}; }
inline Status NotYet(std::string m) { return {StatusCode::kNotYet, std::move(m)}; }
inline Status Unsupported(std::string m) { return {StatusCode::kUnsupported, std::move(m)}; }

// A value or an error; member names as in std::expected.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}         // NOLINT(google-explicit-constructor)
  Result(Status status) : status_(std::move(status)) {  // NOLINT(google-explicit-constructor)
    MTDB_CHECK(!status_.ok(), "a Result without a value needs an error");
  }

  bool has_value() const { return value_.has_value(); }
  explicit operator bool() const { return has_value(); }
  bool ok() const { return has_value(); }
  const Status& status() const { return status_; }
  const Status& error() const { return status_; }

  T& value() & {
    MTDB_CHECK(has_value(), status_.message().c_str());
    return *value_;
  }
  const T& value() const& {
    MTDB_CHECK(has_value(), status_.message().c_str());
    return *value_;
  }
  T&& value() && {
    MTDB_CHECK(has_value(), status_.message().c_str());
    return *std::move(value_);
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

 private:
  std::optional<T> value_;
  Status status_;
};

}  // namespace mtdb

// Returns from the enclosing function when `expr` (a Status) is an error.
#define MTDB_RETURN_IF_ERROR(expr)                                                  \
  do {                                                                              \
    if (::mtdb::Status mtdb_status = (expr); !mtdb_status.ok()) return mtdb_status; \
  } while (false)

#define MTDB_CONCAT_INNER(a, b) a##b
#define MTDB_CONCAT(a, b) MTDB_CONCAT_INNER(a, b)

// `MTDB_ASSIGN_OR_RETURN(auto x, F())`: x = the value of F(), or returns F()'s error.
#define MTDB_ASSIGN_OR_RETURN(lhs, expr)                 \
  auto MTDB_CONCAT(mtdb_result_, __LINE__) = (expr);     \
  if (!MTDB_CONCAT(mtdb_result_, __LINE__).ok())         \
    return MTDB_CONCAT(mtdb_result_, __LINE__).status(); \
  lhs = std::move(MTDB_CONCAT(mtdb_result_, __LINE__)).value()
