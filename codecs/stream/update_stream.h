// The update stream: a base mesh, then batches of vertex insertions and removals, coded against the
// mesh that the client holds; for a client that is clipped to a region, also what enters and leaves
// it. Dynamic update and progressive transmission. Specified in
// codecs/FORMAT.md; after De Floriani, Magillo, Puppo, "Efficient implementation of
// Multi-Triangulations" (1998), with the code of our clusters.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "codecs/stream/client_mesh.h"
#include "codecs/stream/mesh_update.h"
#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// The sender: follows the client's mesh, and names triangles and vertices as the client knows them.
// One client each; one thread. Memory: the client's mesh and about 80 bytes for each of its
// triangles and vertices; while the client is clipped, some 200 bytes more for each triangle of the
// whole cut. Deterministic.
//
// A client that is clipped to a region holds just those triangles of the cut that meet it. The
// region may be another one in each call.
class UpdateEncoder {
 public:
  // `base` is the whole mesh that the first batch fits; of at most kMaxStartBytes by StartBytes.
  static constexpr uint64_t kMaxStartBytes = uint64_t{1} << 28;
  UpdateEncoder(const ClientMeshOptions& options, const BaseMesh& base,
                const MeetsRegion& region = {});
  ~UpdateEncoder();
  // Not less than what the start takes.
  static uint64_t StartBytes(const ClientMeshOptions& options, const BaseMesh& base);

  // The header and the base mesh, or what of it meets the region: the stream's first bytes.
  const Bytes& start() const;
  // The records that apply `batches` in their order; none for none. They must fit the mesh: a
  // caller's bug otherwise. What the client of a region cannot or need not follow as an update goes
  // by dropping and attaching triangles, after the batches. Cost of a region: `region` is asked for
  // every triangle of the whole cut.
  Bytes Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region = {});
  // What the client has when it has read everything.
  const ClientMesh& mesh() const;
  // Memory between calls, about, without the models of attributes.
  size_t memory_bytes() const;

  // So far: updates that could not be coded by walking (see "Listed updates"), vertices that
  // travelled, base mesh included, and those that came back from the client's memory.
  uint64_t listed_updates() const;
  uint64_t sent_vertices() const;
  uint64_t recalled_vertices() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// The client. Bytes may come in any portions and may be hostile: what they take is bounded by the
// limits, and by 12 MB and 512 times the bytes of the stream. One thread.
class UpdateDecoder {
 public:
  struct Limits {
    uint32_t triangles = 1u << 26;  // of the mesh; more is refused
    uint32_t vertices = 1u << 25;   // remembered ones included
  };
  UpdateDecoder();
  explicit UpdateDecoder(const Limits& limits);
  ~UpdateDecoder();

  // Applies all records that are complete, and keeps the rest for later. After an error the mesh is
  // conforming still: it ends at the last update that could be read; more bytes are refused.
  // Errors: kCorrupt, with the offset in the stream; kUnsupported for another version.
  Status Feed(ByteSpan bytes);
  // True when the base mesh is there; that of a region comes as records behind it.
  bool started() const;
  // True when nothing is kept: all bytes were whole records.
  bool at_record() const;
  const ClientMesh& mesh() const;
  ClientMesh::Changes TakeChanges();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mtdb
