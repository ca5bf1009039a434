// SPDX-License-Identifier: Apache-2.0
// Step, Walk: what a walk through the product does, as text that can be replayed.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "store/base/status.h"

namespace mtdb::everything {

// One act and its parameters. Every parameter has a default, its simplest value, so that any of
// them can be left out: what shrinking does.
struct Step {
  std::string act;
  std::map<std::string, std::string> with;

  bool has(const std::string& key) const { return with.contains(key); }
  std::string Text(const std::string& key, const std::string& otherwise = "") const;
  double Number(const std::string& key, double otherwise) const;
  int64_t Int(const std::string& key, int64_t otherwise) const;
  // Set, and not to 0.
  bool Flag(const std::string& key) const { return Int(key, 0) != 0; }
  void Set(const std::string& key, const std::string& value) { with[key] = value; }
  void Set(const std::string& key, double value);
  void Set(const std::string& key, int64_t value) { with[key] = std::to_string(value); }
  void Set(const std::string& key, int value) { Set(key, static_cast<int64_t>(value)); }
  friend bool operator==(const Step&, const Step&) = default;
};

struct Walk {
  uint64_t seed = 0;  // that it was made from; 0: by hand
  std::vector<Step> steps;
  friend bool operator==(const Walk&, const Walk&) = default;
};

// "act key=value key=value", keys in order; bytes that would break the line as %XX.
std::string StepText(const Step& step);
// A line a step; "# seed N" on the first. Other lines with # in front count for nothing.
std::string WalkText(const Walk& walk);
// Errors: kBadInput, with the line.
Result<Walk> ParseWalk(std::string_view text);

// Several numbers, parted by commas; fewer where the text has no more numbers.
std::vector<double> Numbers(const std::string& text);
// The shortest text that reads as exactly this number.
std::string NumberText(double value);
std::vector<std::string> Split(const std::string& text, char separator);

}  // namespace mtdb::everything
