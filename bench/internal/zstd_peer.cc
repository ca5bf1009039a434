// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/zstd_peer.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <unistd.h>
#include <zstd.h>

#include "bench/internal/workload.h"
#include "codecs/mesh_file/mesh_file.h"

namespace mtdb {

ZstdPeer MeasureZstd(const TriangleMesh& mesh, const std::vector<int>& levels) {
  const std::string path = (std::filesystem::temp_directory_path() /
                            ("mtdb_bench_" + std::to_string(::getpid()) + "_peer.ply"))
                               .string();
  const std::unique_ptr<MeshFileWriter> writer = CreateMeshFileWriter(path).value();
  const Status status = SendMesh(mesh, *writer);
  MTDB_CHECK(status.ok(), status.message().c_str());
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> plain(std::istreambuf_iterator<char>(file), {});
  std::filesystem::remove(path);

  ZstdPeer peer{plain.size(), {}};
  std::vector<char> packed(ZSTD_compressBound(plain.size()));
  std::vector<char> unpacked(plain.size());
  for (const int level : levels) {
    const double begin = ProcessCpuSeconds();
    const size_t bytes =
        ZSTD_compress(packed.data(), packed.size(), plain.data(), plain.size(), level);
    const double encoded = ProcessCpuSeconds();
    MTDB_CHECK(ZSTD_isError(bytes) == 0, "zstd has room");
    const size_t back = ZSTD_decompress(unpacked.data(), unpacked.size(), packed.data(), bytes);
    const double decoded = ProcessCpuSeconds();
    MTDB_CHECK(back == plain.size() && unpacked == plain, "zstd reads what it wrote");
    peer.results.push_back({level, bytes, encoded - begin, decoded - encoded});
  }
  return peer;
}

}  // namespace mtdb
