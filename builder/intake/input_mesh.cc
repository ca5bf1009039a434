// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/input_mesh.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string_view>
#include <utility>

namespace mtdb::internal {

namespace {

// Whether `value`, read from text, may be how a program has written `single`: rounded to the last
// of its digits. Their number is that of the value's, less zeros, of 15 at most.
bool IsTextOf(double value, float single) {
  if (!std::isfinite(single)) return false;
  char buffer[32];
  const auto end =
      std::to_chars(buffer, buffer + sizeof(buffer), value, std::chars_format::scientific, 14);
  const std::string_view text(buffer, static_cast<size_t>(end.ptr - buffer));
  const size_t mark = text.find('e');
  const std::string_view mantissa = text.substr(0, text.find_last_not_of("0.", mark - 1) + 1);
  const auto digits = std::max<ptrdiff_t>(
      1,
      std::count_if(mantissa.begin(), mantissa.end(), [](char c) { return c >= '0' && c <= '9'; }));
  int power = 0;
  const char* const exponent = buffer + mark + 1;
  std::from_chars(*exponent == '+' ? exponent + 1 : exponent, end.ptr, power);
  const double unit = std::pow(10.0, static_cast<double>(power + 1 - digits));
  return std::abs(static_cast<double>(single) - value) <= 0.5 * unit * (1 + 1e-9);
}

}  // namespace

bool InputMesh::MayMean(Vec3d p, Vec3f f) const {
  return header_.from_text && !header_.double_positions && IsTextOf(p.x, f.x) &&
         IsTextOf(p.y, f.y) && IsTextOf(p.z, f.z);
}

Result<bool> InputMesh::FitsSingle() const {
  if (!doubles_) return rounding_ == 0;
  SpoolReader reader(&vertex_spool_);
  for (uint64_t v = 0; v < vertices_; ++v) {
    const std::byte* bytes = reader.Next(vertex_bytes());
    if (bytes == nullptr) return reader.status();
    const Vec3d p = Position(bytes);
    const Vec3f f{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
    if (Vec3d{f.x, f.y, f.z} != p && !MayMean(p, f)) return false;
  }
  return true;
}

Status InputMesh::TurnOver(const SpoolSpace* space, size_t memory_bytes,
                           const std::function<Result<bool>()>& turned) {
  const Spool old = std::exchange(triangle_spool_, Spool(space, memory_bytes));
  SpoolReader reader(&old);
  if (textured()) corners_.BeginKeeping();
  for (uint64_t left = old.size() / kTriangleBytes; left > 0; --left) {
    std::array<uint32_t, 3> t;
    if (!reader.Get(&t)) return reader.status();
    MTDB_ASSIGN_OR_RETURN(const bool turn, turned());
    if (turn) std::swap(t[1], t[2]);
    if (textured()) MTDB_RETURN_IF_ERROR(corners_.Keep(true, turn));
    MTDB_RETURN_IF_ERROR(triangle_spool_.Append(t.data(), kTriangleBytes));
  }
  if (textured()) MTDB_RETURN_IF_ERROR(corners_.EndKeeping());
  return triangle_spool_.Finish();
}

Vec3d InputMesh::Position(const std::byte* vertex) const {
  if (doubles_) {
    Vec3d p;
    std::memcpy(&p, vertex, 24);
    return p;
  }
  Vec3f p;
  std::memcpy(&p, vertex, 12);
  return {p.x, p.y, p.z};
}

}  // namespace mtdb::internal
