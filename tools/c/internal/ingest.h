// SPDX-License-Identifier: Apache-2.0
// What all ingests from C have in common.
#pragma once

#include <optional>

#include "builder/build.h"
#include "tools/c/mtdb_write.h"

namespace mtdb::internal {

// Stores what `input` sends under `name`. `terrain`: what rasters bring along.
Status Ingest(mtdb_database* database, const char* name, const MeshProducer& input,
              const mtdb_ingest_options* options, const mtdb_watch* watch,
              std::optional<TerrainInput> terrain = {});
// Rasters of heights, joined to one object.
Status IngestRasters(mtdb_database* database, const char* name, const char* const* paths,
                     size_t count, const mtdb_ingest_options* options, const mtdb_watch* watch);

}  // namespace mtdb::internal
