// SPDX-License-Identifier: Apache-2.0
// PlainDagOf: a built object as the plain DAG that the oracles of queries read.
#pragma once

#include "query/surface.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::sheets {

// Decodes all units. Two-sided triangles are two, as in every answer.
mtdb::testing::MtFixture PlainDagOf(const Surface& surface);

}  // namespace mtdb::sheets
