// SPDX-License-Identifier: Apache-2.0
// What an ingest is asked for, and what is said of its inputs before: ingest and info.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "builder/build.h"
#include "store/base/status.h"

namespace mtdb {

struct IngestArguments {
  std::vector<std::string> inputs;  // "-": standard input
  std::string format;               // of standard input; empty: its content tells it
  std::string store;
  std::string name;
  std::optional<int> bits;
  std::optional<double> step;
  std::optional<double> step_z;  // rasters
  std::optional<uint32_t> fill;  // rasters
  bool lossless = false;
  bool terrain = false;  // the meshes are height fields
  std::optional<Vec3d> up;
  std::string units;
  std::optional<double> weld;
  bool keep_apart = false;
  bool orient = false;
  std::optional<double> texture_step;
  bool drop_texture = false;
  std::optional<int> normal_bits;
  std::vector<AttributeStep> attribute_steps;
  unsigned threads = 0;
  std::string tmp;                        // folder of temporary files; empty: the store's
  std::optional<uint64_t> memory_bytes;   // none: a quarter of the machine's
  std::optional<uint64_t> max_tmp_bytes;  // of temporary files; none: as many as the disk takes
  bool resume = false;
  std::string resume_command;  // the command line that goes on with this ingest
  bool dry_run = false;
  bool replace = false, quiet = false, json = false, verbose = false;
};
// Prints what the inputs are like, and what an ingest would make of them; stores nothing.
Status Survey(const IngestArguments& arguments);

}  // namespace mtdb
