// SPDX-License-Identifier: Apache-2.0
// The query engine for a page (../src/mtdb.ts): one object of a packed file, a session that waits
// for nothing, and its mesh in slots. Whoever holds the event loop hands in the bytes that are
// asked for. Compiled to WebAssembly with query/engine_sources.txt, without threads and exceptions.
// One instance for each object. Functions give a status code of store/base/status.h, 0 for success;
// error() then says why.
#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "query/probe.h"
#include "query/query_json.h"
#include "query/session.h"
#include "query/surface.h"
#include "store/base/hash.h"
#include "store/base/json.h"
#include "store/base/scalar_names.h"
#include "store/packed_file.h"
#include "store/range_reader.h"
#include "tools/viewer/wasm/slot_ranges.h"
#include "tools/web/wasm/slot_mesh.h"

#ifdef __wasm__
#define MTDB_EXPORT(name) __attribute__((export_name(name)))
#else
#define MTDB_EXPORT(name)
#endif

namespace mtdb {

namespace {

// The file. What the page has put here is answered at once; the rest is asked of it.
class PageRanges final : public RangeReader {
 public:
  PageRanges(std::string name, uint64_t size) : name_(std::move(name)), size_(size) {}

  const std::string& name() const override { return name_; }
  uint64_t size() const override { return size_; }
  bool answers_at_once() const override { return false; }
  uint64_t bytes_read() const override { return bytes_read_; }
  uint64_t requests() const override { return last_; }

  Ticket Read(ByteRange range, Answer answer) override {
    if (const std::optional<ByteSpan> here = Kept(range)) {
      ++answered_here_;
      answer(Bytes(here->begin(), here->end()));
      return 0;
    }
    const Ticket ticket = opening_ ? 0 : ++last_;
    fresh_.push_back({static_cast<double>(ticket), static_cast<double>(range.offset),
                      static_cast<double>(range.bytes)});
    if (opening_) {
      answer(NotYet(name_ + ": is on its way"));
    } else {
      waiting_.emplace(ticket, std::move(answer));
    }
    return ticket;
  }
  void Cancel(Ticket ticket) override {
    if (waiting_.erase(ticket) > 0) cancelled_.push_back(static_cast<double>(ticket));
  }

  // Reads that were answered during the call.
  uint64_t answered_here() const { return answered_here_; }
  // While opening, what is not here fails, to be tried again.
  void SetOpening(bool opening) { opening_ = opening; }
  void Keep(uint64_t offset, Bytes bytes) {
    bytes_read_ += bytes.size();
    kept_[offset] = std::move(bytes);
  }
  void Take(Ticket ticket, Result<Bytes> bytes) {
    auto waiting = waiting_.extract(ticket);
    if (waiting.empty()) return;
    if (bytes.ok()) bytes_read_ += bytes->size();
    waiting.mapped()(std::move(bytes));
  }
  // How many were asked for since the last call, then ticket (0: to be kept), offset and length of
  // each; then how many are not wanted any more, and their tickets.
  std::vector<double> TakeWishes() {
    std::vector<double> list{static_cast<double>(fresh_.size())};
    for (const auto& wish : fresh_) list.insert(list.end(), wish.begin(), wish.end());
    list.push_back(static_cast<double>(cancelled_.size()));
    list.insert(list.end(), cancelled_.begin(), cancelled_.end());
    fresh_.clear();
    cancelled_.clear();
    return list;
  }

 private:
  std::optional<ByteSpan> Kept(ByteRange range) const {
    auto at = kept_.upper_bound(range.offset);
    if (at == kept_.begin()) return std::nullopt;
    --at;
    const uint64_t skip = range.offset - at->first;
    if (skip > at->second.size() || range.bytes > at->second.size() - skip) return std::nullopt;
    return ByteSpan(at->second).subspan(skip, range.bytes);
  }

  const std::string name_;
  const uint64_t size_;
  bool opening_ = false;
  std::map<uint64_t, Bytes> kept_;  // by offset
  std::map<Ticket, Answer> waiting_;
  std::vector<std::array<double, 3>> fresh_;
  std::vector<double> cancelled_;
  Ticket last_ = 0;
  uint64_t bytes_read_ = 0;
  uint64_t answered_here_ = 0;
};

struct State {
  Bytes input;
  std::string error, text;
  std::shared_ptr<PageRanges> ranges;
  std::shared_ptr<PackedObjects> file;
  std::shared_ptr<Surface> surface;
  std::unique_ptr<Session> session;
  std::optional<SlotMesh> mesh;
  std::string query_text;
  Query query;
  bool clips = false;  // the mesh is clipped as the query has it
  std::vector<double> wishes;
  std::array<double, 17> report{};
  double insertions = 0, removals = 0;  // of the call
  std::vector<Normal> normals;
  std::vector<float> sums;
  std::array<float, 3> stretch{1, 1, 1};  // normals are those of positions times this
  std::vector<uint32_t> changes;
  // A triangle slot: see triangle_facts().
  std::vector<float> errors;
  std::vector<uint32_t> clusters;
  Bytes rounds;
  std::array<double, 6> found{};  // by the last ray or extraction
  TriangleMesh extracted;
};
State state;

uint32_t Code(const Status& status) {
  if (!status.ok()) state.error = status.message();
  return static_cast<uint32_t>(status.code());
}

std::string Input() {
  return {reinterpret_cast<const char*>(state.input.data()), state.input.size()};
}

Result<Json> TextureJson(const ObjectRecord& record) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<ByteRange> files, state.file->TextureFiles(record.name));
  Json pages = Json::Array();
  for (size_t p = 0; p < record.texture->pages.size(); ++p) {
    const TextureRecord::Page& page = record.texture->pages[p];
    pages.push_back({{"name", page.name},
                     {"media_type", page.media_type},
                     {"width", page.width},
                     {"height", page.height},
                     {"offset", files[p].offset},
                     {"bytes", files[p].bytes}});
  }
  const ByteRange& tiles = files.back();
  Json json = {{"pages", pages}, {"tiles", nullptr}};
  if (tiles.bytes > 0) json["tiles"] = {{"offset", tiles.offset}, {"bytes", tiles.bytes}};
  return json;
}

Result<Json> ObjectJson(const ObjectRecord& record) {
  Json attributes = Json::Array();
  for (const VertexAttribute& a : record.attributes.attributes) {
    attributes.push_back({{"name", a.name}, {"type", ScalarName(a.type)}});
  }
  Json json = {{"object", record.name},
               {"triangles", record.triangles},
               {"vertices", record.vertices},
               {"clusters", record.clusters},
               {"rounds", record.rounds.size()},
               {"diagonal", record.diagonal()},
               {"rounding_error", record.rounding_error},
               {"bounds", {{"min", Json(record.bounds.min)}, {"max", Json(record.bounds.max)}}},
               {"attributes", attributes},
               {"units", record.units}};
  if (record.up) {
    json["up"] = Json(record.up->direction);
    json["up_given"] = record.up->given;
  }
  if (record.raster) {
    json["raster"] = {{"crs", record.georeference}, {"height_units", record.raster->height_units}};
  }
  if (record.texture) {
    MTDB_ASSIGN_OR_RETURN(json["texture"], TextureJson(record));
  }
  return json;
}

// Why the worst of what failed did, into state.error and `code`.
double CountFailed(const std::vector<MissingCluster>& missing, double* code) {
  double failed = 0;
  for (const MissingCluster& m : missing) {
    if (m.reason != MissingCluster::Reason::kFailed) continue;
    if (failed == 0) {
      state.error = m.failure.message();
      *code = static_cast<double>(m.failure.code());
    }
    ++failed;
  }
  return failed;
}

double CountRoomless(const std::vector<MissingCluster>& missing) {
  double count = 0;
  for (const MissingCluster& m : missing) {
    count += m.reason == MissingCluster::Reason::kNoRoom ? 1 : 0;
  }
  return count;
}

void Report(const SessionUpdate& update) {
  const ExtractStats& s = update.stats;
  const bool any = !s.missing.empty();
  double failure = 0;
  const double failed = CountFailed(s.missing, &failure);
  state.report = {static_cast<double>(state.mesh->shown_triangles()),
                  static_cast<double>(s.vertices),
                  s.error_bound,
                  static_cast<double>(s.limit),
                  static_cast<double>(s.missing.size()),
                  any ? s.missing.front().excess : 0,
                  failed,
                  CountRoomless(s.missing),
                  state.insertions += static_cast<double>(update.insertions),
                  state.removals += static_cast<double>(update.removals),
                  static_cast<double>(state.surface->cache_use().bytes),
                  static_cast<double>(state.surface->cache_use().decoded),
                  static_cast<double>(state.ranges->bytes_read()),
                  static_cast<double>(s.clusters_used),
                  static_cast<double>(s.shortfall.triangles),
                  s.shortfall.excess,
                  failure};
}

Status OpenPackedFile() {
  MTDB_ASSIGN_OR_RETURN(state.file, PackedObjects::Open(state.ranges));
  Json objects = Json::Array();
  for (const ObjectRecord& record : state.file->List()) {
    MTDB_ASSIGN_OR_RETURN(Json json, ObjectJson(record));
    objects.push_back(std::move(json));
  }
  state.text = objects.Text();
  return Status::Ok();
}

Status OpenObject(const std::string& name, double cache_bytes) {
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source, state.file->OpenObject(name));
  SurfaceOptions options;
  options.cache_bytes = static_cast<size_t>(cache_bytes);
  options.threads = 1;
  options.waits = false;
  MTDB_ASSIGN_OR_RETURN(state.surface, Surface::Open(std::move(source), options));
  MTDB_ASSIGN_OR_RETURN(state.session, Session::Open(state.surface, {.available_only = true}));
  return Status::Ok();
}

// What a session of a server sends to a client that is clipped.
MeetsRegion ClipOf(const Query& query) {
  if (!query.clip || query.region == nullptr || query.region->whole()) return nullptr;
  return [region = query.region](const Triangle3d& t) { return region->Within(t, 0); };
}

Status UpdateOnce() {
  if (!state.mesh) {
    MTDB_ASSIGN_OR_RETURN(const BaseMesh base, state.session->Base());
    state.mesh.emplace(state.surface->record(), base);
  }
  if (!std::exchange(state.clips, true)) state.mesh->Clip(ClipOf(state.query));
  std::vector<UpdateBatch> batches;
  MTDB_ASSIGN_OR_RETURN(const SessionUpdate update, state.session->Update(state.query, &batches));
  for (const UpdateBatch& batch : batches) state.mesh->Apply(batch);
  if (state.mesh->corners()) state.mesh->corners()->Fill(*state.session);
  state.mesh->ShowWritten();
  Report(update);
  return Status::Ok();
}

Status Update(double milliseconds) {
  if (std::string text = Input(); text != state.query_text || text.empty()) {
    MTDB_ASSIGN_OR_RETURN(state.query, ParseQuery(text, state.surface->record()));
    state.query_text = std::move(text);
    state.clips = false;
  }
  state.query.max_milliseconds.reset();
  if (milliseconds >= 0) state.query.max_milliseconds = milliseconds;
  state.insertions = state.removals = 0;
  for (;;) {
    const uint64_t before = state.ranges->answered_here();
    const Status status = UpdateOnce();
    const bool more = state.ranges->answered_here() != before;
    if (!more || (!status.ok() && status.code() != StatusCode::kNotYet)) return status;
  }
}

// Again and again, as long as what was lacking was here.
template <typename F>
Status WhileAnswered(F&& call) {
  for (;;) {
    const uint64_t before = state.ranges->answered_here();
    const Status status = call();
    const bool more = state.ranges->answered_here() != before;
    if (!more || status.code() != StatusCode::kNotYet) return status;
  }
}

Status Cast() {
  if (state.input.size() != 6 * sizeof(double)) return InvalidArgument("a ray has six numbers");
  std::array<double, 6> ray;
  std::memcpy(ray.data(), state.input.data(), sizeof(ray));
  return WhileAnswered([&]() -> Status {
    MTDB_ASSIGN_OR_RETURN(
        const ProbeAnswer answer,
        CastRay(*state.surface, {ray[0], ray[1], ray[2]}, {ray[3], ray[4], ray[5]}));
    state.found = {};
    if (!answer.hit) return Status::Ok();
    const Vec3d p = answer.hit->point;
    state.found = {1, p.x, p.y, p.z, answer.error_bound, answer.hit->parameter};
    return Status::Ok();
  });
}

Status Extract() {
  MTDB_ASSIGN_OR_RETURN(const Query query, ParseQuery(Input(), state.surface->record()));
  return WhileAnswered([&]() -> Status {
    state.extracted = {};
    TriangleMeshSink sink(&state.extracted);
    MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, state.surface->Extract(query, sink));
    state.found = {static_cast<double>(stats.vertices),
                   static_cast<double>(stats.triangles),
                   static_cast<double>(state.extracted.header.attributes.row_bytes()),
                   stats.error_bound,
                   static_cast<double>(stats.limit),
                   0};
    return Status::Ok();
  });
}

}  // namespace

// Where `size` bytes for the next call go; that call uses all of them.
MTDB_EXPORT("input") extern "C" std::byte* InputBytes(uint32_t size) {
  state.input.resize(size);
  return state.input.data();
}
MTDB_EXPORT("error") extern "C" const char* Error() { return state.error.c_str(); }
MTDB_EXPORT("error_size") extern "C" uint32_t ErrorSize() {
  return static_cast<uint32_t>(state.error.size());
}
// Hash64 of the input: checksums of a texture's tiles.
MTDB_EXPORT("checksum") extern "C" uint64_t Checksum(uint64_t seed) {
  return Hash64(state.input, seed);
}
MTDB_EXPORT("text") extern "C" const char* Text() { return state.text.c_str(); }
MTDB_EXPORT("text_size") extern "C" uint32_t TextSize() {
  return static_cast<uint32_t>(state.text.size());
}

// A file of this size, by the name in the input.
MTDB_EXPORT("begin") extern "C" void Begin(double size) {
  state.ranges = std::make_shared<PageRanges>(Input(), static_cast<uint64_t>(size));
}
// The input is what the file has from `offset` on; it stays.
MTDB_EXPORT("keep") extern "C" void Keep(double offset) {
  state.ranges->Keep(static_cast<uint64_t>(offset), std::move(state.input));
  state.input = {};
}
// The file's objects as JSON, in the text. kNotYet: keep what the wishes say, and call again.
MTDB_EXPORT("open_file") extern "C" uint32_t OpenFile() {
  state.ranges->SetOpening(true);
  const Status status = OpenPackedFile();
  state.ranges->SetOpening(false);
  return Code(status);
}
// The object whose name is in the input, with a cache of so many bytes. Likewise.
MTDB_EXPORT("open_object") extern "C" uint32_t OpenObjectByName(double cache_bytes) {
  state.ranges->SetOpening(true);
  const Status status = OpenObject(Input(), cache_bytes);
  state.ranges->SetOpening(false);
  return Code(status);
}

// PageRanges::TakeWishes.
MTDB_EXPORT("wishes") extern "C" const double* Wishes() {
  state.wishes = state.ranges->TakeWishes();
  return state.wishes.data();
}
// The bytes of a wish are in the input, or, with a code that is not 0, why they cannot be had.
MTDB_EXPORT("answer") extern "C" void Answer(double ticket, uint32_t code) {
  const auto t = static_cast<RangeReader::Ticket>(ticket);
  if (code == 0) {
    state.ranges->Take(t, std::exchange(state.input, {}));
  } else {
    state.ranges->Take(t, Status(static_cast<StatusCode>(code), Input()));
  }
}

// Moves towards the query in the input (docs/query.md), for about so long; negative: to the end of
// what is there. kNotYet: nothing is there.
MTDB_EXPORT("update") extern "C" uint32_t UpdateMesh(double milliseconds) {
  return Code(Update(milliseconds));
}
// Of the last update: see Report.
MTDB_EXPORT("report") extern "C" const double* LastReport() { return state.report.data(); }
MTDB_EXPORT("retry") extern "C" void Retry() { state.session->RetryFailed(); }

MTDB_EXPORT("triangle_slots") extern "C" uint32_t TriangleSlots() {
  return static_cast<uint32_t>(state.mesh->indices().size() / 3);
}
MTDB_EXPORT("vertex_slots") extern "C" uint32_t VertexSlots() {
  return static_cast<uint32_t>(state.mesh->positions().size() / 3);
}
MTDB_EXPORT("row_bytes") extern "C" uint32_t RowBytes() {
  return static_cast<uint32_t>(state.surface->record().attributes.row_bytes());
}
MTDB_EXPORT("origin") extern "C" const double* Origin() { return state.mesh->origin().data(); }
MTDB_EXPORT("indices") extern "C" const uint32_t* Indices() { return state.mesh->shown().data(); }
MTDB_EXPORT("positions") extern "C" const float* Positions() {
  return state.mesh->positions().data();
}
MTDB_EXPORT("normals") extern "C" const int16_t* Normals() {
  return reinterpret_cast<const int16_t*>(state.normals.data());
}
MTDB_EXPORT("rows") extern "C" const std::byte* Rows() { return state.mesh->rows().data(); }
// Of textured objects, else 0: SlotCorners::coordinates, and pages.
MTDB_EXPORT("corners") extern "C" const float* Corners() {
  return state.mesh->corners() ? state.mesh->corners()->coordinates().data() : nullptr;
}
MTDB_EXPORT("pages") extern "C" const uint32_t* Pages() {
  return state.mesh->corners() ? state.mesh->corners()->pages().data() : nullptr;
}

MTDB_EXPORT("stretch") extern "C" void Stretch(double x, double y, double z) {
  state.stretch = {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
}

// Brings the normals up to date. How many ranges of triangle slots, vertex slots and normals have
// changed since the last call, then their bounds.
MTDB_EXPORT("take_changes") extern "C" const uint32_t* TakeChanges() {
  std::vector<uint32_t>& list = state.changes;
  list.assign(3, 0);
  const uint32_t triangles = state.mesh->TakeTriangles(&list);
  const uint32_t vertices = state.mesh->TakeVertices(&list);
  const uint32_t normals =
      UpdateNormals(state.mesh->positions(), state.mesh->indices(), state.stretch,
                    state.mesh->touched(), &state.sums, &state.normals, &list);
  state.mesh->ClearTouched();
  list[0] = triangles;
  list[1] = vertices;
  list[2] = normals;
  return list.data();
}

// What is known of the triangles that the last update left: errors() has b(t), with a minus where
// only that it is no more is known; clusters() and rounds() tell the cluster that made it. Zeros
// for empty slots.
MTDB_EXPORT("triangle_facts") extern "C" void FindTriangleFacts() {
  const size_t slots = state.mesh->indices().size() / 3;
  state.errors.assign(slots, 0);
  state.clusters.assign(slots, 0);
  state.rounds.assign(slots, std::byte{0});
  const ClusterIndex& index = state.surface->index();
  state.mesh->ForEachTriangle([&](uint32_t slot, TriangleKey key) {
    const TriangleFacts facts = state.session->FactsOf(key);
    const auto bound = static_cast<float>(facts.error_bound);
    state.errors[slot] = facts.exact ? bound : -bound;
    state.clusters[slot] = facts.cluster;
    state.rounds[slot] = std::byte{index.unit(facts.cluster).round};
  });
}
MTDB_EXPORT("errors") extern "C" const float* Errors() { return state.errors.data(); }
MTDB_EXPORT("clusters") extern "C" const uint32_t* Clusters() { return state.clusters.data(); }
MTDB_EXPORT("rounds") extern "C" const std::byte* Rounds() { return state.rounds.data(); }

// The first hit of the ray in the input, six numbers, with the surface at full resolution: see
// found(): 1 or 0, point, error bound, parameter of the ray. kNotYet: hand in what the wishes ask
// for, and call again.
MTDB_EXPORT("cast_ray") extern "C" uint32_t CastRayHere() { return Code(Cast()); }
// The mesh of the query in the input, as `mtdb extract` makes it; found(): vertices, triangles,
// bytes of a vertex's attributes, error bound, limit. Likewise.
MTDB_EXPORT("extract") extern "C" uint32_t ExtractHere() { return Code(Extract()); }
MTDB_EXPORT("found") extern "C" const double* Found() { return state.found.data(); }
// Three doubles a vertex, three indices of 64 bits a triangle, and the attributes.
MTDB_EXPORT("mesh_positions") extern "C" const double* MeshPositions() {
  return reinterpret_cast<const double*>(state.extracted.positions.data());
}
MTDB_EXPORT("mesh_triangles") extern "C" const VertexIndex* MeshTriangles() {
  return state.extracted.triangles.data()->data();
}
MTDB_EXPORT("mesh_rows") extern "C" const std::byte* MeshRows() {
  return state.extracted.rows.data();
}
MTDB_EXPORT("mesh_free") extern "C" void MeshFree() { state.extracted = {}; }

}  // namespace mtdb
