// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/did_you_mean.h"

#include <algorithm>
#include <vector>

namespace mtdb {
namespace {

// How many letters must be added, dropped, replaced or swapped with their neighbours.
size_t Edits(const std::string& a, const std::string& b) {
  std::vector<std::vector<size_t>> d(a.size() + 1, std::vector<size_t>(b.size() + 1));
  for (size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
  for (size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    for (size_t j = 1; j <= b.size(); ++j) {
      d[i][j] = std::min(
          {d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0u : 1u)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
      }
    }
  }
  return d[a.size()][b.size()];
}

}  // namespace

std::string DidYouMean(const std::string& word, std::span<const std::string> known) {
  constexpr size_t kLongest = 64;
  const std::string* best = nullptr;
  // Two slips, one in a short word: more would be a guess.
  size_t fewest = (word.size() > 5 ? 2 : 1) + 1;
  if (word.size() > kLongest) return "";
  for (const std::string& k : known) {
    size_t edits = Edits(word, k);
    // What was begun and not finished.
    if (word.size() >= 4 && k.starts_with(word)) edits = std::min<size_t>(edits, 1);
    if (edits < fewest) {
      fewest = edits;
      best = &k;
    }
  }
  return best == nullptr ? "" : "; did you mean '" + *best + "'?";
}

}  // namespace mtdb
