// SPDX-License-Identifier: Apache-2.0
// A progress line: rewritten in place on a terminal, a line per tenth otherwise.
#pragma once

#include <chrono>
#include <string>

namespace mtdb {

// Writes to standard error. Single thread.
class ProgressLine {
 public:
  explicit ProgressLine(bool quiet);
  ~ProgressLine();
  // `fraction` of the whole work, 0..1; `detail` says what is going on.
  void Update(double fraction, const std::string& detail);
  // Ends the line.
  void Finish();

 private:
  bool quiet_;
  bool terminal_;
  bool open_ = false;  // a line without its end is on the terminal
  int last_tenth_ = -1;
  std::chrono::steady_clock::time_point begin_, last_;
};

}  // namespace mtdb
