// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/internal/text_reader.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <limits>

namespace mtdb::internal {
namespace {

constexpr size_t kFirstBufferBytes = size_t{1} << 18;

bool IsSpace(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

template <typename T>
bool ParseRealAs(std::string_view token, T* value) {
  if (!token.empty() && token[0] == '+') {
    token.remove_prefix(1);
    if (!token.empty() && token[0] == '-') return false;
  }
  const char* const last = token.data() + token.size();
  const auto [end, error] = std::from_chars(token.data(), last, *value);
  if (end != last || error == std::errc::invalid_argument) return false;
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
  end_ += *n;
  file_end_ += *n;
  return *n > 0;
}

bool TextReader::NextLine(std::string_view* line) {
  size_t searched = 0;
  for (;;) {
    const char* const from = buffer_.data() + begin_;
    const auto* const newline =
        static_cast<const char*>(std::memchr(from + searched, '\n', end_ - begin_ - searched));
    if (newline != nullptr) {
      *line = std::string_view(from, static_cast<size_t>(newline - from));
      begin_ += line->size() + 1;
      break;
    }
    searched = end_ - begin_;
    if (Fill()) continue;
    if (!status_.ok() || begin_ == end_) return false;
    *line = std::string_view(buffer_.data() + begin_, end_ - begin_);
    begin_ = end_;
    break;
  }
  if (!line->empty() && line->back() == '\r') line->remove_suffix(1);
  if (!line_open_) ++line_;
  line_open_ = false;
  return true;
}

bool TextReader::SkipSpace() {
  for (;;) {
    while (begin_ < end_ && IsSpace(buffer_[begin_])) {
      if (buffer_[begin_] == '\n') {
        if (!line_open_) ++line_;
        line_open_ = false;
      }
      ++begin_;
    }
    if (begin_ < end_) return true;
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
