// SPDX-License-Identifier: Apache-2.0
#include "store/carriers/http_answer.h"

#include <algorithm>
#include <cctype>
#include <charconv>

namespace mtdb::internal {
namespace {

bool EqualsIgnoringCase(std::string_view a, std::string_view b) {
  return std::ranges::equal(a, b, [](char x, char y) {
    return std::tolower(static_cast<unsigned char>(x)) ==
           std::tolower(static_cast<unsigned char>(y));
  });
}

std::string_view Trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

std::optional<uint64_t> Number(std::string_view text) {
  uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

struct ContentRange {
  uint64_t first = 0;
  uint64_t last = 0;
  uint64_t total = 0;
};

// "bytes 0-99/1234"
std::optional<ContentRange> ParseContentRange(std::string_view text) {
  if (!EqualsIgnoringCase(text.substr(0, 6), "bytes ")) return std::nullopt;
  text = Trimmed(text.substr(6));
  const size_t dash = text.find('-');
  const size_t slash = text.find('/');
  if (dash == text.npos || slash == text.npos || dash > slash) return std::nullopt;
  const auto first = Number(text.substr(0, dash));
  const auto last = Number(text.substr(dash + 1, slash - dash - 1));
  const auto total = Number(text.substr(slash + 1));
  if (!first || !last || !total || *first > *last || *last >= *total) return std::nullopt;
  return ContentRange{*first, *last, *total};
}

Status Changed(const std::string& name) {
  return Corrupt(name + ": the file changed while it was read; open it again");
}

// What a server sends is shown without what a terminal would take for more than text.
std::string Quoted(std::string_view text) {
  std::string quoted = "'";
  for (const char c : text.substr(0, 60)) quoted += c >= ' ' && c < '\x7f' ? c : '?';
  return quoted + "'";
}

}  // namespace

void HttpAnswer::AddHeader(std::string_view line) {
  if (line.starts_with("HTTP/")) {
    *this = {};
    const size_t space = line.find(' ');
    if (space != line.npos) {
      const auto code = Number(Trimmed(line.substr(space)).substr(0, 3));
      code_ = code ? static_cast<long>(*code) : 0;
    }
    return;
  }
  const size_t colon = line.find(':');
  if (colon == line.npos) return;
  const std::string_view name = line.substr(0, colon);
  const std::string value(Trimmed(line.substr(colon + 1)));
  const auto is = [&](std::string_view other) { return EqualsIgnoringCase(name, other); };
  if (is("etag")) etag_ = value;
  if (is("last-modified")) modified_ = value;
  if (is("content-encoding")) encoding_ = value;
  if (is("content-range")) range_ = value;
  if (is("content-length")) length_ = value;
  if (is("retry-after")) {
    if (const auto seconds = Number(value)) retry_seconds_ = static_cast<double>(*seconds);
  }
}

bool HttpAnswer::AddBody(ByteSpan bytes, uint64_t most) {
  if (code_ != 206) return false;
  too_long_ = body_.size() + bytes.size() > most;
  if (too_long_) return false;
  body_.insert(body_.end(), bytes.begin(), bytes.end());
  return true;
}

bool HttpAnswer::is_transient() const {
  return code_ == 408 || code_ == 425 || code_ == 429 || code_ == 500 || code_ == 502 ||
         code_ == 503 || code_ == 504;
}

Status HttpAnswer::CheckVersion(const FileVersion& version, const std::string& name) const {
  const auto differs = [](const std::string& a, const std::string& b) {
    return !a.empty() && !b.empty() && a != b;
  };
  if (differs(etag_, version.etag)) return Changed(name);
  if (etag_.empty() && differs(modified_, version.modified)) return Changed(name);
  return Status::Ok();
}

Status HttpAnswer::CheckCode(const FileVersion* version, const std::string& name) const {
  const std::string answer = name + ": the server answered " + std::to_string(code_);
  if (code_ == 200) {
    if (version != nullptr) {
      MTDB_RETURN_IF_ERROR(CheckVersion(*version, name));
      if (const auto length = Number(length_); length && *length != version->bytes) {
        return Changed(name);
      }
    }
    return Unsupported(name + ": the server ignores Range and sends the whole file, as " +
                       "python3 -m http.server does; nginx, Apache, Caddy, object stores and " +
                       "`mtdb serve` send ranges (206); or download it, and give the file");
  }
  if (code_ == 416) {
    return version != nullptr ? Changed(name)
                              : Corrupt(answer + " (range not satisfiable): the file is empty");
  }
  if (code_ == 412 && version != nullptr) return Changed(name);
  if (code_ == 404 || code_ == 410) return NotFound(answer + ": no such file");
  if (code_ >= 300 && code_ < 400) {
    return IoError(answer + ", a redirect, which a signed request does not follow; check " +
                   "AWS_REGION and AWS_ENDPOINT_URL");
  }
  if (code_ == 401 || code_ == 403 || code_ == 407) {
    return IoError(answer + ": no access; check the URL, credentials and clock");
  }
  if (code_ >= 300 && code_ < 400) {
    return IoError(answer + ": another place; signed requests are not sent on, check AWS_REGION " +
                   "and AWS_ENDPOINT_URL");
  }
  return IoError(answer + ", expected 206");
}

Status HttpAnswer::Check(ByteRange range, const FileVersion* version, FileVersion* found,
                         const std::string& name) const {
  if (code_ != 206) return CheckCode(version, name);
  if (!encoding_.empty() && !EqualsIgnoringCase(encoding_, "identity")) {
    return Unsupported(name + ": the server sends the file as " + Quoted(encoding_) +
                       "; ranges need the bytes as they are: switch compression off for it");
  }
  const auto content = ParseContentRange(range_);
  if (!content) {
    return IoError(name + ": expected a Content-Range with the size of the file, found " +
                   Quoted(range_));
  }
  if (version != nullptr) {
    MTDB_RETURN_IF_ERROR(CheckVersion(*version, name));
    if (content->total != version->bytes) return Changed(name);
  }
  const uint64_t bytes =
      std::min(range.bytes, content->total - std::min(content->total, range.offset));
  if (content->first != range.offset || content->last + 1 != range.offset + bytes || too_long_) {
    return IoError(name + ": asked for " + std::to_string(bytes) + " bytes at " +
                   std::to_string(range.offset) + ", but the server sent " + Quoted(range_));
  }
  if (body_.size() != bytes) {
    return NotYet(name + ": " + std::to_string(body_.size()) + " of " + std::to_string(bytes) +
                  " bytes at " + std::to_string(range.offset) + " came");
  }
  *found = {content->total, etag_, modified_};
  return Status::Ok();
}

}  // namespace mtdb::internal
