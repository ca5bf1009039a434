// SPDX-License-Identifier: Apache-2.0
// FillingRule: which triangles fill the hole that a removed vertex leaves.
#pragma once

#include <concepts>

#include "builder/holes/hole.h"

namespace mtdb::internal {

// Open() looks at a hole's ring. Fill() chooses the triangles of a filling of that hole, none of
// whose diagonals is forbidden, or returns false when there is no such filling; it is asked again
// when more errors of diagonals are known. When the rule says so by kReadsEdgeErrors, it sees an
// error of every diagonal that it may use (some guessed, negative where the diagonal cannot be); of
// a folded hole these are all 0, and a rule that needs to see the hole whole returns false.
// Deterministic. One object serves one thread and keeps nothing from one hole to the next.
template <typename Rule>
concept FillingRule = requires(Rule rule, const Hole& hole, Hole::Triangles& triangles) {
  { Rule::kReadsEdgeErrors } -> std::convertible_to<bool>;
  rule.Open(hole);
  { rule.Fill(hole, triangles) } -> std::same_as<bool>;
};

}  // namespace mtdb::internal
