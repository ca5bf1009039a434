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
static_assert(static_cast<int>(QueryLimit::kThreshold) == MTDB_LIMIT_THRESHOLD);
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

void PutAnswer(const ProbeAnswer& answer, mtdb_hit* hit) {
  *hit = {};
  if (!answer.hit) return;
  hit->found = 1;
  hit->error_bound = answer.error_bound;
  hit->excess = answer.excess;
  hit->front = answer.hit->front ? 1 : 0;
  hit->distance = answer.hit->distance;
  Put(answer.hit->point, hit->point);
  for (size_t c = 0; c < 3; ++c) Put(answer.hit->triangle[c], hit->triangle + 3 * c);
}

// What functions that change a query have in common.
template <typename Change>
mtdb_code Set(mtdb_query* query, mtdb_error* error, Change&& change) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{query, "query"}}));
    return change();
  });
}

// What a query's region and threshold functions have in common.
template <typename Pointer, typename Make>
mtdb_code AddTo(std::vector<Pointer> mtdb_query::*list, mtdb_query* query, mtdb_error* error,
                Make&& make) {
  return Set(query, error, [&]() -> Status {
    MTDB_ASSIGN_OR_RETURN(Pointer made, make());
    (query->*list).push_back(std::move(made));
    return Status::Ok();
  });
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
using mtdb::internal::AddTo;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::NeedFinite;
using mtdb::internal::Set;
using mtdb::internal::Take;
using mtdb::internal::ToVec;

uint32_t mtdb_abi_version() { return MTDB_ABI_VERSION; }
const char* mtdb_version() { return MTDB_VERSION; }

mtdb_code mtdb_without_secrets(const char* text, char* shown, size_t size, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{text, "text"}, {shown, "shown"}}));
    if (size == 0) return mtdb::InvalidArgument("size: expected room for a byte, found 0");
    const std::string safe = mtdb::WithoutSecrets(text).substr(0, size - 1);
    std::memcpy(shown, safe.c_str(), safe.size() + 1);
    return Status::Ok();
  });
}

mtdb_code mtdb_open_abi(uint32_t abi_version, const char* path, mtdb_database** database,
                        mtdb_error* error) {
  return mtdb_open_with_abi(abi_version, path, nullptr, database, error);
}

mtdb_code mtdb_open_with_abi(uint32_t abi_version, const char* path,
                             const mtdb_open_options* options, mtdb_database** database,
                             mtdb_error* error) {
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

mtdb_code mtdb_list_objects(mtdb_database* database, mtdb_names** names, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {names, "names"}}));
    MTDB_ASSIGN_OR_RETURN(const auto records, database->database->List());
    auto list = std::make_unique<mtdb_names>();
    for (const mtdb::ObjectRecord& r : records) list->names.push_back(r.name);
    *names = list.release();
    return Status::Ok();
  });
}

size_t mtdb_names_count(const mtdb_names* names) {
  return names == nullptr ? 0 : names->names.size();
}

const char* mtdb_names_at(const mtdb_names* names, size_t i) {
  return i < mtdb_names_count(names) ? names->names[i].c_str() : nullptr;
}

void mtdb_free_names(mtdb_names* names) { delete names; }

mtdb_code mtdb_open_object(mtdb_database* database, const char* name, size_t cache_bytes,
                           mtdb_object** object, mtdb_error* error) {
  const mtdb_object_options options{cache_bytes, 0, MTDB_FORM_EXPLICIT};
  return mtdb_open_object_with(database, name, &options, object, error);
}

mtdb_code mtdb_open_object_with(mtdb_database* database, const char* name,
                                const mtdb_object_options* options, mtdb_object** object,
                                mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {object, "object"}}));
    mtdb::SurfaceOptions with;
    if (options != nullptr) {
      if (options->cache_bytes != 0) with.cache_bytes = options->cache_bytes;
      if (options->threads > mtdb::internal::kMostThreads) {
        return mtdb::InvalidArgument("threads: " + std::to_string(options->threads) +
                                     " are more than " +
                                     std::to_string(mtdb::internal::kMostThreads));
      }
      with.threads = options->threads;
      if (options->form > MTDB_FORM_IMPLICIT) {
        return mtdb::InvalidArgument("form: expected an mtdb_form, found " +
                                     std::to_string(options->form));
      }
      if (options->form == MTDB_FORM_IMPLICIT) with.form = mtdb::RuntimeForm::kImplicit;
    }
    MTDB_ASSIGN_OR_RETURN(auto source, database->database->OpenObject(name == nullptr ? "" : name));
    MTDB_ASSIGN_OR_RETURN(auto surface, mtdb::Surface::Open(std::move(source), with));
    *object = new mtdb_object{database->database, std::move(surface)};
    return Status::Ok();
  });
}

void mtdb_free_object(mtdb_object* object) { delete object; }

const char* mtdb_object_name(const mtdb_object* object) {
  return object == nullptr ? nullptr : object->surface->record().name.c_str();
}

mtdb_code mtdb_object_info(const mtdb_object* object, mtdb_info* info, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {info, "info"}}));
    const mtdb::ObjectRecord& record = object->surface->record();
    *info = {};
    info->vertices = record.vertices;
    info->triangles = record.triangles;
    info->root_triangles = record.root_triangles;
    info->clusters = record.clusters;
    mtdb::internal::Put(record.bounds.min, info->bounds_min);
    mtdb::internal::Put(record.bounds.max, info->bounds_max);
    info->rounding_error = record.rounding_error;
    info->error_max = record.grid.Error(record.error_code_max);
    info->attributes = static_cast<uint32_t>(record.attributes.attributes.size());
    info->row_bytes = static_cast<uint32_t>(record.attributes.row_bytes());
    return Status::Ok();
  });
}

mtdb_code mtdb_object_attribute(const mtdb_object* object, uint32_t i, mtdb_attribute* attribute,
                                mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {attribute, "attribute"}}));
    return mtdb::internal::GetAttribute(object->surface->record().attributes, i, attribute);
  });
}

mtdb_code mtdb_object_json(const mtdb_object* object, mtdb_names** json, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {json, "json"}}));
    const Result<uint64_t> file_bytes = object->database->FileBytes();
    *json = new mtdb_names{
        {mtdb::RecordJson(object->surface->record(), file_bytes.ok() ? *file_bytes : 0).Text()}};
    return Status::Ok();
  });
}

mtdb_code mtdb_verify(mtdb_object* object, mtdb_verify_level level, const mtdb_control* control,
                      mtdb_names** failures, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {failures, "failures"}}));
    const int number = level;
    if (number < MTDB_VERIFY_FAST || number > MTDB_VERIFY_GLOBAL) {
      return mtdb::InvalidArgument("level: " + std::to_string(number) + " is none");
    }
    const mtdb::Surface& surface = *object->surface;
    mtdb::QueryControl* const watch = control == nullptr ? nullptr : control->control.get();
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
    *failures = new mtdb_names{std::move(report.failures)};
    return Status::Ok();
  });
}

mtdb_code mtdb_create_query(mtdb_query** query, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{query, "query"}}));
    *query = new mtdb_query;
    return Status::Ok();
  });
}

void mtdb_free_query(mtdb_query* query) { delete query; }

mtdb_code mtdb_query_add_box(mtdb_query* query, const double min[3], const double max[3],
                             mtdb_error* error) {
  return AddTo(&mtdb_query::regions, query, error, [&]() -> Result<mtdb::RegionPtr> {
    MTDB_RETURN_IF_ERROR(NeedAll({{min, "min"}, {max, "max"}}));
    MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(min), "min"));
    MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(max), "max"));
    const mtdb::Box3d box{ToVec(min), ToVec(max)};
    if (box.empty()) return mtdb::InvalidArgument("box: min exceeds max");
    return mtdb::BoxRegion(box);
  });
}

mtdb_code mtdb_query_add_sphere(mtdb_query* query, const double centre[3], double radius,
                                mtdb_error* error) {
  return AddTo(&mtdb_query::regions, query, error, [&]() -> Result<mtdb::RegionPtr> {
    MTDB_RETURN_IF_ERROR(NeedAll({{centre, "centre"}}));
    MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(centre), "centre"));
    MTDB_RETURN_IF_ERROR(NeedFinite({radius}, "radius"));
    if (radius < 0) return mtdb::InvalidArgument("radius: is negative");
    return mtdb::SphereRegion(ToVec(centre), radius);
  });
}

mtdb_code mtdb_query_add_constant_error(mtdb_query* query, double largest, mtdb_error* error) {
  return AddTo(&mtdb_query::thresholds, query, error, [&]() -> Result<mtdb::ThresholdPtr> {
    MTDB_RETURN_IF_ERROR(NeedFinite({largest}, "largest"));
    if (largest < 0) return mtdb::InvalidArgument("largest: is negative");
    return mtdb::ConstantThreshold(largest);
  });
}

mtdb_code mtdb_query_add_full_resolution(mtdb_query* query, mtdb_error* error) {
  return AddTo(&mtdb_query::thresholds, query, error,
               []() -> Result<mtdb::ThresholdPtr> { return mtdb::FullResolution(); });
}

mtdb_code mtdb_query_add_coarsest(mtdb_query* query, mtdb_error* error) {
  return AddTo(&mtdb_query::thresholds, query, error,
               []() -> Result<mtdb::ThresholdPtr> { return mtdb::CoarsestThreshold(); });
}

mtdb_code mtdb_query_add_linear_error(mtdb_query* query, const double point[3], double base,
                                      double slope, mtdb_error* error) {
  return AddTo(&mtdb_query::thresholds, query, error, [&]() -> Result<mtdb::ThresholdPtr> {
    MTDB_RETURN_IF_ERROR(NeedAll({{point, "point"}}));
    MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(point), "point"));
    MTDB_RETURN_IF_ERROR(NeedFinite({base, slope}, "base and slope"));
    return mtdb::LinearThreshold(ToVec(point), base, slope);
  });
}

mtdb_code mtdb_query_set_json(mtdb_query* query, const mtdb_object* object, const char* json,
                              mtdb_error* error) {
  return Set(query, error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {json, "json"}}));
    MTDB_ASSIGN_OR_RETURN(mtdb::Query parsed, mtdb::ParseQuery(json, object->surface->record()));
    mtdb_query taken;
    if (parsed.region != nullptr) taken.regions.push_back(std::move(parsed.region));
    if (parsed.threshold != nullptr) taken.thresholds.push_back(std::move(parsed.threshold));
    taken.rest = std::move(parsed);
    taken.control = query->control;
    *query = std::move(taken);
    return Status::Ok();
  });
}

mtdb_code mtdb_query_set_max_triangles(mtdb_query* query, uint64_t count, mtdb_error* error) {
  return Set(query, error, [&] {
    query->rest.max_triangles = count == 0 ? std::nullopt : std::optional<uint64_t>(count);
    return Status::Ok();
  });
}

mtdb_code mtdb_query_set_max_bytes(mtdb_query* query, uint64_t bytes, mtdb_error* error) {
  return Set(query, error, [&] {
    query->rest.max_bytes = bytes == 0 ? std::nullopt : std::optional<uint64_t>(bytes);
    return Status::Ok();
  });
}

mtdb_code mtdb_query_set_max_milliseconds(mtdb_query* query, double milliseconds,
                                          mtdb_error* error) {
  return Set(query, error, [&]() -> Status {
    if (!(milliseconds >= 0)) return mtdb::InvalidArgument("milliseconds: negative or NaN");
    query->rest.max_milliseconds =
        milliseconds == 0 ? std::nullopt : std::optional<double>(milliseconds);
    return Status::Ok();
  });
}

mtdb_code mtdb_query_set_clip(mtdb_query* query, int clip, mtdb_error* error) {
  return Set(query, error, [&] {
    query->rest.clip = clip != 0;
    return Status::Ok();
  });
}

mtdb_code mtdb_query_set_normals(mtdb_query* query, int normals, mtdb_error* error) {
  return Set(query, error, [&] {
    query->rest.normals = normals != 0;
    return Status::Ok();
  });
}

mtdb_code mtdb_query_set_available_only(mtdb_query* query, int available_only, mtdb_error* error) {
  return Set(query, error, [&] {
    query->rest.available_only = available_only != 0;
    return Status::Ok();
  });
}

mtdb_code mtdb_create_control(mtdb_control** control, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{control, "control"}}));
    *control = new mtdb_control{std::make_shared<mtdb::QueryControl>()};
    return Status::Ok();
  });
}

void mtdb_free_control(mtdb_control* control) { delete control; }

mtdb_code mtdb_query_set_control(mtdb_query* query, const mtdb_control* control,
                                 mtdb_error* error) {
  return Set(query, error, [&] {
    query->control = control == nullptr ? nullptr : control->control;
    return Status::Ok();
  });
}

void mtdb_cancel(mtdb_control* control) {
  if (control != nullptr) control->control->Cancel();
}

mtdb_code mtdb_control_progress(const mtdb_control* control, mtdb_progress* progress,
                                mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{control, "control"}, {progress, "progress"}}));
    const mtdb::QueryControl& c = *control->control;
    *progress = {c.clusters_loaded(), c.nodes_applied(), c.triangles_emitted(),
                 c.cancelled() ? 1 : 0};
    return Status::Ok();
  });
}

mtdb_code mtdb_select(mtdb_object* object, const mtdb_query* query, mtdb_cut** cut,
                      mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {cut, "cut"}}));
    const mtdb_query everything;
    const mtdb_query& asked = query == nullptr ? everything : *query;
    MTDB_ASSIGN_OR_RETURN(mtdb::Cut selected, object->surface->Select(asked.Build()));
    const size_t row_bytes = object->surface->record().attributes.row_bytes() +
                             (asked.rest.normals ? mtdb::internal::kNormalBytes : 0);
    *cut = new mtdb_cut{asked.control, object->surface, std::move(selected),
                        static_cast<uint32_t>(row_bytes)};
    return Status::Ok();
  });
}

void mtdb_free_cut(mtdb_cut* cut) { delete cut; }

mtdb_code mtdb_cut_stats(const mtdb_cut* cut, mtdb_stats* stats, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}, {stats, "stats"}}));
    const mtdb::ExtractStats& s = cut->cut.stats();
    *stats = {s.vertices,      s.triangles,  s.nodes_applied,
              s.clusters_read, s.bytes_read, s.error_bound};
    return Status::Ok();
  });
}

mtdb_code mtdb_cut_details(const mtdb_cut* cut, mtdb_details* details, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}, {details, "details"}}));
    const mtdb::ExtractStats& s = cut->cut.stats();
    mtdb_shortfall shortfall{};
    shortfall.triangles = s.shortfall.triangles;
    shortfall.excess = s.shortfall.excess;
    if (s.shortfall.any()) {
      mtdb::internal::Put(s.shortfall.bounds.min, shortfall.bounds_min);
      mtdb::internal::Put(s.shortfall.bounds.max, shortfall.bounds_max);
    }
    *details = {static_cast<mtdb_limit>(s.limit),
                cut->row_bytes,
                s.active_triangles,
                s.nodes_visited,
                s.nodes_forced,
                s.clusters_cached,
                s.clusters_used,
                s.clusters_total,
                s.seconds.select,
                s.seconds.load,
                s.seconds.read,
                s.seconds.decode,
                s.seconds.emit,
                shortfall};
    return Status::Ok();
  });
}

mtdb_code mtdb_cut_copy(mtdb_cut* cut, const mtdb_arrays* arrays, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}, {arrays, "arrays"}}));
    const uint64_t vertices = cut->cut.vertex_count();
    const uint64_t triangles = cut->cut.triangle_count();
    if (arrays->vertex_capacity < vertices || arrays->triangle_capacity < triangles) {
      return {mtdb::StatusCode::kBudgetExceeded,
              "the cut has " + std::to_string(vertices) + " vertices and " +
                  std::to_string(triangles) + " triangles, but the arrays have room for " +
                  std::to_string(arrays->vertex_capacity) + " and " +
                  std::to_string(arrays->triangle_capacity)};
    }
    if (arrays->indices != nullptr && vertices > uint64_t{1} << 32) {
      return mtdb::InvalidArgument("32-bit indices cannot number " + std::to_string(vertices) +
                                   " vertices; use mtdb_cut_emit");
    }
    if (arrays->positions_float != nullptr) {
      MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(arrays->origin), "origin"));
    }
    mtdb::internal::ArraySink sink(*arrays);
    return cut->cut.Emit(sink);
  });
}

mtdb_code mtdb_cut_emit(mtdb_cut* cut, const mtdb_sink* sink, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}, {sink, "sink"}}));
    mtdb::internal::CallbackSink callbacks(*sink);
    return cut->cut.Emit(callbacks);
  });
}

mtdb_code mtdb_closest_point(mtdb_object* object, const double point[3], double largest_error,
                             double max_distance, mtdb_hit* hit, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {point, "point"}, {hit, "hit"}}));
    MTDB_ASSIGN_OR_RETURN(
        const mtdb::ProbeAnswer answer,
        mtdb::FindClosestPoint(*object->surface, ToVec(point),
                               {.error_model = largest_error, .limit = max_distance}));
    mtdb::internal::PutAnswer(answer, hit);
    return Status::Ok();
  });
}

mtdb_code mtdb_cast_ray(mtdb_object* object, const double origin[3], const double direction[3],
                        double largest_error, double max_parameter, mtdb_hit* hit,
                        mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(
        NeedAll({{object, "object"}, {origin, "origin"}, {direction, "direction"}, {hit, "hit"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb::ProbeAnswer answer,
                          mtdb::CastRay(*object->surface, ToVec(origin), ToVec(direction),
                                        {.error_model = largest_error, .limit = max_parameter}));
    mtdb::internal::PutAnswer(answer, hit);
    return Status::Ok();
  });
}
