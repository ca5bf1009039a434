// SPDX-License-Identifier: Apache-2.0
// Several input files, one mesh.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

// Reads all `inputs` into `sink` as one mesh, one after the other. Vertices of different files are
// joined when all are STL, which has none of its own; beside other formats, an STL file's own
// vertices are joined in memory, of which it may take `soup_bytes` (else kBudgetExceeded). An
// attribute is kept when every file has it under that name and type; the others, and what the
// readers ignored, are added to `notes`. Streams: a first look at each file's header, then the
// data.
Status ReadMeshes(const std::vector<MeshInput>& inputs, MeshSink& sink,
                  std::vector<std::string>* notes,
                  uint64_t soup_bytes = std::numeric_limits<uint64_t>::max());

struct InputLimits {
  uint64_t max_tmp_bytes = ~uint64_t{0};  // of all copies
  std::function<Status()> look;           // see MeshReadOptions
};
// Opens the files at `paths`; "-" is standard input, of this format. `tmp` is the folder for copies
// of what cannot be read twice.
Result<std::vector<MeshInput>> OpenMeshes(const std::vector<std::string>& paths,
                                          const std::string& format, const std::string& tmp,
                                          const InputLimits& limits = {});

}  // namespace mtdb
