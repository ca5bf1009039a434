// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/encode/sent_stream.h"

#include "store/base/check.h"
#include "store/base/hash.h"

namespace mtdb::internal {
namespace {

// What an update takes at most, its row not counted, and what a byte of a row takes.
constexpr uint64_t kMaxUpdateBytes = 512;
constexpr uint64_t kMaxBytesPerRowByte = 8;

}  // namespace

SentStream::SentStream(const ClientMeshOptions& settled)
    : options(settled),
      row_bytes(options.attributes.row_bytes()),
      max_updates(kMaxRecordBytes / 2 / (kMaxUpdateBytes + kMaxBytesPerRowByte * row_bytes)),
      mesh(options, false),
      models(options.attributes),
      cost(row_bytes) {}

uint32_t SentStream::TriangleOf(TriangleKey key) const {
  const uint32_t slot = triangles.Find(key);
  MTDB_CHECK(slot != kNone32, "an update names a triangle that the client does not have");
  return slot;
}

uint32_t SentStream::VertexOf(VertexIndex key) const {
  const uint32_t slot = vertices.Find(key);
  MTDB_CHECK(slot != kNone32, "an update names a vertex that the client does not have");
  return slot;
}

uint32_t SentStream::AddVertex(VertexIndex key, Vec3i position, const std::byte* row) {
  ++sent;
  cost.AddVertex();
  const uint32_t vertex = mesh.AddVertex(position, row);
  vertices.Put(key, vertex);
  return vertex;
}

void SentStream::MakeRoomOrEnd(uint64_t updates, ByteWriter& out) {
  if (record_updates + updates > kRecordUpdates) EndRecord(out);
  MakeRoom(updates, out);
}

void SentStream::MakeRoom(uint64_t updates, ByteWriter& out) {
  if (record_updates + updates > max_updates) EndRecord(out);
  record_updates += updates;
}

void SentStream::EndRecord(ByteWriter& out) {
  if (record_updates == 0) return;
  coder.Bit(models.more, false);
  PutRecord(out);
}

void SentStream::PutRecord(ByteWriter& out) {
  Bytes record = coder.Finish();
  if (record.size() < cost.bytes()) record.resize(cost.bytes());
  MTDB_CHECK(record.size() <= kMaxRecordBytes, "a record is longer than max_updates allows");
  cost = RecordCost(row_bytes);
  record_updates = 0;
  out.PutVarint(record.size());
  out.Put<uint32_t>(static_cast<uint32_t>(Hash64(record)));
  out.PutBytes(record);
}

}  // namespace mtdb::internal
