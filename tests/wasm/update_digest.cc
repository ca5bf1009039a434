// SPDX-License-Identifier: Apache-2.0
// Replays an update stream and prints a digest of the client's mesh after every portion: the same
// on every machine. Built of codecs/client_sources.txt alone, natively and as WebAssembly.
#include <cstdio>
#include <span>

#include "codecs/stream/update_stream.h"
#include "store/base/hash.h"

namespace {

constexpr size_t kPortionBytes = 200;

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: update_digest STREAM\n", stderr);
    return 2;
  }
  std::FILE* const file = std::fopen(argv[1], "rb");
  if (file == nullptr) {
    std::perror(argv[1]);
    return 1;
  }
  mtdb::UpdateDecoder decoder;
  mtdb::Bytes portion(kPortionBytes);
  uint64_t digest = 0;
  uint32_t most = 0;
  for (size_t bytes; (bytes = std::fread(portion.data(), 1, portion.size(), file)) > 0;) {
    const mtdb::Status status = decoder.Feed(mtdb::ByteSpan(portion).first(bytes));
    if (!status.ok()) {
      std::fprintf(stderr, "%s\n", status.message().c_str());
      return 1;
    }
    const mtdb::ClientMesh& mesh = decoder.mesh();
    digest = mtdb::Hash64(std::as_bytes(mesh.indices()), digest);
    digest = mtdb::Hash64(std::as_bytes(mesh.positions()), digest);
    digest = mtdb::Hash64(mesh.rows(), digest);
    most = mesh.triangle_count() > most ? mesh.triangle_count() : most;
  }
  std::fclose(file);
  if (!decoder.at_record() || most == 0) {
    std::fprintf(stderr, "%s: the stream ends within a record, or has no triangles\n", argv[1]);
    return 1;
  }
  std::printf("%016llx, at most %u triangles\n", static_cast<unsigned long long>(digest), most);
  return 0;
}
