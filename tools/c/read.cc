// SPDX-License-Identifier: Apache-2.0
// What C reads with: handles around the C++ objects, and nothing that C++ could not do itself.
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "query/probe.h"
#include "query/query_json.h"
#include "query/verify_object.h"
#include "store/base/redact.h"
#include "store/texture_pages.h"
#include "store/verify_store.h"
#include "tools/c/internal/handles.h"
#include "tools/c/internal/watch.h"
#include "tools/c/mtdb.h"
#include "tools/request/report_json.h"

namespace mtdb::internal {
namespace {

static_assert(static_cast<int>(StatusCode::kCancelled) == MTDB_CANCELLED);
static_assert(static_cast<int>(StatusCode::kBudgetExceeded) == MTDB_BUDGET_EXCEEDED);
static_assert(static_cast<int>(StatusCode::kCorrupt) == MTDB_CORRUPT);
static_assert(static_cast<int>(StatusCode::kBusy) == MTDB_BUSY);
static_assert(static_cast<int>(StatusCode::kNotYet) == MTDB_NOT_YET);
static_assert(static_cast<int>(ScalarType::kFloat64) == MTDB_FLOAT64);
static_assert(static_cast<int>(QueryLimit::kThreshold) == MTDB_LIMIT_ACCURACY);
static_assert(static_cast<int>(QueryLimit::kTriangles) == MTDB_LIMIT_TRIANGLES);
static_assert(static_cast<int>(QueryLimit::kBytes) == MTDB_LIMIT_BYTES);
static_assert(static_cast<int>(QueryLimit::kTime) == MTDB_LIMIT_TIME);
static_assert(static_cast<int>(QueryLimit::kMissing) == MTDB_LIMIT_MISSING);

constexpr uint32_t kNormalBytes = 3 * sizeof(float);

// Fills the caller's arrays.
class ArraySink final : public MeshSink {
 public:
  explicit ArraySink(const mtdb_arrays& arrays) : arrays_(arrays) {}

  Status Begin(const MeshHeader& header) override {
    row_bytes_ = header.attributes.row_bytes();
    return Status::Ok();
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    for (size_t i = 0; i < positions.size(); ++i) {
      const uint64_t at = 3 * (vertex_ + i);
      for (int c = 0; c < 3; ++c) {
        if (arrays_.positions != nullptr) {
          arrays_.positions[at + static_cast<uint64_t>(c)] = positions[i][c];
        }
        if (arrays_.positions_float != nullptr) {
          arrays_.positions_float[at + static_cast<uint64_t>(c)] =
              static_cast<float>(positions[i][c] - arrays_.origin[c]);
        }
      }
    }
    if (arrays_.rows != nullptr && !rows.empty()) {
      std::memcpy(arrays_.rows + vertex_ * row_bytes_, rows.data(), rows.size());
    }
    vertex_ += positions.size();
    return Status::Ok();
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    if (arrays_.indices == nullptr) return Status::Ok();
    for (const TriangleVertices& t : triangles) {
      for (const VertexIndex v : t) arrays_.indices[index_++] = static_cast<uint32_t>(v);
    }
    return Status::Ok();
  }
  Status End() override { return Status::Ok(); }

 private:
  const mtdb_arrays arrays_;
  size_t row_bytes_ = 0;
  uint64_t vertex_ = 0;
  uint64_t index_ = 0;
};

// Passes blocks to the caller's functions.
class CallbackSink final : public MeshSink {
 public:
  explicit CallbackSink(const mtdb_sink& sink) : sink_(sink) {}

  Status Begin(const MeshHeader& header) override {
    if (sink_.begin == nullptr) return Status::Ok();
    return Answer(sink_.begin(sink_.user, *header.vertex_count, *header.triangle_count));
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    static_assert(sizeof(Vec3d) == 3 * sizeof(double));
    if (sink_.vertices == nullptr) return Status::Ok();
    return Answer(sink_.vertices(sink_.user, &positions.data()->x,
                                 reinterpret_cast<const unsigned char*>(rows.data()),
                                 positions.size()));
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    static_assert(sizeof(TriangleVertices) == 3 * sizeof(uint64_t));
    if (sink_.triangles == nullptr) return Status::Ok();
    return Answer(sink_.triangles(sink_.user, triangles.data()->data(), triangles.size()));
  }
  Status End() override { return Status::Ok(); }

 private:
  const mtdb_sink sink_;
};

Status PutAnswer(const Result<ProbeAnswer>& answer, mtdb_hit* hit) {
  MTDB_RETURN_IF_ERROR(answer.status());
  mtdb_hit filled{};
  if (answer->hit) {
    filled.found = 1;
    filled.error_bound = answer->error_bound;
    filled.excess = answer->excess;
    filled.front = answer->hit->front ? 1 : 0;
    filled.distance = answer->hit->distance;
    filled.parameter = answer->hit->parameter;
    Put(answer->hit->point, filled.point);
    for (size_t c = 0; c < 3; ++c) Put(answer->hit->triangle[c], filled.triangle + 3 * c);
  }
  return PutStruct(filled, "hit", hit);
}

mtdb_stats StatsOf(const ExtractStats& s) {
  mtdb_stats stats{};
  stats.vertices = s.vertices;
  stats.triangles = s.triangles;
  stats.error_bound = s.error_bound;
  stats.limit = static_cast<mtdb_limit>(s.limit);
  stats.active_triangles = s.active_triangles;
  stats.nodes_applied = s.nodes_applied;
  stats.nodes_visited = s.nodes_visited;
  stats.nodes_forced = s.nodes_forced;
  stats.clusters_read = s.clusters_read;
  stats.clusters_cached = s.clusters_cached;
  stats.clusters_used = s.clusters_used;
  stats.clusters_total = s.clusters_total;
  stats.bytes_read = s.bytes_read;
  stats.select_seconds = s.seconds.select;
  stats.load_seconds = s.seconds.load;
  stats.read_seconds = s.seconds.read;
  stats.decode_seconds = s.seconds.decode;
  stats.emit_seconds = s.seconds.emit;
  PutShortfall(s.shortfall, &stats);
  return stats;
}

}  // namespace

Status CheckAbi(uint32_t abi_version) {
  if (abi_version == MTDB_ABI_VERSION) return Status::Ok();
  return Unsupported("libmtdb has the ABI version " + std::to_string(MTDB_ABI_VERSION) +
                     ", but the program was compiled for " + std::to_string(abi_version) +
                     "; compile it again");
}

}  // namespace mtdb::internal

using mtdb::Result;
using mtdb::Status;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::NeedFinite;
using mtdb::internal::Take;
using mtdb::internal::ToVec;

uint32_t mtdb_get_abi_version() { return MTDB_ABI_VERSION; }
const char* mtdb_get_version() { return MTDB_VERSION; }

mtdb_code mtdb_hide_secrets(const char* text, char* shown, size_t size, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{text, "text"}, {shown, "shown"}}));
    if (size == 0) return mtdb::InvalidArgument("size: expected room for a byte, found 0");
    const std::string safe = mtdb::WithoutSecrets(text).substr(0, size - 1);
    std::memcpy(shown, safe.c_str(), safe.size() + 1);
    return Status::Ok();
  });
}

mtdb_code mtdb_open_abi(uint32_t abi_version, const char* path, const mtdb_open_options* options,
                        mtdb_database** database, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(mtdb::internal::CheckAbi(abi_version));
    MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}, {database, "database"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_open_options given, Take(options, "options"));
    mtdb::OpenOptions with;
    mtdb::internal::SetCache(given.cache_directory, given.cache_directory_bytes, &with);
    MTDB_ASSIGN_OR_RETURN(auto opened, mtdb::Database::Open(path, with));
    *database = new mtdb_database{std::move(opened)};
    return Status::Ok();
  });
}

void mtdb_free_database(mtdb_database* database) { delete database; }

mtdb_code mtdb_list_objects(mtdb_database* database, mtdb_texts** names, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {names, "names"}}));
    MTDB_ASSIGN_OR_RETURN(const auto records, database->database->List());
    auto list = std::make_unique<mtdb_texts>();
    for (const mtdb::ObjectRecord& r : records) list->texts.push_back(r.name);
    *names = list.release();
    return Status::Ok();
  });
}

size_t mtdb_count_texts(const mtdb_texts* texts) {
  return texts == nullptr ? 0 : texts->texts.size();
}

const char* mtdb_get_text(const mtdb_texts* texts, size_t i) {
  return i < mtdb_count_texts(texts) ? texts->texts[i].c_str() : nullptr;
}

void mtdb_free_texts(mtdb_texts* texts) { delete texts; }

mtdb_code mtdb_open_object(mtdb_database* database, const char* name,
                           const mtdb_object_options* options, mtdb_object** object,
                           mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {object, "object"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_object_options given, Take(options, "options"));
    mtdb::SurfaceOptions with;
    if (given.cache_bytes != 0) with.cache_bytes = given.cache_bytes;
    if (given.threads > mtdb::internal::kMostThreads) {
      return mtdb::InvalidArgument("options.threads: " + std::to_string(given.threads) +
                                   " are more than " +
                                   std::to_string(mtdb::internal::kMostThreads));
    }
    with.threads = given.threads;
    const int form = given.form;
    if (form < MTDB_FORM_EXPLICIT || form > MTDB_FORM_IMPLICIT) {
      return mtdb::InvalidArgument("options.form: expected an mtdb_form, found " +
                                   std::to_string(form));
    }
    if (form == MTDB_FORM_IMPLICIT) with.form = mtdb::RuntimeForm::kImplicit;
    MTDB_ASSIGN_OR_RETURN(auto source, database->database->OpenObject(name == nullptr ? "" : name));
    MTDB_ASSIGN_OR_RETURN(auto surface, mtdb::Surface::Open(std::move(source), with));
    *object = new mtdb_object{database->database, std::move(surface)};
    return Status::Ok();
  });
}

void mtdb_free_object(mtdb_object* object) { delete object; }

const char* mtdb_get_object_name(const mtdb_object* object) {
  return object == nullptr ? nullptr : object->surface->record().name.c_str();
}

mtdb_code mtdb_get_object_info(const mtdb_object* object, mtdb_info* info, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}}));
    const mtdb::ObjectRecord& record = object->surface->record();
    mtdb_info filled{};
    filled.vertices = record.vertices;
    filled.triangles = record.triangles;
    filled.root_triangles = record.root_triangles;
    filled.clusters = record.clusters;
    mtdb::internal::Put(record.bounds.min, filled.bounds_min);
    mtdb::internal::Put(record.bounds.max, filled.bounds_max);
    filled.rounding_error = record.rounding_error;
    filled.error_max = record.grid.Error(record.error_code_max);
    filled.attributes = static_cast<uint32_t>(record.attributes.attributes.size());
    filled.row_bytes = static_cast<uint32_t>(record.attributes.row_bytes());
    return mtdb::internal::PutStruct(filled, "info", info);
  });
}

mtdb_code mtdb_get_object_attribute(const mtdb_object* object, uint32_t i,
                                    mtdb_attribute* attribute, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}}));
    return mtdb::internal::PutAttribute(object->surface->record().attributes, i, attribute);
  });
}

mtdb_code mtdb_read_page(const mtdb_object* object, uint32_t page, mtdb_receive receive, void* user,
                         mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}}));
    if (receive == nullptr) return mtdb::InvalidArgument("receive: is NULL");
    const mtdb::ObjectRecord& record = object->surface->record();
    const size_t pages = record.texture ? record.texture->pages.size() : 0;
    if (page >= pages) {
      return mtdb::NotFound("object " + record.name + ": no page " + std::to_string(page) +
                            " of its texture, it has " + std::to_string(pages));
    }
    return mtdb::ReadTextureFile(*object->surface->source(), page, [&](mtdb::ByteSpan part) {
      const auto* const bytes = reinterpret_cast<const unsigned char*>(part.data());
      if (receive(user, bytes, part.size()) == 0) return Status::Ok();
      return Status(mtdb::StatusCode::kCancelled, "stopped by the receiver");
    });
  });
}

mtdb_code mtdb_get_object_json(const mtdb_object* object, mtdb_json** json, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {json, "json"}}));
    const Result<uint64_t> file_bytes = object->database->FileBytes();
    *json = new mtdb_json{
        mtdb::RecordJson(object->surface->record(), file_bytes.ok() ? *file_bytes : 0).Text()};
    return Status::Ok();
  });
}

const char* mtdb_get_json_text(const mtdb_json* json) {
  return json == nullptr ? nullptr : json->text.c_str();
}

void mtdb_free_json(mtdb_json* json) { delete json; }

mtdb_code mtdb_verify(mtdb_object* object, mtdb_verify_level level, const mtdb_control* control,
                      mtdb_texts** failures, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {failures, "failures"}}));
    const int number = level;
    if (number < MTDB_VERIFY_FAST || number > MTDB_VERIFY_GLOBAL) {
      return mtdb::InvalidArgument("level: " + std::to_string(number) + " is none");
    }
    const mtdb::Surface& surface = *object->surface;
    mtdb::QueryControl* const watch = mtdb::internal::ControlOf(control);
    mtdb::CheckReport report;
    const mtdb::Database& database = *object->database;
    MTDB_RETURN_IF_ERROR(mtdb::VerifyStore(
        database.path(), surface.record().name, &report,
        [=] { return watch != nullptr && watch->cancelled(); }, database.options()));
    if (level >= MTDB_VERIFY_FULL && report.ok()) {
      MTDB_RETURN_IF_ERROR(mtdb::VerifyObject(surface, mtdb::VerifyLevel::kFull, &report, watch));
    }
    if (level >= MTDB_VERIFY_GLOBAL && report.ok()) {
      MTDB_RETURN_IF_ERROR(mtdb::VerifyObject(surface, mtdb::VerifyLevel::kGlobal, &report, watch));
    }
    *failures = new mtdb_texts{std::move(report.failures)};
    return Status::Ok();
  });
}

mtdb_code mtdb_create_query(const mtdb_object* object, const char* json, mtdb_query** query,
                            mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {query, "query"}}));
    mtdb::Query asked;
    if (json != nullptr) {
      MTDB_ASSIGN_OR_RETURN(asked, mtdb::ParseQuery(json, object->surface->record()));
    }
    *query = new mtdb_query{std::move(asked)};
    return Status::Ok();
  });
}

void mtdb_free_query(mtdb_query* query) { delete query; }

mtdb_code mtdb_create_control(mtdb_control** control, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{control, "control"}}));
    *control = new mtdb_control{std::make_shared<mtdb::QueryControl>()};
    return Status::Ok();
  });
}

void mtdb_free_control(mtdb_control* control) { delete control; }

void mtdb_cancel(mtdb_control* control) {
  if (control != nullptr) control->control->Cancel();
}

mtdb_code mtdb_get_progress(const mtdb_control* control, mtdb_progress* progress,
                            mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{control, "control"}}));
    const mtdb::QueryControl& c = *control->control;
    return mtdb::internal::PutStruct(mtdb_progress{0, c.clusters_loaded(), c.nodes_applied(),
                                                   c.triangles_emitted(), c.cancelled() ? 1 : 0},
                                     "progress", progress);
  });
}

mtdb_code mtdb_select(mtdb_object* object, const mtdb_query* query, const mtdb_control* control,
                      mtdb_cut** cut, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {cut, "cut"}}));
    mtdb::Query asked;
    if (query != nullptr) asked = query->query;
    asked.control = mtdb::internal::ControlOf(control);
    MTDB_ASSIGN_OR_RETURN(mtdb::Cut selected, object->surface->Select(asked));
    const size_t row_bytes = object->surface->record().attributes.row_bytes() +
                             (asked.normals ? mtdb::internal::kNormalBytes : 0);
    *cut = new mtdb_cut{control == nullptr ? nullptr : control->control, object->surface,
                        std::move(selected), static_cast<uint32_t>(row_bytes)};
    return Status::Ok();
  });
}

void mtdb_free_cut(mtdb_cut* cut) { delete cut; }

mtdb_code mtdb_get_cut_stats(const mtdb_cut* cut, mtdb_stats* stats, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}}));
    mtdb_stats filled = mtdb::internal::StatsOf(cut->cut.stats());
    filled.row_bytes = cut->row_bytes;
    return mtdb::internal::PutStruct(filled, "stats", stats);
  });
}

mtdb_code mtdb_copy_cut(mtdb_cut* cut, const mtdb_arrays* arrays, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}, {arrays, "arrays"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_arrays given, Take(arrays, "arrays"));
    const uint64_t vertices = cut->cut.vertex_count();
    const uint64_t triangles = cut->cut.triangle_count();
    if (given.vertex_capacity < vertices || given.triangle_capacity < triangles) {
      return {mtdb::StatusCode::kBudgetExceeded,
              "the cut has " + std::to_string(vertices) + " vertices and " +
                  std::to_string(triangles) + " triangles, but the arrays have room for " +
                  std::to_string(given.vertex_capacity) + " and " +
                  std::to_string(given.triangle_capacity)};
    }
    if (given.indices != nullptr && vertices > uint64_t{1} << 32) {
      return mtdb::InvalidArgument("32-bit indices cannot number " + std::to_string(vertices) +
                                   " vertices; use mtdb_emit_cut");
    }
    if (given.positions_float != nullptr) {
      MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(given.origin), "origin"));
    }
    mtdb::internal::ArraySink sink(given);
    return cut->cut.Emit(sink);
  });
}

mtdb_code mtdb_emit_cut(mtdb_cut* cut, const mtdb_sink* sink, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}, {sink, "sink"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_sink given, Take(sink, "sink"));
    mtdb::internal::CallbackSink callbacks(given);
    return cut->cut.Emit(callbacks);
  });
}

mtdb_code mtdb_find_closest_point(mtdb_object* object, const double point[3], double limit,
                                  const mtdb_probe_options* options, mtdb_hit* hit,
                                  mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {point, "point"}}));
    MTDB_ASSIGN_OR_RETURN(auto with, mtdb::internal::ProbeOptionsOf<mtdb::ProbeOptions>(options));
    with.limit = limit;
    return mtdb::internal::PutAnswer(mtdb::FindClosestPoint(*object->surface, ToVec(point), with),
                                     hit);
  });
}

mtdb_code mtdb_cast_ray(mtdb_object* object, const double origin[3], const double direction[3],
                        double limit, const mtdb_probe_options* options, mtdb_hit* hit,
                        mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(
        NeedAll({{object, "object"}, {origin, "origin"}, {direction, "direction"}}));
    MTDB_ASSIGN_OR_RETURN(auto with, mtdb::internal::ProbeOptionsOf<mtdb::ProbeOptions>(options));
    with.limit = limit;
    return mtdb::internal::PutAnswer(
        mtdb::CastRay(*object->surface, ToVec(origin), ToVec(direction), with), hit);
  });
}
