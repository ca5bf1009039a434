// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/input/text_reader.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <limits>

namespace mtdb::internal {
namespace {

constexpr size_t kFirstBufferBytes = size_t{1} << 18;

bool IsSpace(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

// "1.#IND", "1.#QNAN", "1.#INF00".
template <typename T>
bool ParseNoNumber(std::string_view token, T* value) {
  const bool negative = token.starts_with('-');
  if (negative) token.remove_prefix(1);
  if (!token.starts_with("1.#")) return false;
  token.remove_prefix(3);
  token = token.substr(0, token.find_last_not_of('0') + 1);
  if (token == "INF") {
    *value = negative ? -std::numeric_limits<T>::infinity() : std::numeric_limits<T>::infinity();
    return true;
  }
  *value = std::numeric_limits<T>::quiet_NaN();
  return token == "IND" || token == "QNAN" || token == "SNAN";
}

template <typename T>
bool ParseRealAs(std::string_view token, T* value) {
  if (!token.empty() && token[0] == '+') {
    token.remove_prefix(1);
    if (!token.empty() && token[0] == '-') return false;
  }
  const char* const last = token.data() + token.size();
  const auto [end, error] = std::from_chars(token.data(), last, *value);
  if (end != last || error == std::errc::invalid_argument) return ParseNoNumber(token, value);
  if (error == std::errc::result_out_of_range) {
    // from_chars does not say which way. A float may still be a subnormal double or 0.
    const bool negative = token[0] == '-';
    const std::string_view digits = token.substr(negative ? 1 : 0);
    const size_t exponent = digits.find_first_of("eE");
    const bool small = exponent != std::string_view::npos
                           ? exponent + 1 < digits.size() && digits[exponent + 1] == '-'
                           : digits[0] == '0' || digits[0] == '.';
    const T magnitude = small ? T{0} : std::numeric_limits<T>::infinity();
    *value = negative ? -magnitude : magnitude;
  }
  return true;
}

}  // namespace

size_t ByteOrderMarkBytes(std::string_view start) {
  return start.starts_with("\xef\xbb\xbf") ? 3 : 0;
}

bool IsWideText(std::string_view start) {
  using namespace std::string_view_literals;
  if (start.starts_with("\xff\xfe"sv) || start.starts_with("\xfe\xff"sv)) return true;
  // Without a mark: every other byte of the first characters is 0.
  if (start.size() < 8) return false;
  bool even = true, odd = true;
  for (size_t i = 0; i < 8; ++i) (i % 2 == 0 ? even : odd) &= start[i] == '\0';
  return even != odd;
}

Status WideTextError(const std::string& path) {
  return BadInput(path +
                  ": text in UTF-16 or UTF-32, expected ASCII or UTF-8; convert it first, e.g. by "
                  "iconv -f UTF-16 -t UTF-8");
}

TextReader::TextReader(const InputFile& file, uint64_t offset, uint64_t lines_before)
    : file_(file), buffer_(kFirstBufferBytes), file_end_(offset), line_(lines_before) {}

uint64_t TextReader::remaining() const {
  return file_.size_bytes() > offset() ? file_.size_bytes() - offset() : 0;
}

bool TextReader::Fill() {
  if (!status_.ok()) return false;
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    line_feed_ -= std::min(line_feed_, begin_);
    carriage_return_ -= std::min(carriage_return_, begin_);
    begin_ = 0;
  }
  if (end_ == buffer_.size()) {
    if (buffer_.size() >= kMaxLineBytes) {
      status_ = BadInput(file_.path() + ": line " + std::to_string(line_ + 1) +
                         ": longer than 16 MiB, expected a text file");
      return false;
    }
    buffer_.resize(buffer_.size() * 2);
  }
  Result<size_t> n =
      file_.ReadAt(file_end_, std::as_writable_bytes(std::span(buffer_).subspan(end_)));
  if (!n.ok()) {
    status_ = n.status();
    return false;
  }
  const bool is_start = file_end_ == 0;
  end_ += *n;
  file_end_ += *n;
  if (is_start) begin_ = ByteOrderMarkBytes({buffer_.data(), end_});
  return *n > 0;
}

size_t TextReader::Find(char c, size_t* known) const {
  const size_t from = std::max(*known, begin_);
  if (from < end_ && buffer_[from] == c) return *known = from;
  const void* const found =
      from < end_ ? std::memchr(buffer_.data() + from, c, end_ - from) : nullptr;
  *known = found == nullptr ? end_
                            : static_cast<size_t>(static_cast<const char*>(found) - buffer_.data());
  return *known;
}

bool TextReader::NextLine(std::string_view* line) {
  if (after_return_ && (begin_ < end_ || Fill()) && buffer_[begin_] == '\n') ++begin_;
  after_return_ = false;
  for (;;) {
    const size_t line_feed = Find('\n', &line_feed_);
    size_t end = std::min(line_feed, Find('\r', &carriage_return_));
    // Whether an LF belongs to a CR at the very end, only the next bytes say.
    if ((end == end_ || (end + 1 == end_ && buffer_[end] == '\r')) && Fill()) continue;
    if (!status_.ok()) return false;
    if (begin_ == end_) return false;
    end = std::min({end_, line_feed_, carriage_return_});
    *line = std::string_view(buffer_.data() + begin_, end - begin_);
    line_end_ = end == end_                                  ? LineEnd::kNone
                : buffer_[end] == '\n'                       ? LineEnd::kLf
                : end + 1 == line_feed_ && line_feed_ < end_ ? LineEnd::kCrLf
                                                             : LineEnd::kCr;
    begin_ = end == end_ ? end_ : end + (line_end_ == LineEnd::kCrLf ? 2 : 1);
    break;
  }
  if (!line_open_) ++line_;
  line_open_ = false;
  return true;
}

bool TextReader::SkipSpace() {
  for (;;) {
    while (begin_ < end_ && IsSpace(buffer_[begin_])) {
      const char c = buffer_[begin_++];
      if (c == '\r' || (c == '\n' && !after_return_)) {
        if (!line_open_) ++line_;
        line_open_ = false;
      }
      after_return_ = c == '\r';
    }
    if (begin_ < end_) {
      after_return_ = false;
      return true;
    }
    if (!Fill()) return false;
  }
}

bool TextReader::AtEnd() { return !SkipSpace() && status_.ok(); }

bool TextReader::NextToken(std::string_view* token) {
  if (!SkipSpace()) return false;
  size_t size = 1;
  for (;;) {
    while (begin_ + size < end_ && !IsSpace(buffer_[begin_ + size])) ++size;
    if (begin_ + size < end_) break;
    if (!Fill()) {
      if (!status_.ok()) return false;
      break;
    }
  }
  *token = std::string_view(buffer_.data() + begin_, size);
  begin_ += size;
  if (!line_open_) ++line_;
  line_open_ = true;
  return true;
}

bool LineTokens::Next(std::string_view* token) {
  size_t from = 0;
  while (from < rest_.size() && IsSpace(rest_[from])) ++from;
  size_t to = from;
  while (to < rest_.size() && !IsSpace(rest_[to])) ++to;
  *token = rest_.substr(from, to - from);
  rest_.remove_prefix(to);
  return to > from;
}

bool ParseReal(std::string_view token, double* value) { return ParseRealAs(token, value); }
bool ParseReal(std::string_view token, float* value) { return ParseRealAs(token, value); }

bool ParseInteger(std::string_view token, int64_t* value) {
  if (!token.empty() && token[0] == '+') {
    token.remove_prefix(1);
    if (!token.empty() && token[0] == '-') return false;
  }
  const char* const last = token.data() + token.size();
  const auto [end, error] = std::from_chars(token.data(), last, *value);
  return end == last && error == std::errc();
}

int SignificantDigits(std::string_view token) {
  int digits = 0;
  int trailing_zeros = 0;
  bool fraction = false;
  for (const char c : token) {
    if (c == '.') {
      fraction = true;
      trailing_zeros = 0;
    } else if (c >= '0' && c <= '9') {
      if (digits == 0 && c == '0') continue;
      ++digits;
      trailing_zeros = c == '0' ? trailing_zeros + 1 : 0;
    } else if (c == 'e' || c == 'E') {
      break;
    }
  }
  return fraction ? digits - trailing_zeros : digits;
}

std::string Quoted(std::string_view text) {
  constexpr size_t kMaxShown = 40;
  std::string out = "'";
  for (const char c : text.substr(0, kMaxShown)) out += c >= ' ' && c <= '~' ? c : '?';
  out += text.size() > kMaxShown ? "...'" : "'";
  return out;
}

}  // namespace mtdb::internal
