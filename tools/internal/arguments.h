// Texts of the command line as values. An error is kInvalidArgument and says what was expected.
#pragma once

#include <cstdint>
#include <string>

#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb {

struct Sphere {
  Vec3d centre;
  double radius = 0;
};

struct Extent {
  int width = 0, height = 0;  // pixels, 1 .. 16384
};

struct Ray {
  Vec3d origin, direction;
};

// Finite numbers.
Result<double> ParseNonNegative(const std::string& text);
Result<double> ParsePositive(const std::string& text);
// A whole number above 0.
Result<uint64_t> ParseCount(const std::string& text);
// "X0,Y0,Z0,X1,Y1,Z1": two corners, the first nowhere above the second. A flat box is one.
Result<Box3d> ParseBox(const std::string& text);
// "X,Y,Z,R"; the radius is not negative.
Result<Sphere> ParseSphere(const std::string& text);
// "512M", "1G", "4096": bytes; the suffixes K, M, G, T are powers of 1024. Not 0.
Result<uint64_t> ParseSize(const std::string& text);
// "1200x900".
Result<Extent> ParseExtent(const std::string& text);
// "X,Y,Z".
Result<Vec3d> ParsePoint(const std::string& text);
// "X,Y,Z,DX,DY,DZ"; the direction is not 0.
Result<Ray> ParseRay(const std::string& text);
// The file's name without folders and extension: an object's name by default.
std::string Stem(const std::string& path);

}  // namespace mtdb
