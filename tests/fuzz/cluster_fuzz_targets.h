// SPDX-License-Identifier: Apache-2.0
// The clusters whose in-patches the cluster target decodes against.
#pragma once

#include "tests/codecs/cluster_fixture.h"

namespace mtdb::testing {

inline constexpr ClusterOptions kClusterFuzzTargets[] = {
    {.side = 8},
    {.surface = Surface::kSheet, .side = 8, .pierced = true},
    {.side = 8, .numbers = Numbers::kWild, .attributes = true},
    {.surface = Surface::kSheet, .side = 8, .rounded_attributes = true},
    {.surface = Surface::kTerrain, .side = 8},
    {.surface = Surface::kBook, .side = 8},
};

}  // namespace mtdb::testing
