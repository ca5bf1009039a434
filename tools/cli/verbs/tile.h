// SPDX-License-Identifier: Apache-2.0
// `mtdb tile`: its arguments, its options, and what it does.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>

#include "store/base/status.h"
#include "store/database.h"
#include "tools/cli/verbs.h"
#include "tools/tiles/geodesy.h"

namespace mtdb {

struct TileArguments {
  std::string store;
  OpenOptions open;
  std::string output;  // a folder
  std::string name;
  std::string format = "3dtiles";
  std::optional<GlobePlace> at;            // 3dtiles
  std::optional<double> pixels;            // 3dtiles
  std::optional<uint64_t> tile_triangles;  // 3dtiles
  bool mercator = false;                   // quantized-mesh
  std::optional<uint32_t> max_level;       // quantized-mesh
  std::optional<uint64_t> memory_bytes;    // none: a quarter of the machine's
  unsigned threads = 0;                    // 0: one per core
  std::string tmp;                         // folder of temporary files; empty: the output
  bool force = false, quiet = false, json = false;
};
void AddTile(CLI::App* verb, TileArguments* arguments);
// Prints what was written.
Status TileVerb(const TileArguments& arguments);

// `mtdb verify --tiles`: as Verify(), of the tiles in `folder`.
Status VerifyTilesVerb(const InspectArguments& arguments, const std::string& folder, bool* ok);

}  // namespace mtdb
