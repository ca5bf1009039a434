// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_service.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <sys/stat.h>
#include <system_error>
#include <thread>
#include <unistd.h>

#include "codecs/mesh_file/mesh_file.h"
#include "query/query_from_json.h"
#include "query/query_json.h"
#include "store/base/wait_scope.h"
#include "store/files/posix_file.h"
#include "tools/client/shortfall_json.h"
#include "tools/request/arguments.h"
#include "tools/request/mesh_output.h"
#include "tools/request/report_json.h"
#include "tools/server/internal/server_diff.h"
#include "tools/server/internal/server_page.h"
#include "tools/tiles/tile_provider.h"

namespace mtdb::internal {

namespace {

// Of formats whose writers keep the whole mesh and more in memory.
constexpr uint64_t kMaxKeptTriangles = 2'000'000;
// A ClientMesh numbers half-edges, four a triangle, in 32 bits.
constexpr uint64_t kMaxSessionTriangles = uint64_t{1} << 28;

std::string Dump(const Json& json) { return json.Text(Json::Form::kLines) + "\n"; }

// Passes a mesh on, unless it is too large or nobody wants it any more.
class GuardedSink final : public MeshSink {
 public:
  GuardedSink(MeshSink& sink, const AnonymousFile& file, ServerCall& call, uint64_t max_triangles)
      : sink_(sink), file_(file), call_(call), max_triangles_(max_triangles) {}
  Status Begin(const MeshHeader& header) override {
    const uint64_t triangles = header.triangle_count.value_or(0);
    if (triangles > max_triangles_) {
      return InvalidArgument("the mesh would have " + std::to_string(triangles) +
                             " triangles, but this server sends at most " +
                             std::to_string(max_triangles_) +
                             " in this format; ask for less, or set max_triangles");
    }
    return sink_.Begin(header);
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    MTDB_RETURN_IF_ERROR(Check());
    return sink_.AddVertices(positions, rows);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    MTDB_RETURN_IF_ERROR(Check());
    return sink_.AddTriangles(triangles);
  }
  Status AddCorners(std::span<const TextureCorner> corners) override {
    return sink_.AddCorners(corners);
  }
  Status End() override {
    MTDB_RETURN_IF_ERROR(Check());
    MTDB_RETURN_IF_ERROR(sink_.End());
    return Check();
  }
  double LargestRounding(const MeshHeader& header) const override {
    return sink_.LargestRounding(header);
  }
  double rounding() const override { return sink_.rounding(); }

 private:
  // What was written is counted, a block behind.
  Status Check() {
    if (!call_.temporary->Set(file_.size_bytes())) call_.Cancel(ServerCall::Stop::kNoRoom);
    return call_.control.cancelled() ? Status(StatusCode::kCancelled, "cancelled") : Status::Ok();
  }
  MeshSink& sink_;
  const AnonymousFile& file_;
  ServerCall& call_;
  const uint64_t max_triangles_;
};

void AddStats(const ExtractStats& stats, ServerAnswer* answer) {
  char bound[32];
  std::snprintf(bound, sizeof(bound), "%.17g", stats.error_bound);
  answer->headers.insert(answer->headers.end(),
                         {{"X-Mtdb-Triangles", std::to_string(stats.triangles)},
                          {"X-Mtdb-Vertices", std::to_string(stats.vertices)},
                          {"X-Mtdb-Active-Triangles", std::to_string(stats.active_triangles)},
                          {"X-Mtdb-Error-Bound", bound},
                          {"X-Mtdb-Shortfall", ShortfallJson(stats.shortfall).Text()},
                          {"X-Mtdb-Limit", LimitName(stats.limit)},
                          {"X-Mtdb-Clusters-Read", std::to_string(stats.clusters_read)},
                          {"X-Mtdb-Clusters-Cached", std::to_string(stats.clusters_cached)},
                          {"X-Mtdb-Clusters-Total", std::to_string(stats.clusters_total)},
                          {"X-Mtdb-Bytes-Read", std::to_string(stats.bytes_read)}});
}

// `text` with every `place` (a path) replaced by `word`.
std::string Replaced(std::string text, const std::string& place, const std::string& word) {
  for (size_t at = 0; (at = text.find(place, at)) != std::string::npos; at += word.size()) {
    text.replace(at, place.size(), word);
  }
  return text;
}

// The limits that a session's client states: it may hold less than the server gives.
Status ReadSessionParameters(const RequestTarget& target, ServerSession::Options* options) {
  const uint64_t most = options->max_triangles;
  for (const auto& [name, text] : target.parameters) {
    if (name == "holes") {
      if (text != "coded" && text != "computed") {
        return InvalidArgument("holes: " + text + ": neither coded nor computed");
      }
      options->coded_holes = text == "coded";
      continue;
    }
    if (name != "remember" && name != "triangles") {
      return InvalidArgument(name + ": no such parameter; known are remember, triangles and holes");
    }
    const Result<uint64_t> count = text == "0" ? Result<uint64_t>(uint64_t{0}) : ParseCount(text);
    if (!count.ok()) return InvalidArgument(name + ": " + count.status().message());
    (name == "remember" ? options->remembered_vertices : options->max_triangles) =
        std::min(*count, most);
  }
  return Status::Ok();
}

// Small parts in memory, others in a temporary file. `read(range)` gives bytes.
template <typename Read>
Status FillAnswer(const Read& read, ByteRange range, const std::string& folder, ServerCall& call,
                  ServerAnswer* answer) {
  constexpr uint64_t kBlock = uint64_t{1} << 20;
  const uint64_t end = range.offset + range.bytes;
  for (uint64_t at = range.offset; at < end;) {
    if (call.control.cancelled()) return {StatusCode::kCancelled, "cancelled"};
    MTDB_ASSIGN_OR_RETURN(const Bytes block, read(ByteRange{at, std::min(kBlock, end - at)}));
    if (range.bytes <= kBlock) {
      answer->body.assign(reinterpret_cast<const char*>(block.data()), block.size());
      return Status::Ok();
    }
    if (!answer->file.is_open()) {
      MTDB_ASSIGN_OR_RETURN(answer->file, AnonymousFile::Create(folder));
    }
    if (!call.temporary->Set(at - range.offset + block.size())) {
      call.Cancel(ServerCall::Stop::kNoRoom);
      continue;
    }
    if (!WriteFully(answer->file.descriptor(), at - range.offset, block.data(), block.size())) {
      return errno == ENOSPC ? Status(StatusCode::kNoSpace, "no space for a temporary file")
                             : Status(StatusCode::kIoError, "a temporary file cannot be written");
    }
    at += block.size();
  }
  return Status::Ok();
}

// How an answer of a part of a file of `size` bytes begins; 416 is whole.
ServerAnswer RangeAnswer(unsigned status, ByteRange range, uint64_t size) {
  const std::string of_size = "/" + std::to_string(size);
  if (status == 416) {
    ServerAnswer answer =
        ErrorAnswer(416, "bad_query", "range: the file has " + std::to_string(size) + " bytes");
    answer.headers.emplace_back("Content-Range", "bytes *" + of_size);
    return answer;
  }
  ServerAnswer answer;
  answer.status = status;
  answer.content_type = "application/octet-stream";
  answer.headers.emplace_back("Accept-Ranges", "bytes");
  if (status == 206) {
    answer.headers.emplace_back("Content-Range",
                                "bytes " + std::to_string(range.offset) + "-" +
                                    std::to_string(range.offset + range.bytes - 1) + of_size);
  }
  return answer;
}

ServerError NoMemory() { return {503, "no_space", "the server is out of memory; try again later"}; }

ServerAnswer NoSuchPath() {
  return ErrorAnswer(
      404, "no_such_path",
      "there are /, /objects, /objects/NAME, /objects/NAME/mesh, /objects/NAME/packed, "
      "/objects/NAME/probe, /objects/NAME/session, /objects/NAME/3dtiles/tileset.json, "
      "/objects/NAME/quantized-mesh/layer.json, /objects/NAME/terrain-rgb/tiles.json, "
      "/objects/NAME/neuroglancer/info, /diff, /healthz and /metrics");
}

ServerAnswer NoSuchTile(const TileTarget& tile, const std::string& name) {
  return ErrorAnswer(404, "no_such_tile",
                     "the " + tile.choice.format + " tiles of '" + name + "' have no file '" +
                         tile.file + "'; " + FirstFileOf(tile.choice) + " names those there are");
}

}  // namespace

// ---- answers --------------------------------------------------------------------------

ServerAnswer ErrorAnswer(const ServerError& error) {
  ServerAnswer answer;
  answer.status = error.status;
  answer.body = Dump({{"error", error.message}, {"code", error.code}});
  if (error.status == 503) answer.headers.emplace_back("Retry-After", "1");
  return answer;
}

// ---- the service --------------------------------------------------------------------------------

Result<std::unique_ptr<ServerService>> ServerService::Open(const ServiceOptions& options) {
  std::unique_ptr<ServerService> service(new ServerService(options));
  std::error_code error;
  // A whole path, so that Failure finds it in messages, and nothing that only looks like it.
  const std::filesystem::path store = std::filesystem::absolute(options.store, error);
  const bool as_given = error || Database::IsUrl(options.store);
  service->store_ = as_given ? options.store : store.string();
  service->is_remote_ = Database::IsUrl(options.store);
  MTDB_ASSIGN_OR_RETURN(service->database_, Database::Open(service->store_, options.open));
  service->folder_ =
      options.tmp.empty() ? std::filesystem::temp_directory_path(error).string() : options.tmp;
  AnonymousFile::Sweep(service->folder_);
  const Result<AnonymousFile> tried = AnonymousFile::Create(service->folder_);
  if (!tried.ok()) {
    return Status(tried.status().code(), tried.status().message() + "; choose another with --tmp");
  }
  return service;
}

// What a thread of its own finds out, which may outlive the service.
struct ServerService::Reopening {
  std::mutex mutex;
  std::condition_variable done;
  std::optional<Result<std::shared_ptr<Database>>> opened;
};

void ServerService::AdoptReopened(Result<std::shared_ptr<Database>> opened,
                                  std::vector<std::shared_ptr<Surface>>* closed) {
  // Where there is no store now, what was open is served on.
  if (!opened.ok()) return;
  database_ = *std::move(opened);
  // Surfaces of the old file may be equal to those of the new one, but may not find their bytes.
  const std::lock_guard surfaces_lock(mutex_);
  for (const auto& surface : surfaces_) decoded_before_ += surface->cache_use().decoded;
  closed->swap(surfaces_);
  images_.Clear();  // likewise
}

std::shared_ptr<Database> ServerService::CurrentDatabase() {
  std::vector<std::shared_ptr<Surface>> closed;  // after the locks
  std::unique_lock lock(database_mutex_);
  if (!is_remote_) {
    if (database_->IsOutdated())
      AdoptReopened(Database::Open(store_, database_->options()), &closed);
    return database_;
  }
  const bool first = reopening_ == nullptr && database_->IsOutdated();
  if (first) {
    const auto reopening = std::make_shared<Reopening>();
    try {
      std::thread([reopening, store = store_, options = database_->options()] {
        auto opened = Database::Open(store, options);
        const std::lock_guard guard(reopening->mutex);
        reopening->opened.emplace(std::move(opened));
        reopening->done.notify_all();
      }).detach();
    } catch (const std::system_error&) {
      return database_;
    }
    reopening_ = reopening;
  }
  const std::shared_ptr<Reopening> reopening = reopening_;
  if (reopening == nullptr) return database_;
  lock.unlock();
  // Most servers answer at once. Others than who asked first do not wait.
  constexpr auto kPatience = std::chrono::seconds(1);
  std::unique_lock reopening_lock(reopening->mutex);
  if (first) {
    reopening->done.wait_for(reopening_lock, kPatience,
                             [&] { return reopening->opened.has_value(); });
  }
  const bool done = reopening->opened.has_value();
  reopening_lock.unlock();
  lock.lock();
  if (done && reopening_ == reopening) {
    AdoptReopened(*std::move(reopening->opened), &closed);
    reopening_.reset();
  }
  return database_;
}

ServerService::Effort ServerService::EffortOf(const std::string& text) const {
  const Result<RequestTarget> target = ParseTarget(text);
  if (target.ok() && IsDiff(*target)) return Effort::kQuery;
  if (!target.ok() || target->path[0] != "objects") return Effort::kNone;
  if (IsTileTarget(*target)) return Effort::kQuery;
  const bool packed = target->path.size() == 3 && target->path[2] == "packed";
  if (packed && is_remote_) return Effort::kUpstream;
  return target->path.size() == 3 && target->path[2] != "packed" ? Effort::kQuery
                                                                 : Effort::kCatalog;
}

ServerAnswer ServerService::Answer(const ServerRequest& request, ServerCall& call) {
  const WaitScope scope([&call] { return call.control.cancelled(); });
  try {
    return Route(request, call);
  } catch (const std::bad_alloc&) {
    return ErrorAnswer(NoMemory());
  } catch (const std::system_error&) {  // no thread
    return ErrorAnswer(NoMemory());
  }
}

ServerAnswer ServerService::Route(const ServerRequest& request, ServerCall& call) {
  const Result<RequestTarget> target = ParseTarget(request.target);
  if (!target.ok()) return ErrorAnswer(400, "bad_request", target.status().message());
  const std::vector<std::string>& path = target->path;
  const bool objects = path[0] == "objects" && path.size() <= 3;
  if (IsSession(request.target)) {
    ServerAnswer answer =
        ErrorAnswer(426, "upgrade_required",
                    "sessions speak WebSocket: ask for an upgrade; see docs/protocol.md");
    answer.headers.emplace_back("Upgrade", "websocket");
    return answer;
  }
  if (IsTileTarget(*target)) return TileAnswer(*target, request, call);
  if (IsDiff(*target)) return Diff(request, call);
  const bool mesh = objects && path.size() == 3 && path[2] == "mesh";
  const bool probe = objects && path.size() == 3 && path[2] == "probe";
  const bool packed = objects && path.size() == 3 && path[2] == "packed";
  const bool alone = path.size() == 1 && (path[0] == "healthz" || path[0] == "metrics");
  const bool page = path.size() == 1 && IsPagePath(path[0], options_.files);
  if (!alone && !page && !mesh && !probe && !packed && !(objects && path.size() < 3)) {
    return NoSuchPath();
  }
  const bool reads = request.method == "GET" || request.method == "HEAD";
  if (!reads && !(mesh && request.method == "POST")) {
    ServerAnswer answer = ErrorAnswer(405, "method_not_allowed",
                                      mesh ? "expected GET, HEAD or POST" : "expected GET or HEAD");
    answer.headers.emplace_back("Allow", mesh ? "GET, HEAD, POST" : "GET, HEAD");
    return answer;
  }
  if (page) return PageAnswer(path[0], options_.files);
  if (alone && path[0] == "metrics") return Metrics();
  if (alone) {
    ServerAnswer answer;
    answer.body = Dump({{"status", "ok"}});
    return answer;
  }
  const std::string name = path.size() > 1 ? path[1] : "";
  if (path.size() > 1 && name.empty()) return NoSuchPath();
  if (probe) {
    const Result<ProbeRequest> parsed = ParseProbeRequest(*target);
    if (!parsed.ok()) return ErrorAnswer(400, "bad_query", parsed.status().message());
    Result<ServerAnswer> answer = Probe(name, *parsed, call);
    return answer.ok() ? *std::move(answer)
                       : ErrorAnswer(Failure(answer.status(), name, call, false));
  }
  if (!mesh) {
    Result<ServerAnswer> answer = packed             ? Packed(*target, request, call)
                                  : path.size() == 1 ? Catalog()
                                                     : Info(name);
    return answer.ok() ? *std::move(answer)
                       : ErrorAnswer(Failure(answer.status(), name, call, false));
  }
  const Result<MeshRequest> parsed = ParseMeshRequest(*target, request.body);
  if (!parsed.ok()) return ErrorAnswer(400, "bad_query", parsed.status().message());
  Result<ServerAnswer> answer = Mesh(name, *parsed, call);
  if (answer.ok()) return *std::move(answer);
  // Found in the catalog, then gone.
  const bool opened = call.control.clusters_loaded() > 0;
  return ErrorAnswer(Failure(answer.status(), name, call, opened));
}

Result<ServerAnswer> ServerService::Catalog() {
  MTDB_ASSIGN_OR_RETURN(const std::vector<ObjectRecord> records, CurrentDatabase()->List());
  ServerAnswer answer;
  answer.body = Dump(CatalogJson(records));
  return answer;
}

Result<ServerAnswer> ServerService::Info(const std::string& name) {
  const std::shared_ptr<Database> database = CurrentDatabase();
  MTDB_ASSIGN_OR_RETURN(const ObjectRecord record, database->Find(name));
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, database->FileBytes());
  ServerAnswer answer;
  answer.body = Dump(RecordJson(record, file_bytes));
  return answer;
}

Result<ServerAnswer> ServerService::Mesh(const std::string& name, const MeshRequest& request,
                                         ServerCall& call) {
  if (call.control.cancelled()) return Status(StatusCode::kCancelled, "cancelled");
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenSurface(name));
  MTDB_ASSIGN_OR_RETURN(Query query, QueryFromJson(request.query, surface->record()));
  query.control = &call.control;
  ServerAnswer answer;
  MTDB_ASSIGN_OR_RETURN(answer.file, AnonymousFile::Create(folder_));
  MeshWriteOptions write = MeshOptionsOf(surface->record(), query.normals);
  write.double_positions = request.double_positions;
  write.descriptor = answer.file.descriptor();
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<MeshFileWriter> writer,
                        CreateMeshFileWriter("the mesh." + request.format, write));
  MTDB_ASSIGN_OR_RETURN(const MeshFormat format, FindWrittenMeshFormat(request.format));
  const uint64_t most = format.keeps_mesh ? std::min(options_.max_triangles, kMaxKeptTriangles)
                                          : options_.max_triangles;
  GuardedSink sink(*writer, answer.file, call, most);
  ++metrics_.queries;
  MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, surface->Extract(query, sink));
  metrics_.read_bytes += stats.bytes_read;
  metrics_.cache_hits += stats.clusters_cached;
  answer.content_type = format.content_type;
  answer.triangles = stats.triangles;
  AddStats(stats, &answer);
  answer.headers.emplace_back("X-Mtdb-File",
                              MeshFileJson(writer->report()).Text(Json::Form::kAscii));
  return answer;
}

Result<ServerAnswer> ServerService::Probe(const std::string& name, const ProbeRequest& request,
                                          ServerCall& call) {
  if (call.control.cancelled()) return Status(StatusCode::kCancelled, "cancelled");
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenSurface(name));
  ProbeOptions options = request.options;
  options.error_model = ErrorModelOf(request.error, surface->record().diagonal());
  options.control = &call.control;
  ++metrics_.queries;
  MTDB_ASSIGN_OR_RETURN(
      const ProbeAnswer found,
      request.ray ? CastRay(*surface, request.ray->origin, request.ray->direction, options)
                  : FindClosestPoint(*surface, *request.point, options));
  metrics_.read_bytes += found.bytes_read;
  ServerAnswer answer;
  answer.body = Dump(ProbeJson(surface->record(), found, request.ray.has_value()));
  return answer;
}

ServerAnswer ServerService::Diff(const ServerRequest& request, ServerCall& call) {
  if (request.method != "POST") {
    ServerAnswer answer = ErrorAnswer(405, "method_not_allowed", "expected POST");
    answer.headers.emplace_back("Allow", "POST");
    return answer;
  }
  const Result<NamedComparison> asked = ParseComparison(request.body);
  if (!asked.ok()) return ErrorAnswer(400, "bad_query", "body: " + asked.status().message());
  if (call.control.cancelled()) return ErrorAnswer(Stopped(call));
  const Result<std::shared_ptr<Surface>> a = OpenSurface(asked->object);
  if (!a.ok()) return ErrorAnswer(Failure(a.status(), asked->object, call, false));
  const Result<std::shared_ptr<Surface>> b = OpenSurface(asked->other);
  if (!b.ok()) return ErrorAnswer(Failure(b.status(), asked->other, call, false));
  ++metrics_.queries;
  const Result<Json> found =
      CompareForClient(**a, **b, asked->request, &call.control, call.memory.get());
  if (!found.ok()) {
    const std::string both = asked->object + "' or '" + asked->other;
    return ErrorAnswer(Failure(found.status(), both, call, true));
  }
  metrics_.read_bytes += (*found)["bytes_read"].number();
  ServerAnswer answer;
  answer.body = Dump(*found);
  return answer;
}

Result<ServerAnswer> ServerService::Packed(const RequestTarget& target,
                                           const ServerRequest& request, ServerCall& call) {
  PackedRequest asked{request.range, request.if_range, ""};
  for (const auto& [name, value] : target.parameters) {
    if (name != "hash") return InvalidArgument(name + ": no such parameter; known is hash");
    asked.hash = value;
  }
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<const PackedImage> image,
                        images_.Open(*CurrentDatabase(), target.path[1]));
  const RangedPart part = FindPackedPart(*image, asked);
  if (part.status == 412) {
    return ErrorAnswer(412, "gone", "the object '" + target.path[1] + "' was replaced meanwhile");
  }
  ServerAnswer answer = RangeAnswer(part.status, part.range, image->size());
  if (part.status == 416) return answer;
  // What a URL with the hash gives never changes.
  answer.headers.emplace_back("ETag", '"' + image->content_hash() + '"');
  answer.headers.emplace_back(
      "Cache-Control", asked.hash.empty() ? "no-store" : "private, max-age=31536000, immutable");
  const auto read = [&](ByteRange range) { return image->Read(range); };
  MTDB_RETURN_IF_ERROR(FillAnswer(read, part.range, folder_, call, &answer));
  return answer;
}

ServerAnswer ServerService::TileAnswer(const RequestTarget& target, const ServerRequest& request,
                                       ServerCall& call) {
  ServerAnswer answer;
  if (request.method == "OPTIONS") {  // what a browser asks before it asks for more than GET
    answer.status = 204;
    answer.headers = {{"Access-Control-Allow-Methods", "GET, HEAD"},
                      {"Access-Control-Allow-Headers", "*"},
                      {"Access-Control-Max-Age", "600"}};
  } else if (request.method != "GET" && request.method != "HEAD") {
    answer = ErrorAnswer(405, "method_not_allowed", "expected GET or HEAD");
    answer.headers.emplace_back("Allow", "GET, HEAD, OPTIONS");
  } else {
    Result<ServerAnswer> tile = Tile(target, request, call);
    const bool opened = call.control.clusters_loaded() > 0;
    answer = tile.ok() ? *std::move(tile)
                       : ErrorAnswer(Failure(tile.status(), target.path[1], call, opened));
  }
  answer.for_pages = true;
  return answer;
}

Result<ServerAnswer> ServerService::Tile(const RequestTarget& target, const ServerRequest& request,
                                         ServerCall& call) {
  if (call.control.cancelled()) return Status(StatusCode::kCancelled, "cancelled");
  MTDB_ASSIGN_OR_RETURN(const TileTarget tile, ParseTileTarget(target));
  const std::string& name = target.path[1];
  MTDB_ASSIGN_OR_RETURN(const ObjectRecord record, CurrentDatabase()->Find(name));
  MTDB_ASSIGN_OR_RETURN(const Json identity, TileIdentityOf(tile.choice, record));
  const std::string name_of_tree =
      record.digest_hex() + ' ' + tile.choice.format + ' ' + identity.Text() + ' ' + name;
  const std::string tag = TileTag(record, name_of_tree, tile.file);
  const auto make = [&]() -> Result<std::unique_ptr<TileFiles>> {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenSurface(name));
    if (!IsSameObject(surface->record(), record)) return NotFound("replaced meanwhile");
    ++metrics_.queries;
    return MakeTileFiles(
        tile.choice, *surface,
        {folder_, &call.control, std::min(options_.max_triangles, kMaxKeptTriangles)});
  };
  ServerAnswer answer;
  if (HasTag(request.if_none_match, tag)) {
    answer.status = 304;
  } else {
    MTDB_ASSIGN_OR_RETURN(const ServedTiles::Tree tree,
                          tiles_.Open(name_of_tree, TileProviderBytes(record.triangles), make));
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<const TileContent> content, tree->Find(tile.file));
    if (content == nullptr) return NoSuchTile(tile, name);
    const bool is_part = request.if_range.empty() || request.if_range == tag;
    const RangedPart part = FindPart(is_part ? request.range : "", content->size());
    answer = RangeAnswer(part.status, part.range, content->size());
    if (part.status == 416) return answer;
    answer.content_type = TileContentType(tile.file);
    const auto read = [&](ByteRange range) { return content->Read(range); };
    MTDB_RETURN_IF_ERROR(FillAnswer(read, part.range, folder_, call, &answer));
  }
  // What a URL with the object's version gives never changes.
  answer.headers.emplace_back("ETag", tag);
  answer.headers.emplace_back("Cache-Control", tile.version == record.digest_hex()
                                                   ? "private, max-age=31536000, immutable"
                                                   : "no-cache");
  return answer;
}

ServerAnswer ServerService::Metrics() {
  ServerMetrics::Cache cache;
  {
    const std::lock_guard lock(mutex_);
    cache.objects_open = surfaces_.size();
    cache.decoded = decoded_before_;
    for (const auto& surface : surfaces_) {
      const Surface::CacheUse use = surface->cache_use();
      cache.bytes += use.bytes;
      cache.decoded += use.decoded;
    }
  }
  ServerAnswer answer;
  answer.content_type = "text/plain; version=0.0.4";
  const auto figures = [](const ServerLedger& ledger) {
    return ServerMetrics::Shared{ledger.bytes(), ledger.limit(), ledger.evictions()};
  };
  answer.body =
      metrics_.Text(cache, figures(temporary_), figures(session_memory_), tiles_.figures());
  return answer;
}

ServerError ServerService::Failure(const Status& status, const std::string& name,
                                   const ServerCall& call, bool opened) {
  std::string text = Replaced(status.message(), folder_ + ": ", "");
  const std::string store = CurrentDatabase()->path();
  text = Replaced(Replaced(text, store + ": ", ""), store, "the store");
  switch (status.code()) {
    case StatusCode::kInvalidArgument:
    case StatusCode::kUnsupported: return ServerError{400, "bad_query", text};
    case StatusCode::kNotFound:
      if (opened) {
        return ServerError{410, "gone",
                           "the object '" + name + "' was removed or replaced meanwhile"};
      }
      return ServerError{404, "no_such_object", "no object '" + name + "'; see /objects"};
    case StatusCode::kCancelled: break;
    case StatusCode::kNotYet:
      return ServerError{503, "not_yet", "the coarsest mesh is on its way; ask again"};
    case StatusCode::kBudgetExceeded:
      return ServerError{503, "budget_exceeded",
                         "the query does not fit the cache or its max_bytes: " + text};
    default: {
      std::fprintf(stderr, "mtdb: %s\n", status.message().c_str());
      if (status.code() == StatusCode::kNoSpace || status.code() == StatusCode::kBusy) {
        return ServerError{503, "no_space", "the server is short of space; try again later"};
      }
      return ServerError{500, "store_error",
                         "the object cannot be read; whoever runs the server finds the reason "
                         "in what it printed"};
    }
  }
  return Stopped(call);
}

ServerError ServerService::Stopped(const ServerCall& call) {
  const ServerCall::Stop why = call.stop;
  if (why == ServerCall::Stop::kPreempted) return ServerError{ServerError::kPreempted, "", ""};
  if (why != ServerCall::Stop::kSuperseded) ++metrics_.queries_cancelled;
  switch (why) {
    case ServerCall::Stop::kTimeout:
      return ServerError{503, "timeout",
                         "the time for a request is over; ask for less, or set max_milliseconds"};
    case ServerCall::Stop::kShutdown:
      return ServerError{503, "shutting_down", "the server is shutting down"};
    case ServerCall::Stop::kNoRoom:
      return ServerError{503, "no_temporary_space",
                         "answers under way take all of the " + std::to_string(temporary_.limit()) +
                             " bytes that they may (--max-tmp); try again later, or ask for less"};
    default: return ServerError{499, "cancelled", "the client went away"};
  }
}

ServerError ServerService::NoSessionMemory() const {
  return {503, "no_session_memory",
          "sessions take all of the " + std::to_string(session_memory_.limit()) +
              " bytes that they may (--session-memory); try again later, or ask for less"};
}

// ---- sessions -----------------------------------------------------------------------------------

bool ServerService::IsSession(const std::string& text) {
  const Result<RequestTarget> target = ParseTarget(text);
  return target.ok() && target->path.size() == 3 && target->path[0] == "objects" &&
         !target->path[1].empty() && target->path[2] == "session";
}

ServerService::OpenedSession::~OpenedSession() {
  if (surface != nullptr) service->Unpin(surface.get());
}

std::unique_ptr<ServerService::OpenedSession> ServerService::OpenSession(const std::string& text,
                                                                         const ServerClient& client,
                                                                         ServerCall& call,
                                                                         ServerAnswer* refusal) {
  const WaitScope scope([&call] { return call.control.cancelled(); });
  const Result<RequestTarget> target = ParseTarget(text);
  MTDB_CHECK(target.ok(), "IsSession has looked at it");
  ServerSession::Options options;
  options.max_triangles = std::min(options_.session_triangles, kMaxSessionTriangles);
  auto opened = std::make_unique<OpenedSession>();
  opened->service = this;
  const auto open = [&]() -> Status {
    MTDB_RETURN_IF_ERROR(ReadSessionParameters(*target, &options));
    MTDB_ASSIGN_OR_RETURN(std::shared_ptr<Surface> surface, OpenSurface(target->path[1]));
    if (!Pin(surface.get())) return Status::Ok();
    opened->surface = std::move(surface);
    MTDB_ASSIGN_OR_RETURN(opened->session, ServerSession::Open(opened->surface, options));
    opened->memory = std::make_unique<ServerLedger::Account>(session_memory_, client);
    return Status::Ok();
  };
  try {
    const Status status = open();
    if (!status.ok()) {
      *refusal = ErrorAnswer(Failure(status, target->path[1], call, false));
    } else if (opened->surface == nullptr) {
      *refusal = ErrorAnswer(503, "too_many_objects",
                             "sessions are open on as many objects as the server keeps open; try "
                             "again later");
    } else if (!opened->memory->Set(opened->session->memory_bytes())) {
      *refusal = ErrorAnswer(NoSessionMemory());
    } else {
      return opened;
    }
  } catch (const std::bad_alloc&) {
    *refusal = ErrorAnswer(NoMemory());
  } catch (const std::system_error&) {
    *refusal = ErrorAnswer(NoMemory());
  }
  return nullptr;
}

ServerService::SessionOutcome ServerService::Update(OpenedSession& opened,
                                                    const SessionRequest& request,
                                                    ServerSession::Pace pace, ServerCall& call,
                                                    ServerSession::Progress* progress) {
  const WaitScope scope([&call] { return call.control.cancelled(); });
  ServerSession& session = *opened.session;
  const ObjectRecord& record = session.surface().record();
  pace.may_take = [&](uint64_t bytes) { return opened.memory->Set(bytes); };
  pace.takes = [&](uint64_t bytes) { opened.memory->Note(bytes); };
  SessionOutcome outcome;
  const auto update = [&]() -> Result<ServerSession::End> {
    if (call.control.cancelled()) return Status(StatusCode::kCancelled, "cancelled");
    MTDB_ASSIGN_OR_RETURN(Query query, ParseQuery(request.query, record));
    if (query.normals) {
      return InvalidArgument("normals: a session's client makes them itself; leave it out");
    }
    query.control = &call.control;
    return session.Update(query, pace, progress, &outcome.update);
  };
  try {
    const Result<ServerSession::End> end = update();
    metrics_.read_bytes += outcome.update.stats.bytes_read;
    metrics_.cache_hits += outcome.update.stats.clusters_cached;
    const bool too_large =
        end.ok() ? *end == ServerSession::End::kTooLarge : call.stop == ServerCall::Stop::kTooLarge;
    if (too_large) {
      outcome.error = {400, "too_many_triangles",
                       "the mesh would have more than the " +
                           std::to_string(session.max_triangles()) +
                           " triangles that this session holds; ask for less, or set "
                           "max_triangles"};
    } else if (end.ok() && *end == ServerSession::End::kNoMemory) {
      outcome.error = NoSessionMemory();
    } else if (end.ok()) {
      outcome.end = *end;
    } else {
      outcome.error = Failure(end.status(), record.name, call, true);
    }
  } catch (const std::exception&) {  // no memory, no thread
    outcome.broken = true;           // somewhere between two updates
    outcome.error = NoMemory();
  }
  return outcome;
}

// ---- open objects -------------------------------------------------------------------------------

// Sessions keep what they use open, on no more objects than may be open.
bool ServerService::Pin(const Surface* surface) {
  const std::lock_guard lock(mutex_);
  if (!pins_.contains(surface) && pins_.size() >= options_.objects) return false;
  ++pins_[surface];
  return true;
}

void ServerService::Unpin(const Surface* surface) {
  const std::lock_guard lock(mutex_);
  if (--pins_[surface] == 0) pins_.erase(surface);
}

// Null when it is not open.
std::shared_ptr<Surface> ServerService::FindOpen(const ObjectRecord& record) {
  const std::lock_guard lock(mutex_);
  for (auto at = surfaces_.begin(); at != surfaces_.end(); ++at) {
    if ((*at)->record().name != record.name || !IsSameObject((*at)->record(), record)) continue;
    std::rotate(at, at + 1, surfaces_.end());
    return surfaces_.back();
  }
  return nullptr;
}

Result<std::shared_ptr<Surface>> ServerService::OpenSurface(const std::string& name) {
  const std::shared_ptr<Database> database = CurrentDatabase();
  MTDB_ASSIGN_OR_RETURN(const ObjectRecord record, database->Find(name));
  if (std::shared_ptr<Surface> surface = FindOpen(record)) return surface;
  MTDB_ASSIGN_OR_RETURN(const NamedLocks::Held opening, opening_.Take(name));
  if (std::shared_ptr<Surface> surface = FindOpen(record)) return surface;
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source, database->OpenObject(name));
  SurfaceOptions surface_options;
  surface_options.cache_bytes = options_.cache_bytes;
  surface_options.threads = options_.threads;
  surface_options.tmp_directory = options_.tmp;
  surface_options.spill_bytes = std::min(surface_options.spill_bytes, options_.temporary_bytes);
  if (options_.implicit) surface_options.form = RuntimeForm::kImplicit;
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<Surface> surface,
                        Surface::Open(std::move(source), surface_options));
  std::vector<std::shared_ptr<Surface>> closed;  // after the locks
  const std::lock_guard database_lock(database_mutex_);
  if (database != database_) return surface;  // for this one request
  const std::lock_guard lock(mutex_);
  surfaces_.push_back(surface);
  const auto close = [&](size_t i) {
    decoded_before_ += surfaces_[i]->cache_use().decoded;
    closed.push_back(std::move(surfaces_[i]));
    surfaces_.erase(surfaces_.begin() + static_cast<ptrdiff_t>(i));
  };
  // What stands for an object of that name that was replaced or removed, or for this one by a name
  // that it had, is of no use.
  for (size_t i = surfaces_.size() - 1; i-- > 0;) {
    const ObjectRecord& other = surfaces_[i]->record();
    if (other.name == name || IsSameObject(other, record)) close(i);
  }
  // The last used last; pinned ones stay.
  for (size_t i = 0; surfaces_.size() > options_.objects && i + 1 < surfaces_.size();) {
    if (pins_.contains(surfaces_[i].get())) {
      ++i;
    } else {
      close(i);
    }
  }
  return surface;
}

}  // namespace mtdb::internal
