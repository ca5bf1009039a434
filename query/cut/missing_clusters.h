// SPDX-License-Identifier: Apache-2.0
// What a query lacks that takes what is there: which clusters, and in what order they would help.
#pragma once

#include <vector>

#include "query/cache/available_units.h"
#include "query/cut/judge.h"
#include "query/extract_stats.h"
#include "store/cluster_index.h"

namespace mtdb::internal {

class UnitReader;

// What `units` noted as missing, as ExtractStats::missing orders it.
std::vector<MissingCluster> RankMissing(const ClusterIndex& index, const Judge& judge,
                                        const AvailableUnits& units);

// Has these asked for, and behind them what the query will surely want next: clusters below them
// whose errors it would refuse nearly everywhere in their boxes, as far as the index is there. With
// `all` nothing else is wanted any more.
void AskForMissing(const ClusterIndex& index, const Judge& judge,
                   const std::vector<MissingCluster>& missing, bool all, AvailableUnits& units);

// Of a query that waits, over a source that answers later: has `units` asked for, the first before
// the others, and behind them what it will surely want, as far as rows are there.
void AskForWanted(const Judge& judge, std::vector<UnitId>& units, UnitReader& reader);

}  // namespace mtdb::internal
