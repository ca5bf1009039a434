// SPDX-License-Identifier: Apache-2.0
// What extract, render and fetch share: their arguments, the surface that they ask, and what they
// tell of the answer.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "codecs/mesh_file/mesh_file.h"
#include "query/surface.h"
#include "store/base/json.h"
#include "store/database.h"
#include "tools/render/render.h"
#include "tools/request/query_options.h"

namespace mtdb {

struct QueryArguments {
  std::string store;          // fetch: a URL
  OpenOptions open;           // not fetch
  std::string output;         // "-": standard output
  std::string output_format;  // of standard output
  std::string name;
  QueryOptions query;
  bool print_query = false;
  bool quiet = false;                   // nothing is told
  bool implicit = false;                // the cache keeps clusters as in the store; not fetch
  std::optional<uint64_t> cache_bytes;  // none: a quarter of the machine's; not fetch
  bool json = false;
  bool verbose = false;
  bool double_positions = false;  // extract, fetch: .ply
  Extent size{1200, 900};         // render
  RenderOptions picture;          // render: but for its size, frame, direction and up
  std::string view = "auto";      // render: of kViewNames
  double exaggerate = 1;          // render: z is drawn so many times as high
  bool overview = false;          // render: not what the camera sees
  double timeout_seconds = 600;   // fetch: without progress
  // Extract: of a raster that a terrain becomes.
  std::optional<std::array<double, 2>> spacing;
  std::optional<std::array<double, 4>> window;
  std::string drape;  // extract, render: an image; empty: none
};
// Extract with an output that is a raster's.
Status ExtractRaster(const QueryArguments& arguments);

Result<std::shared_ptr<Surface>> OpenSurface(const QueryArguments& arguments);

struct QueryReport {
  const Json& query;
  const ObjectRecord& record;
  const ExtractStats& stats;
  std::optional<MeshWriteReport> file = {};  // extract: what the file has of the mesh
  double open_seconds = 0, write_seconds = 0, total_seconds = 0;
  Json picture = {};         // render: how it was drawn
  std::string remarks = {};  // more lines for people
};
// Whether a line tells by how much the answer falls short: not when a budget ended the refinement
// of a query that asks for no error but so many triangles, bytes or milliseconds.
bool TellsShortfall(const Json& query, const std::string& limit);
// As text or JSON; to standard error, when the mesh goes to standard output.
void PrintQueryReport(const QueryArguments& arguments, const QueryReport& report);

}  // namespace mtdb
