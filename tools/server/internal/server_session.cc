// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_session.h"

#include <algorithm>
#include <new>
#include <optional>
#include <string>
#include <utility>

#include "query/query_control.h"

namespace mtdb::internal {

namespace {

// A message takes whole batches until it has so many updates, some 10 KB.
constexpr uint64_t kMessageUpdates = 4096;
// Of a Session, for each triangle of the cut and each cluster of the object.
constexpr uint64_t kCutTriangleBytes = 24;
constexpr uint64_t kCutClusterBytes = 32;
// What coding an attribute takes.
constexpr uint64_t kAttributeBytes = 4096;
// What a triangle more takes of the encoder, and while the client is clipped: with the growth of
// its arrays. A vertex is half of one.
constexpr uint64_t kTriangleBytes = 280;
constexpr uint64_t kClippedTriangleBytes = 640;

}  // namespace

ServerSession::ServerSession(std::shared_ptr<const Surface> surface,
                             std::unique_ptr<Session> session, const BaseMesh& base,
                             const Options& options)
    : surface_(std::move(surface)),
      options_(options),
      session_(std::move(session)),
      encoder_({surface_->record().grid, surface_->record().attributes,
                static_cast<uint32_t>(options.remembered_vertices),
                surface_->record().raster.has_value() && !options.coded_holes},
               base),
      triangles_(base.triangles.size()) {}

Result<std::unique_ptr<ServerSession>> ServerSession::Open(std::shared_ptr<const Surface> surface,
                                                           const Options& options) {
  const uint64_t root = surface->record().root_triangles;
  if (root > options.max_triangles) {
    return InvalidArgument("the coarsest mesh has " + std::to_string(root) +
                           " triangles, but this session holds at most " +
                           std::to_string(options.max_triangles));
  }
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<Session> session, Session::Open(surface));
  MTDB_ASSIGN_OR_RETURN(const BaseMesh base, session->Base());
  const ObjectRecord& record = surface->record();
  const uint64_t start = UpdateEncoder::StartBytes({record.grid, record.attributes}, base);
  if (start > UpdateEncoder::kMaxStartBytes) {
    return InvalidArgument("the coarsest mesh takes " + std::to_string(start >> 20) +
                           " MiB with its attributes, but a session may start with at most " +
                           std::to_string(UpdateEncoder::kMaxStartBytes >> 20) +
                           "; ask for meshes instead");
  }
  return std::unique_ptr<ServerSession>(
      new ServerSession(std::move(surface), std::move(session), base, options));
}

SessionHello ServerSession::Hello() const {
  const ObjectRecord& record = surface_->record();
  SessionHello hello;
  hello.object = record.name;
  hello.triangles = record.triangles;
  hello.vertices = record.vertices;
  hello.diagonal = record.diagonal();
  hello.rounding_error = record.rounding_error;
  hello.double_positions = record.double_positions;
  hello.remembered_vertices = options_.remembered_vertices;
  hello.max_triangles = options_.max_triangles;
  return hello;
}

uint64_t ServerSession::TrianglesAfter(std::span<const UpdateBatch> batches) const {
  uint64_t triangles = triangles_;
  for (const UpdateBatch& batch : batches) {
    for (const UpdateBatch::Node& node : batch.nodes) {
      // A star has two triangles more than its hole, at a crease one.
      const uint32_t more = UpdateBatch::StarCount(node) - (node.ring_count - 2);
      triangles = batch.insert ? triangles + more : triangles - more;
    }
  }
  return triangles;
}

uint64_t ServerSession::memory_bytes() const {
  return encoder_.memory_bytes() + triangles_ * kCutTriangleBytes +
         surface_->index().cluster_count() * kCutClusterBytes +
         surface_->record().attributes.attributes.size() * kAttributeBytes;
}

uint64_t ServerSession::MemoryAfter(uint64_t triangles, bool clipped) const {
  const uint64_t row = surface_->record().attributes.row_bytes();
  const uint64_t each = clipped ? kClippedTriangleBytes + 2 * row : kTriangleBytes + row;
  // Clipped anew, all of the cut is kept a second time.
  const uint64_t more = clipped && !clipped_     ? triangles
                        : triangles > triangles_ ? triangles - triangles_
                                                 : 0;
  return memory_bytes() + more * each;
}

void ServerSession::Send(std::span<const UpdateBatch> batches, const MeetsRegion& region,
                         const Pace& pace) {
  sending_ = true;
  const auto send = [&](std::span<const UpdateBatch> some) {
    Bytes records = encoder_.Encode(some, region);
    if (!records.empty()) pace.send(std::move(records));
  };
  // The encoder looks at the whole cut each time that there is a region, or was one.
  if (std::exchange(clipped_, static_cast<bool>(region)) || region) {
    send(batches);
    sending_ = false;
    return;
  }
  size_t begin = 0;
  uint64_t updates = 0;
  for (size_t i = 0; i < batches.size(); ++i) {
    updates += batches[i].nodes.size();
    if (updates < kMessageUpdates && i + 1 < batches.size()) continue;
    send(batches.subspan(begin, i + 1 - begin));
    begin = i + 1;
    updates = 0;
  }
  sending_ = false;
}

Result<ServerSession::End> ServerSession::Update(const Query& query, const Pace& pace,
                                                 Progress* progress, SessionUpdate* update) {
  MeetsRegion region;
  if (query.clip && query.region != nullptr && !query.region->whole()) {
    region = [&query](const Triangle3d& t) { return query.region->Within(t, 0); };
  }
  bool sent = false;
  std::optional<End> stopped;
  const auto stop = [&](End end) {
    stopped = end;
    return Status(StatusCode::kCancelled, "stopped");
  };
  const auto take = [&](std::span<const UpdateBatch> batches) -> Status {
    if (progress->rounds > 0 && pace.superseded()) return stop(End::kSuperseded);
    const uint64_t triangles = TrianglesAfter(batches);
    if (triangles > std::max(triangles_, options_.max_triangles)) return stop(End::kTooLarge);
    if (!pace.may_take(MemoryAfter(triangles, static_cast<bool>(region)))) {
      return stop(End::kNoMemory);
    }
    Send(batches, region, pace);
    triangles_ = triangles;
    sent = true;
    pace.takes(memory_bytes());
    for (const UpdateBatch& batch : batches) {
      (batch.insert ? progress->insertions : progress->removals) += batch.updates();
    }
    ++progress->rounds;
    // What was taken stays: the search ends before the next round.
    if (pace.pause()) {
      stopped = End::kPaused;
      query.control->Cancel();
    }
    return Status::Ok();
  };
  Result<SessionUpdate> result = session_->Update(query, take);
  if (!result.ok()) {
    // Without memory amid a round the encoder knows another mesh than the client.
    if (sending_) throw std::bad_alloc();
    if (stopped && result.status().code() == StatusCode::kCancelled) return *stopped;
    return result.status();
  }
  if (!sent) {  // the region may be another
    if (!pace.may_take(MemoryAfter(triangles_, static_cast<bool>(region)))) return End::kNoMemory;
    Send({}, region, pace);
    pace.takes(memory_bytes());
  }
  *update = *result;
  if (region) update->stats.active_triangles = mesh().triangle_count();
  return End::kDone;
}

}  // namespace mtdb::internal
