// SPDX-License-Identifier: Apache-2.0
// HttpAnswer: what came for one range over HTTP, and what that means.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// What tells one state of a file from another.
struct FileVersion {
  uint64_t bytes = 0;
  std::string etag;      // as the server writes it; may be empty
  std::string modified;  // likewise
};

class HttpAnswer {
 public:
  // A line of a head; a status line begins a new one, as after a redirect.
  void AddHeader(std::string_view line);
  // False when there is no use in the rest of the body.
  bool AddBody(ByteSpan bytes, uint64_t most);

  long code() const { return code_; }
  // Worth another try.
  bool is_transient() const;
  std::optional<double> retry_seconds() const { return retry_seconds_; }
  Bytes TakeBody() { return std::move(body_); }

  // Whether the body is `range` of `version`. kNotYet: it was cut short, which may be better the
  // next time. `version` null: of any, as far as it goes; `found` is what it is then.
  Status Check(ByteRange range, const FileVersion* version, FileVersion* found,
               const std::string& name) const;

 private:
  Status CheckCode(const FileVersion* version, const std::string& name) const;
  Status CheckVersion(const FileVersion& version, const std::string& name) const;

  long code_ = 0;
  std::string etag_, modified_, encoding_, range_, length_;
  std::optional<double> retry_seconds_;
  Bytes body_;
  bool too_long_ = false;
};

}  // namespace mtdb::internal
