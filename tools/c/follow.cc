// SPDX-License-Identifier: Apache-2.0
// Sessions, clients, and what a server is asked from C.
#include <algorithm>
#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "codecs/stream/update_stream.h"
#include "query/session.h"
#include "tools/c/internal/handles.h"
#include "tools/c/internal/mesh.h"
#include "tools/c/internal/watch.h"
#include "tools/c/mtdb_follow.h"
#include "tools/client/client.h"

// NOLINTBEGIN(readability-identifier-naming)
struct mtdb_session {
  std::shared_ptr<mtdb::Surface> surface;
  std::unique_ptr<mtdb::Session> session;
  std::unique_ptr<mtdb::UpdateEncoder> encoder;
  bool started = false;  // the stream's beginning was sent
  bool broken = false;   // the client lacks bytes
};
struct mtdb_client {
  std::unique_ptr<mtdb::UpdateDecoder> decoder;  // either this
  std::unique_ptr<mtdb::RemoteSession> remote;   // or this
  mtdb::ClientMesh::Changes changes;

  // Null before the stream's beginning.
  const mtdb::ClientMesh* mesh() const {
    if (remote != nullptr) return &remote->mesh();
    return decoder->started() ? &decoder->mesh() : nullptr;
  }
};
// NOLINTEND(readability-identifier-naming)

namespace mtdb::internal {

namespace {

// As the protocol names limits.
mtdb_limit LimitOf(const std::string& name) {
  if (name == "triangles") return MTDB_LIMIT_TRIANGLES;
  if (name == "bytes") return MTDB_LIMIT_BYTES;
  if (name == "time") return MTDB_LIMIT_TIME;
  return MTDB_LIMIT_ACCURACY;
}

// What RemoteUpdate and FetchAnswer share.
template <typename Answered>
mtdb_update UpdateOf(const Answered& a) {
  mtdb_update update{};
  update.triangles = a.triangles;
  update.vertices = a.vertices;
  update.active_triangles = a.active_triangles;
  update.error_bound = a.error_bound;
  update.limit = LimitOf(a.limit);
  PutShortfall(a.shortfall, &update);
  return update;
}

Status PutUpdate(const mtdb_update& filled, mtdb_update* update) {
  return update == nullptr ? Status::Ok() : PutStruct(filled, "update", update);
}

// Moves the session, and sends what its client is to read.
class Mover {
 public:
  Mover(mtdb_session* session, const Query& query, mtdb_receive receive, void* user)
      : session_(session), receive_(receive), user_(user) {
    if (query.clip && query.region != nullptr && !query.region->whole()) {
      region_ = [region = query.region](const Triangle3d& t) { return region->Within(t, 0); };
    }
  }

  Status Run(const Query& query, mtdb_update* update) {
    const auto begin = std::chrono::steady_clock::now();
    session_->broken = true;  // if it throws
    if (!session_->started) MTDB_RETURN_IF_ERROR(Pass(session_->encoder->start()));
    session_->started = true;
    Result<SessionUpdate> moved = session_->session->Update(
        query, [this](std::span<const UpdateBatch> batches) { return Send(batches); });
    if (stopped_) return moved.status();
    session_->broken = false;
    MTDB_RETURN_IF_ERROR(moved.status());
    session_->broken = true;
    if (!sent_) MTDB_RETURN_IF_ERROR(Send({}));  // the region may be another
    session_->broken = false;
    const ExtractStats& stats = moved->stats;
    update->triangles = stats.triangles;
    update->vertices = stats.vertices;
    update->active_triangles =
        region_ ? session_->encoder->mesh().triangle_count() : stats.active_triangles;
    update->insertions = moved->insertions;
    update->removals = moved->removals;
    update->bytes = bytes_;
    update->error_bound = stats.error_bound;
    update->milliseconds =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    update->limit = static_cast<mtdb_limit>(stats.limit);
    PutShortfall(stats.shortfall, update);
    return Status::Ok();
  }

 private:
  Status Send(std::span<const UpdateBatch> batches) {
    stopped_ = true;
    sent_ = true;
    MTDB_RETURN_IF_ERROR(Pass(session_->encoder->Encode(batches, region_)));
    stopped_ = false;
    return Status::Ok();
  }
  Status Pass(const Bytes& bytes) {
    if (bytes.empty()) return Status::Ok();
    bytes_ += bytes.size();
    return Receive(receive_, user_, bytes.data(), bytes.size());
  }

  mtdb_session* const session_;
  const mtdb_receive receive_;
  void* const user_;
  MeetsRegion region_;
  uint64_t bytes_ = 0;
  bool sent_ = false;
  bool stopped_ = false;  // amid a round
};

Result<mtdb_client_view> LookAt(const mtdb_client& client) {
  mtdb_client_view view{};
  const ClientMesh* const mesh = client.mesh();
  if (mesh == nullptr) return view;
  view.triangle_slots = mesh->triangle_slots();
  view.vertex_slots = mesh->vertex_slots();
  view.triangles = mesh->triangle_count();
  view.vertices = mesh->vertex_count();
  view.indices = mesh->indices().data();
  view.positions = mesh->positions().data();
  Put(mesh->origin(), view.origin);
  view.rows = reinterpret_cast<const unsigned char*>(mesh->rows().data());
  view.row_bytes = static_cast<uint32_t>(mesh->options().attributes.row_bytes());
  view.attributes = static_cast<uint32_t>(mesh->options().attributes.attributes.size());
  return view;
}

// Without the slots that hold nothing.
Result<std::unique_ptr<mtdb_mesh>> Compacted(const ClientMesh& client) {
  MeshHeader header;
  header.attributes = client.options().attributes;
  const Grid& grid = client.options().grid;
  if (grid.mode == PositionMode::kGrid) header.position_step = grid.step;
  header.vertex_count = client.vertex_count();
  header.triangle_count = client.triangle_count();
  MTDB_ASSIGN_OR_RETURN(auto mesh, MakeMesh(header, nullptr));
  std::vector<uint32_t> number(client.vertex_slots());
  uint32_t next = 0;
  for (uint32_t v = 0; v < client.vertex_slots(); ++v) {
    if (!client.has_vertex(v)) continue;
    Put(client.options().grid.Position(client.position(v)),
        mesh->positions.get() + size_t{3} * next);
    const ByteSpan row = client.row(v);
    if (!row.empty()) std::memcpy(mesh->rows.get() + next * row.size(), row.data(), row.size());
    number[v] = next++;
  }
  uint32_t* index = mesh->indices.get();
  for (uint32_t slot = 0; slot < client.triangle_slots(); ++slot) {
    if (!client.has_triangle(slot)) continue;
    for (const uint32_t corner : client.triangle(slot).corners) *index++ = number[corner];
  }
  return mesh;
}

}  // namespace
}  // namespace mtdb::internal

using mtdb::Result;
using mtdb::Status;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::Take;

mtdb_code mtdb_open_session(mtdb_object* object, const mtdb_session_options* options,
                            mtdb_session** session, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {session, "session"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_session_options given, Take(options, "options"));
    if (given.remembered_vertices > 1u << 24) {
      return mtdb::InvalidArgument("options.remembered_vertices: at most 2^24");
    }
    auto made = std::make_unique<mtdb_session>();
    made->surface = object->surface;
    MTDB_ASSIGN_OR_RETURN(made->session, mtdb::Session::Open(made->surface));
    MTDB_ASSIGN_OR_RETURN(const mtdb::BaseMesh base, made->session->Base());
    const mtdb::ObjectRecord& record = made->surface->record();
    const mtdb::ClientMeshOptions mesh{record.grid, record.attributes, given.remembered_vertices,
                                       record.raster.has_value() && given.coded_holes == 0};
    if (mtdb::UpdateEncoder::StartBytes(mesh, base) > mtdb::UpdateEncoder::kMaxStartBytes) {
      return mtdb::InvalidArgument(
          "the coarsest mesh is too large to start a stream with; use mtdb_select");
    }
    made->encoder = std::make_unique<mtdb::UpdateEncoder>(mesh, base);
    *session = made.release();
    return Status::Ok();
  });
}

void mtdb_free_session(mtdb_session* session) { delete session; }

mtdb_code mtdb_update_session(mtdb_session* session, const mtdb_query* query,
                              const mtdb_control* control, mtdb_receive receive, void* user,
                              mtdb_update* update, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{session, "session"}}));
    if (receive == nullptr) return mtdb::InvalidArgument("receive: is NULL");
    if (session->broken) {
      return mtdb::InvalidArgument("session: its client lacks bytes of it; open another");
    }
    mtdb::Query asked;
    if (query != nullptr) asked = query->query;
    asked.control = mtdb::internal::ControlOf(control);
    mtdb_update filled{};
    mtdb::internal::Mover mover(session, asked, receive, user);
    MTDB_RETURN_IF_ERROR(mover.Run(asked, &filled));
    return mtdb::internal::PutUpdate(filled, update);
  });
}

mtdb_code mtdb_create_client(const mtdb_client_options* options, mtdb_client** client,
                             mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{client, "client"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_client_options given, Take(options, "options"));
    mtdb::UpdateDecoder::Limits limits;
    if (given.max_triangles != 0) limits.triangles = given.max_triangles;
    if (given.max_vertices != 0) limits.vertices = given.max_vertices;
    auto made = std::make_unique<mtdb_client>();
    made->decoder = std::make_unique<mtdb::UpdateDecoder>(limits);
    *client = made.release();
    return Status::Ok();
  });
}

mtdb_code mtdb_feed_client(mtdb_client* client, const unsigned char* bytes, size_t size,
                           mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{client, "client"}}));
    if (client->decoder == nullptr) {
      return mtdb::InvalidArgument("client: is fed by its server; call mtdb_update_client");
    }
    if (size == 0) return Status::Ok();
    MTDB_RETURN_IF_ERROR(NeedAll({{bytes, "bytes"}}));
    return client->decoder->Feed({reinterpret_cast<const std::byte*>(bytes), size});
  });
}

mtdb_code mtdb_connect(const char* url, const mtdb_connect_options* options, mtdb_client** client,
                       mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{url, "url"}, {client, "client"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_connect_options given, Take(options, "options"));
    if (!(given.timeout_seconds >= 0) || !(given.reconnect_seconds >= 0)) {
      return mtdb::InvalidArgument("options: seconds that are negative or NaN");
    }
    mtdb::RemoteSessionOptions with;
    if (given.name != nullptr) with.name = given.name;
    if (given.remembered_vertices != 0) with.remembered_vertices = given.remembered_vertices;
    if (given.max_triangles != 0) with.max_triangles = given.max_triangles;
    if (given.timeout_seconds > 0) with.timeout_seconds = given.timeout_seconds;
    with.reconnect_seconds = given.reconnect_seconds;
    auto made = std::make_unique<mtdb_client>();
    MTDB_ASSIGN_OR_RETURN(made->remote, mtdb::RemoteSession::Open(url, with));
    *client = made.release();
    return Status::Ok();
  });
}

mtdb_code mtdb_update_client(mtdb_client* client, const char* json, const mtdb_watch* watch,
                             mtdb_update* update, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{client, "client"}, {json, "json"}}));
    if (client->remote == nullptr) {
      return mtdb::InvalidArgument("client: has no server; call mtdb_feed_client");
    }
    MTDB_ASSIGN_OR_RETURN(const auto watcher, mtdb::internal::Watch::Of(watch));
    MTDB_ASSIGN_OR_RETURN(
        const mtdb::RemoteUpdate answer,
        client->remote->Update(json, [&](uint64_t) { return watcher.Look("receive", -1); }));
    mtdb_update filled = mtdb::internal::UpdateOf(answer);
    filled.insertions = answer.insertions;
    filled.removals = answer.removals;
    filled.bytes = answer.bytes;
    filled.milliseconds = answer.done_ms;
    return mtdb::internal::PutUpdate(filled, update);
  });
}

void mtdb_free_client(mtdb_client* client) { delete client; }

mtdb_code mtdb_view_client(const mtdb_client* client, mtdb_client_view* view, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{client, "client"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_client_view filled, mtdb::internal::LookAt(*client));
    return mtdb::internal::PutStruct(filled, "view", view);
  });
}

mtdb_code mtdb_get_client_attribute(const mtdb_client* client, uint32_t i,
                                    mtdb_attribute* attribute, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{client, "client"}}));
    const mtdb::AttributeLayout none;
    const mtdb::ClientMesh* const mesh = client->mesh();
    return mtdb::internal::PutAttribute(mesh == nullptr ? none : mesh->options().attributes, i,
                                        attribute);
  });
}

mtdb_code mtdb_take_changes(mtdb_client* client, mtdb_changes* changes, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    static_assert(sizeof(mtdb::ClientMesh::Range) == 2 * sizeof(uint32_t));
    MTDB_RETURN_IF_ERROR(NeedAll({{client, "client"}, {changes, "changes"}}));
    client->changes = client->remote != nullptr   ? client->remote->TakeChanges()
                      : client->mesh() != nullptr ? client->decoder->TakeChanges()
                                                  : mtdb::ClientMesh::Changes{};
    const auto ranges = [](const std::vector<mtdb::ClientMesh::Range>& list) {
      return reinterpret_cast<const uint32_t*>(list.data());
    };
    mtdb_changes filled{};
    filled.triangles = ranges(client->changes.triangles);
    filled.triangle_ranges = client->changes.triangles.size();
    filled.vertices = ranges(client->changes.vertices);
    filled.vertex_ranges = client->changes.vertices.size();
    return mtdb::internal::PutStruct(filled, "changes", changes);
  });
}

mtdb_code mtdb_get_client_mesh(const mtdb_client* client, mtdb_mesh** mesh, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{client, "client"}, {mesh, "mesh"}}));
    const mtdb::ClientMesh* const held = client->mesh();
    if (held == nullptr) return mtdb::InvalidArgument("client: the stream has not begun");
    MTDB_ASSIGN_OR_RETURN(auto made, mtdb::internal::Compacted(*held));
    *mesh = made.release();
    return Status::Ok();
  });
}

mtdb_code mtdb_fetch(const char* url, const char* json, const mtdb_fetch_options* options,
                     mtdb_receive receive, void* user, mtdb_update* update, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{url, "url"}, {json, "json"}}));
    if (receive == nullptr) return mtdb::InvalidArgument("receive: is NULL");
    MTDB_ASSIGN_OR_RETURN(const mtdb_fetch_options given, Take(options, "options"));
    if (!(given.timeout_seconds >= 0)) {
      return mtdb::InvalidArgument("options.timeout_seconds: is negative or NaN");
    }
    mtdb::FetchOptions with;
    if (given.name != nullptr) with.name = given.name;
    if (given.format != nullptr) with.format = given.format;
    if (given.timeout_seconds > 0) with.timeout_seconds = given.timeout_seconds;
    MTDB_ASSIGN_OR_RETURN(const mtdb::FetchAnswer answer,
                          mtdb::FetchMesh(url, json, with, [&](std::string_view bytes) {
                            return mtdb::internal::Receive(receive, user, bytes.data(),
                                                           bytes.size());
                          }));
    mtdb_update filled = mtdb::internal::UpdateOf(answer);
    filled.bytes = answer.bytes_received;
    return mtdb::internal::PutUpdate(filled, update);
  });
}
