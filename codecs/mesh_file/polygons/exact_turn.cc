// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/polygons/exact_turn.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace mtdb::internal {
namespace {

// A number as the sum of two, of which the second is what the first has lost by rounding.
struct TwoTerms {
  double high = 0, low = 0;
};

TwoTerms Sum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}
TwoTerms Product(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}

// A sum of terms that do not overlap, smallest first.
class Expansion {
 public:
  void Add(double term) {
    for (size_t i = 0; i < size_; ++i) {
      const TwoTerms sum = Sum(terms_[i], term);
      terms_[i] = sum.low;
      term = sum.high;
    }
    terms_[size_++] = term;
  }
  void AddProduct(TwoTerms a, TwoTerms b, double sign) {
    for (const double u : {a.low, a.high}) {
      for (const double v : {b.low, b.high}) {
        const TwoTerms product = Product(u, v);
        Add(sign * product.low);
        Add(sign * product.high);
      }
    }
  }
  // That of the largest term.
  int Sign() const {
    for (size_t i = size_; i-- > 0;) {
      if (terms_[i] != 0) return terms_[i] > 0 ? 1 : -1;
    }
    return 0;
  }

 private:
  std::array<double, 16> terms_{};  // of two products of two sums
  size_t size_ = 0;
};

int ExactTurn(PlanePoint a, PlanePoint b, PlanePoint c) {
  Expansion determinant;
  determinant.AddProduct(Sum(a.x, -c.x), Sum(b.y, -c.y), 1);
  determinant.AddProduct(Sum(a.y, -c.y), Sum(b.x, -c.x), -1);
  return determinant.Sign();
}

}  // namespace

int TurnOf(PlanePoint a, PlanePoint b, PlanePoint c) {
  constexpr double kUnit = std::numeric_limits<double>::epsilon() / 2;
  constexpr double kErrorBound = (3 + 16 * kUnit) * kUnit;
  const double left = (a.x - c.x) * (b.y - c.y);
  const double right = (a.y - c.y) * (b.x - c.x);
  const double determinant = left - right;
  const double bound = kErrorBound * (std::abs(left) + std::abs(right));
  if (determinant > bound) return 1;
  if (determinant < -bound) return -1;
  if (left == 0 && right == 0) return 0;  // a difference that is 0 is exact
  return ExactTurn(a, b, c);
}

}  // namespace mtdb::internal
