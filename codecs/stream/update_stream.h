// SPDX-License-Identifier: Apache-2.0
// The update stream: a base mesh, then batches of vertex insertions and removals, coded against the
// mesh that the client holds; for a client that is clipped to a region, also triangles that enter
// and leave the region. It serves dynamic updates and progressive transmission. Specified in
// codecs/FORMAT.md. After De Floriani, Magillo, Puppo, "Efficient implementation of
// Multi-Triangulations" (1998); the coding is that of our clusters.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "codecs/stream/client_mesh.h"
#include "codecs/stream/mesh_update.h"
#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// The sender. It keeps a copy of the client's mesh, and names triangles and vertices by their slots
// there. One client each; one thread. Memory: some 85 bytes and half a row of attributes for each
// triangle of the client's mesh; while the client is clipped, some 150 bytes more for each triangle
// of the whole cut. Deterministic.
//
// A client that is clipped to a region holds those triangles of the cut that meet the region, and
// no others. Each call may name another region.
class UpdateEncoder {
 public:
  // `base` is the whole mesh to which the first batch applies. StartBytes(options, base) must be at
  // most kMaxStartBytes.
  static constexpr uint64_t kMaxStartBytes = uint64_t{1} << 28;
  UpdateEncoder(const ClientMeshOptions& options, const BaseMesh& base,
                const MeetsRegion& region = {});
  ~UpdateEncoder();
  // An upper bound of the size of start().
  static uint64_t StartBytes(const ClientMeshOptions& options, const BaseMesh& base);

  // The stream's first bytes: the header, and the base mesh or the part of it that meets the
  // region.
  const Bytes& start() const;
  // The records that apply `batches` in their order; no bytes when there is nothing to send.
  // Batches that do not fit the mesh are a caller's bug (MTDB_CHECK). With a region, triangles that
  // the client cannot or need not follow by an update are dropped and attached after the batches.
  // Cost of a region: `region` is asked about every triangle of the whole cut.
  Bytes Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region = {});
  // The mesh of a client that has read everything, without its arrays for a GPU and its changes.
  const ClientMesh& mesh() const;
  // About how much memory it takes between calls, without the models of attributes.
  size_t memory_bytes() const;

  // Counts so far: updates that had to list their triangles (codecs/FORMAT.md, "Listed updates");
  // vertices that travelled, those of the base mesh included; and vertices that came back from the
  // client's memory instead.
  uint64_t listed_updates() const;
  uint64_t sent_vertices() const;
  uint64_t recalled_vertices() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// The client. Bytes may come in any portions, and may be hostile: the memory that they take is
// bounded by the limits, and by 12 MB and 512 times the bytes of the stream. One thread.
class UpdateDecoder {
 public:
  struct Limits {
    uint32_t triangles = 1u << 26;  // of the mesh; more is refused
    uint32_t vertices = 1u << 25;   // remembered ones included
  };
  UpdateDecoder();
  explicit UpdateDecoder(const Limits& limits);
  ~UpdateDecoder();

  // Applies all records that are complete, and keeps the rest of the bytes for the next call. After
  // an error the mesh is still conforming: it is as the last update that could be read left it.
  // More bytes are then refused. Errors: kCorrupt, with the offset in the stream; kUnsupported for
  // another version.
  Status Feed(ByteSpan bytes);
  // True when the base mesh has been read. (A client of a region gets an empty one; its triangles
  // come in records.)
  bool started() const;
  // True when no bytes are kept: all bytes so far were whole records.
  bool at_record() const;
  const ClientMesh& mesh() const;
  ClientMesh::Changes TakeChanges();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mtdb
