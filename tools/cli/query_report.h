// SPDX-License-Identifier: Apache-2.0
// What extract and render share: the surface that they ask, and what they tell of the answer.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "codecs/mesh_file/mesh_file.h"
#include "query/surface.h"
#include "tools/cli/verbs.h"
#include "tools/client/json.h"

namespace mtdb {

Result<std::shared_ptr<Surface>> OpenSurface(const QueryArguments& arguments);

struct QueryReport {
  const QueryJson& query;
  const ObjectRecord& record;
  const ExtractStats& stats;
  std::optional<MeshWriteReport> file = {};  // extract: what the file has of the mesh
  double open_seconds = 0, write_seconds = 0, total_seconds = 0;
  Json picture = {};         // render: how it was drawn
  std::string remarks = {};  // more lines for people
};
// Whether a line tells by how much the answer falls short: not when a budget ended the refinement
// of a query that asks for no error but so many triangles, bytes or milliseconds.
bool TellsShortfall(const QueryJson& query, const std::string& limit);
// As text or JSON; to standard error, when the mesh goes to standard output.
void PrintQueryReport(const QueryArguments& arguments, const QueryReport& report);

}  // namespace mtdb
