// SPDX-License-Identifier: Apache-2.0
// What a comparison is asked for, by options or as JSON (docs/protocol.md).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

#include "query/compare.h"
#include "query/height_change.h"
#include "store/base/json.h"
#include "store/object_record.h"
#include "tools/request/arguments.h"

namespace mtdb {

// Before the objects are known.
struct CompareRequest {
  std::optional<AskedError> tolerance, width, reach;  // relative ones are of A
  std::optional<double> max_milliseconds;
  std::optional<uint64_t> max_places;
  Json region;  // as docs/query.md has it; null: all of space
  Transform transform = kIdentity;
  std::string asks = "both";  // or "a", "b"
  bool as_stored = false;
  bool heights = false;                         // of two terrains, not distances
  std::optional<std::array<double, 4>> window;  // of heights: least x, y, largest x, y
};

// The member that does not go with the others ("reach"); nothing when all go together.
std::optional<std::string> ConflictOf(const CompareRequest& request);

// What it means for the object A. Errors: kInvalidArgument.
Result<CompareOptions> CompareOptionsOf(const CompareRequest& request, const ObjectRecord& a);

// The same of heights: relative ones are of A's range of heights.
HeightChangeOptions HeightChangeOptionsOf(const CompareRequest& request, const ObjectRecord& a);

// Of two objects of a store.
struct NamedComparison {
  std::string object, other;  // A, B
  CompareRequest request;
};
// Errors: kInvalidArgument; the message begins with the key, and says what was expected and found.
// What is wrong with the region CompareOptionsOf finds. Safe on any bytes.
Result<NamedComparison> ParseComparison(std::string_view text);

}  // namespace mtdb
