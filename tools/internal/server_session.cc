#include "tools/internal/server_session.h"

#include <optional>
#include <string>
#include <utility>

namespace mtdb {

namespace {

// A message takes whole batches until it has so many updates, some 10 KB.
constexpr uint64_t kMessageUpdates = 4096;

}  // namespace

ServerSession::ServerSession(std::shared_ptr<const Surface> surface,
                             std::unique_ptr<Session> session, const BaseMesh& base,
                             const Options& options)
    : surface_(std::move(surface)),
      options_(options),
      session_(std::move(session)),
      encoder_({surface_->record().grid, surface_->record().attributes,
                static_cast<uint32_t>(options.remembered_vertices)},
               base) {}

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
  hello.cell_error = record.grid.cell_error();
  hello.double_positions = record.double_positions;
  hello.remembered_vertices = options_.remembered_vertices;
  hello.max_triangles = options_.max_triangles;
  return hello;
}

bool ServerSession::Fits(std::span<const UpdateBatch> batches) const {
  uint64_t gained = 0, lost = 0;
  for (const UpdateBatch& batch : batches) {
    for (const UpdateBatch::Node& node : batch.nodes) {
      // A star has two triangles more than its hole, at the border one.
      (batch.insert ? gained : lost) += UpdateBatch::StarCount(node) - (node.ring_count - 2);
    }
  }
  return gained <= lost || mesh().triangle_count() + gained - lost <= options_.max_triangles;
}

void ServerSession::Send(std::span<const UpdateBatch> batches, const Pace& pace) {
  size_t begin = 0;
  uint64_t updates = 0;
  for (size_t i = 0; i < batches.size(); ++i) {
    updates += batches[i].nodes.size();
    if (updates < kMessageUpdates && i + 1 < batches.size()) continue;
    Bytes records = encoder_.Encode(batches.subspan(begin, i + 1 - begin));
    if (!records.empty()) pace.send(std::move(records));
    begin = i + 1;
    updates = 0;
  }
}

Result<ServerSession::End> ServerSession::Update(const Query& query, const Pace& pace,
                                                 Progress* progress, SessionUpdate* update) {
  std::optional<End> stopped;
  const auto stop = [&](End end) {
    stopped = end;
    return Status(StatusCode::kCancelled, "stopped");
  };
  const auto take = [&](std::span<const UpdateBatch> batches) -> Status {
    if (progress->rounds > 0 && pace.superseded()) return stop(End::kSuperseded);
    if (pace.full()) return stop(End::kPaused);
    if (!Fits(batches)) return stop(End::kTooLarge);
    Send(batches, pace);
    for (const UpdateBatch& batch : batches) {
      (batch.insert ? progress->insertions : progress->removals) += batch.nodes.size();
    }
    ++progress->rounds;
    return Status::Ok();
  };
  Result<SessionUpdate> result = session_->Update(query, take);
  if (stopped) return *stopped;
  if (!result.ok()) return result.status();
  *update = *result;
  return End::kDone;
}

}  // namespace mtdb
