// SPDX-License-Identifier: Apache-2.0
#include "tools/request/arguments.h"

#include <algorithm>
#include <arpa/inet.h>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <limits>
#include <optional>
#include <string_view>
#include <vector>

#include "store/base/coordinate_limit.h"

namespace mtdb {

namespace {

constexpr int kLargestExtent = 16384;
constexpr double kLargestSeconds = 1e9;
constexpr uint64_t kLeastMemory = uint64_t{256} << 20;  // of BuildOptions

// Parses all of `text`.
template <typename T>
bool ParseWhole(std::string_view text, T* value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *value);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

// "5000", "100k" or "1.5M" of units of `thousand`, with `ending` behind. Nothing when it is 0, or
// too large for 64 bits, or no such number.
std::optional<uint64_t> ParseScaled(std::string_view text, double thousand,
                                    std::string_view ending) {
  constexpr std::string_view kSuffixes = "KMGT";
  text.remove_suffix(ending.size());
  double unit = 1;
  if (!text.empty()) {
    const auto last = static_cast<char>(std::toupper(static_cast<unsigned char>(text.back())));
    const auto at = kSuffixes.find(last);
    if (at != std::string_view::npos) {
      for (size_t i = 0; i <= at; ++i) unit *= thousand;
      text.remove_suffix(1);
    }
  }
  if (ending.size() == 2 && unit == 1) return std::nullopt;  // "3iB"
  uint64_t whole = 0;
  if (ParseWhole(text, &whole)) {
    const auto factor = static_cast<uint64_t>(unit);
    if (whole == 0 || whole > std::numeric_limits<uint64_t>::max() / factor) return std::nullopt;
    return whole * factor;
  }
  // A part of a unit: digits with one point between them.
  double value = 0;
  if (unit == 1 || text.empty() || text.front() == '.' || text.back() == '.' ||
      text.find_first_not_of("0123456789.") != std::string_view::npos ||
      !ParseWhole(text, &value) || !(value * unit >= 1 && value * unit < 0x1p63)) {
    return std::nullopt;
  }
  return static_cast<uint64_t>(value * unit + 0.5);
}

}  // namespace

Status Unexpected(const std::string& text, const std::string& expected) {
  return InvalidArgument("expected " + expected + ", found '" + text + "'");
}

Result<std::vector<double>> ParseList(const std::string& text, const std::string& form) {
  std::vector<double> numbers;
  size_t begin = 0;
  while (begin <= text.size()) {
    const size_t end = std::min(text.find(',', begin), text.size());
    double value = 0;
    if (!ParseWhole(std::string_view(text).substr(begin, end - begin), &value) ||
        !IsCoordinate(value)) {
      return Unexpected(text, "numbers from -1e30 to 1e30 " + form);
    }
    numbers.push_back(value);
    begin = end + 1;
  }
  return numbers;
}

Result<std::vector<double>> ParseNumbers(const std::string& text, size_t count,
                                         const std::string& form) {
  Result<std::vector<double>> numbers = ParseList(text, form);
  if (numbers.ok() && numbers->size() == count) return numbers;
  return Unexpected(text, std::to_string(count) + " numbers " + form +
                              (numbers.ok() ? "" : ", each from -1e30 to 1e30"));
}

Result<double> ParseNonNegative(const std::string& text) {
  double value = 0;
  if (!ParseWhole(text, &value) || !(value >= 0 && value <= kMaxCoordinate)) {
    return Unexpected(text, "a number that is not negative, at most 1e30");
  }
  return value;
}

Result<double> ParsePositive(const std::string& text) {
  double value = 0;
  if (!ParseWhole(text, &value) || !(value > 0 && value <= kMaxCoordinate)) {
    return Unexpected(text, "a positive number, at most 1e30");
  }
  return value;
}

Result<AskedError> ParseError(const std::string& text) {
  AskedError error;
  error.relative = text.ends_with('%');
  const std::string_view number = std::string_view(text).substr(0, text.size() - error.relative);
  if (!ParseWhole(number, &error.value) || !(error.value >= 0 && error.value <= kMaxCoordinate)) {
    return Unexpected(text,
                      "a number that is not negative, at most 1e30, or a percentage of the "
                      "object's diagonal, as 0.1%");
  }
  if (error.relative) error.value /= 100;
  return error;
}

double ErrorModelOf(const std::optional<AskedError>& error, double diagonal) {
  if (!error) return -1;
  return error->relative ? error->value * diagonal : error->value;
}

Result<double> ParseSeconds(const std::string& text) {
  const Result<double> value = ParseNonNegative(text);
  if (value.ok() && *value <= kLargestSeconds) return value;
  return Unexpected(text, "seconds that are not negative, at most 1e9");
}

Result<double> ParsePositiveSeconds(const std::string& text) {
  const Result<double> value = ParsePositive(text);
  if (value.ok() && *value <= kLargestSeconds) return value;
  return Unexpected(text, "a positive number of seconds, at most 1e9");
}

Result<uint64_t> ParseWholeNumber(const std::string& text) {
  uint64_t value = 0;
  if (!ParseWhole(text, &value)) return Unexpected(text, "a whole number from 0 to 2^64 - 1");
  return value;
}

Result<uint64_t> ParseCount(const std::string& text) {
  const auto count = ParseScaled(text, 1000, "");
  if (!count) return Unexpected(text, "a whole number above 0, such as 5000, 100k or 1.5M");
  return *count;
}

Result<uint64_t> ParseSize(const std::string& text) {
  // "512MB" and "512MiB" are what people write for "512M".
  std::string_view ending;
  for (const std::string_view known : {"iB", "ib", "B", "b"}) {
    if (text.ends_with(known)) {
      ending = known;
      break;
    }
  }
  const auto size = ParseScaled(text, 1024, ending);
  if (!size) return Unexpected(text, "a size such as 512M, 1.5G or 512MB");
  return *size;
}

Result<uint64_t> ParseMemory(const std::string& text) {
  const Result<uint64_t> size = ParseSize(text);
  if (size.ok() && *size >= kLeastMemory) return size;
  return Unexpected(text, "a size of at least 256M, such as 512M or 4G");
}

Result<Extent> ParseExtent(const std::string& text) {
  const size_t x = text.find('x');
  Extent extent;
  if (x == std::string::npos || !ParseWhole(std::string_view(text).substr(0, x), &extent.width) ||
      !ParseWhole(std::string_view(text).substr(x + 1), &extent.height) || extent.width < 1 ||
      extent.height < 1 || std::max(extent.width, extent.height) > kLargestExtent) {
    return Unexpected(text, "pixels as WxH, each from 1 to " + std::to_string(kLargestExtent));
  }
  return extent;
}

Result<Vec3d> ParsePoint(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 3, "X,Y,Z"));
  return Vec3d{n[0], n[1], n[2]};
}

Result<Vec3d> ParseUp(const std::string& text) {
  const bool down = text.starts_with('-'), plus = text.starts_with('+');
  const std::string axis = text.substr(down || plus ? 1 : 0);
  if (axis.size() == 1 && axis[0] >= 'x' && axis[0] <= 'z') {
    Vec3d up;
    up[axis[0] - 'x'] = down ? -1 : 1;
    return up;
  }
  constexpr const char* kForm = "of a vector X,Y,Z, or one of x, y, z, -x, -y, -z";
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 3, kForm));
  const Vec3d up{n[0], n[1], n[2]};
  const double length = Length(up);
  if (!(length > 0) || !std::isfinite(length)) return Unexpected(text, "a vector other than 0");
  return up;
}

Result<std::string> ParseLengthUnit(const std::string& text) {
  if (std::ranges::find(kLengthUnits, text) != kLengthUnits.end()) return text;
  return Unexpected(text, "um, mm, cm, m, km, in or ft");
}

Result<std::array<double, 2>> ParsePlace(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> numbers, ParseNumbers(text, 2, "X,Y"));
  return std::array{numbers[0], numbers[1]};
}

Result<std::array<double, 2>> ParseSpacing(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> numbers, ParseList(text, "D or DX,DY"));
  if (numbers.empty() || numbers.size() > 2 || !(numbers.front() > 0) || !(numbers.back() > 0)) {
    return Unexpected(text, "a positive spacing, D or DX,DY");
  }
  return std::array<double, 2>{numbers.front(), numbers.back()};
}

Result<std::array<double, 4>> ParseWindow(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 4, "X0,Y0,X1,Y1"));
  return std::array<double, 4>{std::min(n[0], n[2]), std::min(n[1], n[3]), std::max(n[0], n[2]),
                               std::max(n[1], n[3])};
}

Result<Ray> ParseRay(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 6, "X,Y,Z,DX,DY,DZ"));
  const Ray ray{{n[0], n[1], n[2]}, {n[3], n[4], n[5]}};
  if (ray.direction == Vec3d{}) return Unexpected(text, "a direction that is not 0");
  return ray;
}

std::string Endpoint::text() const {
  const bool colons = address.find(':') != std::string::npos;
  return (colons ? "[" + address + "]" : address) + ":" + std::to_string(port);
}

Result<Endpoint> ParseEndpoint(const std::string& text) {
  const size_t colon = text.rfind(':');
  std::string address = colon == std::string::npos ? "127.0.0.1" : text.substr(0, colon);
  if (address == "localhost") address = "127.0.0.1";
  const bool bracketed = address.starts_with('[') && address.ends_with(']');
  if (bracketed) address = address.substr(1, address.size() - 2);
  Endpoint endpoint{address, 0};
  unsigned char bytes[sizeof(in6_addr)];
  const bool known = ::inet_pton(bracketed ? AF_INET6 : AF_INET, address.c_str(), bytes) == 1;
  const auto port = std::string_view(text).substr(colon == std::string::npos ? 0 : colon + 1);
  if (!known || !ParseWhole(port, &endpoint.port)) {
    return Unexpected(text, "an address and a port such as 127.0.0.1:8080 or [::1]:8080");
  }
  return endpoint;
}

Result<AttributeStep> ParseAttributeStep(const std::string& text) {
  const size_t at = text.rfind('=');
  const Result<double> step = ParsePositive(at == std::string::npos ? "" : text.substr(at + 1));
  if (!step.ok() || at == 0) return Unexpected(text, "NAME=STEP, the step a number above 0");
  return AttributeStep{text.substr(0, at), *step};
}

std::string Stem(const std::string& path) {
  std::filesystem::path name(path);
  if (name.extension() == ".gz") name.replace_extension();
  return name.stem().string();
}

std::string SizeText(uint64_t bytes) {
  constexpr const char* kUnits[] = {"bytes", "KB", "MB", "GB", "TB"};
  auto value = static_cast<double>(bytes);
  size_t unit = 0;
  for (; value >= 999.95 && unit + 1 < std::size(kUnits); ++unit) value /= 1000;
  char text[32];
  std::snprintf(text, sizeof(text), unit == 0 ? "%.0f %s" : "%.1f %s", value, kUnits[unit]);
  return text;
}

std::string QuoteForShell(const std::string& word) {
  const auto plain = [](unsigned char c) {
    return std::isalnum(c) != 0 || std::strchr("_-./,:=+@%", c) != nullptr;
  };
  if (!word.empty() && std::ranges::all_of(word, plain)) return word;
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

}  // namespace mtdb
