// SPDX-License-Identifier: Apache-2.0
// Texts of the command line as values. An error is kInvalidArgument and says what was expected.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "builder/build.h"
#include "store/base/geometry.h"
#include "store/base/status.h"
#include "tools/request/endpoint.h"

namespace mtdb {

struct Extent {
  int width = 0, height = 0;  // pixels, 1 .. 16384
};

struct Ray {
  Vec3d origin, direction;
};

// "expected (what), found '(text)'".
Status Unexpected(const std::string& text, const std::string& expected);
// Of at most 1e30, as queries have them.
Result<double> ParseNonNegative(const std::string& text);
Result<double> ParsePositive(const std::string& text);
// An error that is good enough: a length, or a part of the object's diagonal.
struct AskedError {
  double value = 0;
  bool relative = false;
};
// "0.5", or "5%" of the diagonal; not negative.
Result<AskedError> ParseError(const std::string& text);
// In model units of an object of this diagonal; negative for none, which asks for full resolution.
double ErrorModelOf(const std::optional<AskedError>& error, double diagonal);
// Of at most 1e9, some 30 years.
Result<double> ParseSeconds(const std::string& text);
Result<double> ParsePositiveSeconds(const std::string& text);
// A whole number.
Result<uint64_t> ParseWholeNumber(const std::string& text);
// A whole number above 0, also as "100k" or "1.5M": k, M, G and T are thousands, millions, ...
Result<uint64_t> ParseCount(const std::string& text);
// Any number of numbers between commas, each from -1e30 to 1e30; `form` describes them.
Result<std::vector<double>> ParseList(const std::string& text, const std::string& form);
// "1,2,3" as exactly `count` such numbers, which `form` describes.
Result<std::vector<double>> ParseNumbers(const std::string& text, size_t count,
                                         const std::string& form);
// "512M", "1.5G", "512MB", "4096": bytes; K, M, G, T are powers of 1024, also before B or iB. Not
// 0.
Result<uint64_t> ParseSize(const std::string& text);
// Likewise, what an ingest may use: at least 256M.
Result<uint64_t> ParseMemory(const std::string& text);
// "1200x900".
Result<Extent> ParseExtent(const std::string& text);
// "x", "-y", ... or "X,Y,Z", other than 0.
Result<Vec3d> ParseUp(const std::string& text);
// One of kLengthUnits.
Result<std::string> ParseLengthUnit(const std::string& text);
// "X,Y,Z".
Result<Vec3d> ParsePoint(const std::string& text);
// "X,Y".
Result<std::array<double, 2>> ParsePlace(const std::string& text);
// "D" or "DX,DY", positive.
Result<std::array<double, 2>> ParseSpacing(const std::string& text);
// Two corners, "X0,Y0,X1,Y1", as the least and the largest x and y.
Result<std::array<double, 4>> ParseWindow(const std::string& text);
// "X,Y,Z,DX,DY,DZ"; the direction is not 0.
Result<Ray> ParseRay(const std::string& text);
// "127.0.0.1:8080", "[::1]:8080", "localhost:8080", or the port alone, on 127.0.0.1.
Result<Endpoint> ParseEndpoint(const std::string& text);
// "NAME=STEP"; the last "=" counts.
Result<AttributeStep> ParseAttributeStep(const std::string& text);
// The file's name without folders, extension and ".gz": an object's name by default.
std::string Stem(const std::string& path);
// "12.3 MB", in decimal units.
std::string SizeText(uint64_t bytes);
// As a shell reads it back as one word.
std::string QuoteForShell(const std::string& word);

}  // namespace mtdb
