#include "tools/internal/arguments.h"

#include <charconv>
#include <cmath>
#include <filesystem>

namespace mtdb {

namespace {

// Parses all of `text`.
template <typename T>
bool ParseWhole(std::string_view text, T* value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *value);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

}  // namespace

Result<std::vector<double>> ParseNumbers(const std::string& text, size_t count,
                                         const std::string& option) {
  std::vector<double> numbers;
  size_t begin = 0;
  while (begin <= text.size()) {
    const size_t end = std::min(text.find(',', begin), text.size());
    double value = 0;
    if (!ParseWhole(std::string_view(text).substr(begin, end - begin), &value) ||
        !std::isfinite(value)) {
      return InvalidArgument(option + " " + text + ": expected " + std::to_string(count) +
                             " numbers separated by commas");
    }
    numbers.push_back(value);
    begin = end + 1;
  }
  if (numbers.size() != count) {
    return InvalidArgument(option + " " + text + ": expected " + std::to_string(count) +
                           " numbers separated by commas, found " +
                           std::to_string(numbers.size()));
  }
  return numbers;
}

Result<uint64_t> ParseSize(const std::string& text, const std::string& option) {
  std::string_view digits = text;
  int shift = 0;
  if (!digits.empty()) {
    const std::string_view kSuffixes = "KMGT";
    const auto at = kSuffixes.find(static_cast<char>(std::toupper(digits.back())));
    if (at != std::string_view::npos) {
      shift = 10 * (static_cast<int>(at) + 1);
      digits.remove_suffix(1);
    }
  }
  uint64_t value = 0;
  if (!ParseWhole(digits, &value) || value == 0 || value > (~uint64_t{0} >> shift)) {
    return InvalidArgument(option + " " + text + ": expected a size such as 512M or 4G");
  }
  return value << shift;
}

Result<std::pair<int, int>> ParseExtent(const std::string& text, const std::string& option) {
  const size_t x = text.find('x');
  int width = 0;
  int height = 0;
  if (x == std::string::npos || !ParseWhole(std::string_view(text).substr(0, x), &width) ||
      !ParseWhole(std::string_view(text).substr(x + 1), &height) || width < 1 || height < 1) {
    return InvalidArgument(option + " " + text + ": expected pixels as WIDTHxHEIGHT");
  }
  return std::pair(width, height);
}

std::string Stem(const std::string& path) { return std::filesystem::path(path).stem().string(); }

}  // namespace mtdb
