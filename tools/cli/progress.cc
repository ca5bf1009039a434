// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/progress.h"

#include <cstdio>
#include <unistd.h>

namespace mtdb {

using std::chrono::steady_clock;

ProgressLine::ProgressLine(bool quiet)
    : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0), begin_(steady_clock::now()) {}

ProgressLine::~ProgressLine() { Finish(); }

void ProgressLine::Update(double fraction, const std::string& detail) {
  if (quiet_) return;
  const steady_clock::time_point now = steady_clock::now();
  const double elapsed = std::chrono::duration<double>(now - begin_).count();
  const double left = fraction > 0.01 ? elapsed * (1 - fraction) / fraction : 0;
  if (terminal_) {
    if (open_ && now - last_ < std::chrono::milliseconds(100)) return;
    std::fprintf(stderr, "\r\033[K%3.0f %%  %s  %.0f s", 100 * fraction, detail.c_str(), elapsed);
    if (left >= 1) std::fprintf(stderr, ", %.0f s left", left);
    std::fflush(stderr);
    open_ = true;
    last_ = now;
    return;
  }
  const int tenth = static_cast<int>(fraction * 10);
  if (tenth == last_tenth_) return;
  last_tenth_ = tenth;
  std::fprintf(stderr, "%3.0f %%  %s  %.1f s\n", 100 * fraction, detail.c_str(), elapsed);
}

void ProgressLine::Finish() {
  if (open_) std::fprintf(stderr, "\r\033[K");
  open_ = false;
}

}  // namespace mtdb
