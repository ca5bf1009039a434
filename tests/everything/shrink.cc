// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/shrink.h"

#include <algorithm>

namespace mtdb::everything {

namespace {

class Shrinker {
 public:
  Shrinker(Walk walk, const StillFails& fails, int attempts)
      : walk_(std::move(walk)), fails_(fails), left_(attempts) {}

  Walk Run() {
    bool better = true;
    while (better && left_ > 0) {
      better = DropSteps();
      better |= DropParameters();
      better |= HalveNumbers();
    }
    return walk_;
  }

 private:
  bool Try(Walk candidate) {
    if (left_ <= 0 || candidate == walk_ || candidate.steps.empty()) return false;
    --left_;
    if (!fails_(candidate)) return false;
    walk_ = std::move(candidate);
    return true;
  }

  // The later steps first: most faults end a walk.
  bool DropSteps() {
    bool better = false;
    for (size_t run = walk_.steps.size(); run > 0; run /= 2) {
      size_t end = walk_.steps.size();
      while (end > 0) {
        const size_t begin = end > run ? end - run : 0;
        Walk candidate = walk_;
        candidate.steps.erase(candidate.steps.begin() + static_cast<std::ptrdiff_t>(begin),
                              candidate.steps.begin() + static_cast<std::ptrdiff_t>(end));
        better |= Try(std::move(candidate));
        end = begin;
      }
    }
    return better;
  }

  bool DropParameters() {
    bool better = false;
    for (size_t i = 0; i < walk_.steps.size(); ++i) {
      std::vector<std::string> keys;
      for (const auto& [key, value] : walk_.steps[i].with) keys.push_back(key);
      for (const std::string& key : keys) {
        Walk candidate = walk_;
        candidate.steps[i].with.erase(key);
        better |= Try(std::move(candidate));
      }
      // The items of lists.
      for (const std::string& key : keys) {
        const std::vector<std::string> items = Split(walk_.steps[i].Text(key), ',');
        if (items.size() < 2 || !Numbers(items[0]).empty()) continue;
        for (const std::string& item : items) {
          std::vector<std::string> fewer = Split(walk_.steps[i].Text(key), ',');
          if (fewer.size() < 2) break;
          std::erase(fewer, item);
          std::string text;
          for (const std::string& f : fewer) text += (text.empty() ? "" : ",") + f;
          Walk candidate = walk_;
          candidate.steps[i].Set(key, text);
          better |= Try(std::move(candidate));
        }
      }
    }
    return better;
  }

  // All inputs that are as large at once: what is resumed is often what was interrupted.
  bool HalveNumbers() {
    bool better = false;
    for (const char* key : {"size", "files", "wide"}) {
      for (size_t i = 0; i < walk_.steps.size(); ++i) {
        while (walk_.steps[i].has(key)) {
          const int64_t value = walk_.steps[i].Int(key, 0);
          if (value <= 1) break;
          Walk candidate = walk_;
          for (Step& step : candidate.steps) {
            if (step.has(key) && step.Int(key, 0) == value) step.Set(key, value / 2);
          }
          if (!Try(std::move(candidate))) break;
          better = true;
        }
      }
    }
    return better;
  }

  Walk walk_;
  const StillFails& fails_;
  int left_;
};

}  // namespace

Walk Shrink(const Walk& walk, const StillFails& fails, int attempts) {
  return Shrinker(walk, fails, attempts).Run();
}

}  // namespace mtdb::everything
