// SPDX-License-Identifier: Apache-2.0
// Buffered reading of text files: by lines, by tokens, and numbers without a locale.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "codecs/mesh_file/input/file_io.h"
#include "store/base/status.h"

namespace mtdb::internal {

// How many bytes of a byte order mark a text in UTF-8 begins with.
size_t ByteOrderMarkBytes(std::string_view start);
// Whether the file that begins so is a text in UTF-16 or UTF-32.
bool IsWideText(std::string_view start);
Status WideTextError(const std::string& path);

// A forward cursor over text. Lines end in LF, CR LF or CR; a byte order mark in front is no part
// of the first one. What a call yields is valid until the next call. `file` must outlive it.
// Memory: a buffer that grows to the longest line (at most 16 MiB).
class TextReader {
 public:
  enum class LineEnd { kNone, kLf, kCrLf, kCr };

  static constexpr size_t kMaxLineBytes = size_t{1} << 24;

  explicit TextReader(const InputFile& file, uint64_t offset = 0, uint64_t lines_before = 0);

  // The next line without its end. False at the end of the file or on an error (status()).
  bool NextLine(std::string_view* line);
  // The next token between white space, over line ends.
  bool NextToken(std::string_view* token);
  // Steps over white space; true when nothing else is left.
  bool AtEnd();

  uint64_t line() const { return line_; }         // of what was read last, from 1
  LineEnd line_end() const { return line_end_; }  // of the last NextLine()
  uint64_t offset() const { return file_end_ - (end_ - begin_); }
  uint64_t remaining() const;
  const Status& status() const { return status_; }

 private:
  // Reads more behind what is there; false at the end of the file or on an error.
  bool Fill();
  bool SkipSpace();
  // Where the next such byte is in the buffer; end_: nowhere in it. `known`: what was found before.
  size_t Find(char c, size_t* known) const;

  const InputFile& file_;
  std::vector<char> buffer_;
  size_t begin_ = 0;
  size_t end_ = 0;
  uint64_t file_end_;
  uint64_t line_;
  size_t line_feed_ = 0, carriage_return_ = 0;  // see Find()
  bool line_open_ = false;     // the line end after the last token has not been read
  bool after_return_ = false;  // SkipSpace() has read a CR, of which an LF is a part
  LineEnd line_end_ = LineEnd::kNone;
  Status status_;
};

// Cuts a line into its tokens.
class LineTokens {
 public:
  explicit LineTokens(std::string_view line) : rest_(line) {}
  bool Next(std::string_view* token);

 private:
  std::string_view rest_;
};

// The whole token as a number. Accepts a leading '+'. Values too small become 0, values too large
// (and "inf") an infinity; "nan" is read as such, and what Microsoft's library has printed for them
// ("-1.#IND"): the caller decides. False for anything else.
bool ParseReal(std::string_view token, double* value);
bool ParseReal(std::string_view token, float* value);
bool ParseInteger(std::string_view token, int64_t* value);

// Decimal digits without leading zeros and without trailing zeros of the fraction: a token of at
// most kFloatDigits may stand for a float32.
int SignificantDigits(std::string_view token);
inline constexpr int kFloatDigits = 9;

// `text` for a message: in quotes, one line, not long, nothing unprintable.
std::string Quoted(std::string_view text);

}  // namespace mtdb::internal
