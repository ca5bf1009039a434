// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/draco_peer.h"

#include <draco/compression/decode.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <unistd.h>
#include <vector>

#include "bench/internal/workload.h"
#include "codecs/mesh_file/mesh_file.h"

namespace mtdb {

DracoResult MeasureDraco(const TriangleMesh& mesh, int bits, int level) {
  const std::string path = (std::filesystem::temp_directory_path() /
                            ("mtdb_bench_" + std::to_string(::getpid()) + "_peer.drc"))
                               .string();
  MeshWriteOptions options;
  options.draco_position_bits = bits;
  options.draco_level = level;
  const std::unique_ptr<MeshFileWriter> writer = CreateMeshFileWriter(path, options).value();
  const Status status = SendMesh(mesh, *writer);
  MTDB_CHECK(status.ok(), status.message().c_str());
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> data(std::istreambuf_iterator<char>(file), {});
  std::filesystem::remove(path);
  draco::DecoderBuffer buffer;
  buffer.Init(data.data(), data.size());
  DracoResult result;
  result.bytes = data.size();
  draco::Decoder decoder;
  const double begin = ProcessCpuSeconds();
  const auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  result.decode_seconds = ProcessCpuSeconds() - begin;
  MTDB_CHECK(decoded.ok() && decoded.value()->num_faces() <= mesh.triangles.size(),
             "Draco reads what it wrote");
  return result;
}

}  // namespace mtdb
