// SPDX-License-Identifier: Apache-2.0
// RemoveVertex: simplifies a complex by the rules that keep what meets, naively. Its results are
// cuts that the checker must not refuse.
#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <vector>

#include "tests/sheets/sheet_graph.h"

namespace mtdb::sheets {

// The sheets without the vertex v: of an interior one its star is filled, of one on a chain each of
// the half-disks that meet there, all with the same chord. Nothing where that would make an edge or
// a face that there is already, where v is a node of the crease graph or one where sheets touch,
// and where a half-disk has one sheet only.
std::optional<std::vector<Sheet>> RemoveVertex(const SheetGraph& graph, uint32_t v,
                                               std::mt19937& random);

}  // namespace mtdb::sheets
