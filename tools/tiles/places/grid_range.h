// SPDX-License-Identifier: Apache-2.0
// GridRange: the tiles of a level that an object has, and how their files are called.
#pragma once

#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace mtdb {

// A rectangle of tiles, numbered row by row.
struct GridRange {
  uint32_t first_column = 0, first_row = 0, last_column = 0, last_row = 0;

  uint32_t width() const { return last_column - first_column + 1; }
  uint64_t count() const { return width() * (uint64_t{last_row} - first_row + 1); }
  bool Contains(uint32_t column, uint32_t row) const {
    return column >= first_column && column <= last_column && row >= first_row && row <= last_row;
  }
  uint32_t NumberOf(uint32_t column, uint32_t row) const {
    return (row - first_row) * width() + column - first_column;
  }
  std::array<uint32_t, 2> PlaceOf(uint32_t tile) const {
    return {first_column + tile % width(), first_row + tile / width()};
  }
};

// "LEVEL/COLUMN/ROW" and the suffix.
inline std::string GridPath(uint32_t level, uint32_t column, uint32_t row,
                            std::string_view suffix) {
  return std::to_string(level) + "/" + std::to_string(column) + "/" + std::to_string(row) +
         std::string(suffix);
}

// Level, column and row of exactly such a path, whoever made it up; none: it is another text.
inline std::optional<std::array<uint32_t, 3>> GridPlaceOf(std::string_view path,
                                                          std::string_view suffix) {
  std::array<uint32_t, 3> place{};
  const char* at = path.data();
  const char* const end = at + path.size();
  for (size_t i = 0; i < place.size(); ++i) {
    const auto [rest, error] = std::from_chars(at, end, place[i]);
    if (error != std::errc()) return std::nullopt;
    at = rest + 1;
    if (i < 2 && (rest == end || *rest != '/')) return std::nullopt;
  }
  if (path != GridPath(place[0], place[1], place[2], suffix)) return std::nullopt;
  return place;
}

}  // namespace mtdb
