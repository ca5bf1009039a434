// SPDX-License-Identifier: Apache-2.0
// What C makes and changes stores with.
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "builder/build.h"
#include "codecs/mesh_file/atomic_file.h"
#include "codecs/mesh_file/mesh_file.h"
#include "store/copy.h"
#include "store/object_name.h"
#include "store/packed_file.h"
#include "store/texture_pages.h"
#include "tools/c/internal/handles.h"
#include "tools/c/internal/ingest.h"
#include "tools/c/internal/mesh.h"
#include "tools/c/internal/watch.h"
#include "tools/c/mtdb_write.h"
#include "tools/gdal/raster_input.h"

// NOLINTNEXTLINE(readability-identifier-naming)
struct mtdb_ingest {
  mtdb::MeshSink* sink;
  size_t row_bytes;
  mtdb::Status status;  // the first error
};

namespace mtdb::internal {

namespace {

// The store's folder where none is named.
std::string TmpFolderOf(const mtdb_ingest_options& o, const std::string& store) {
  if (o.tmp_directory != nullptr) return o.tmp_directory;
  const std::string folder = std::filesystem::path(store).parent_path().string();
  return folder.empty() ? "." : folder;
}

Result<BuildOptions> OptionsOf(const mtdb_ingest_options& o, const std::string& store) {
  BuildOptions options;
  options.mode = o.lossless != 0 ? PositionMode::kLossless : PositionMode::kGrid;
  if (o.lossless != 0 && (o.bits != 0 || o.step != 0)) {
    return InvalidArgument("options.lossless: goes with neither bits nor step");
  }
  if (o.bits != 0 && o.step != 0) return InvalidArgument("options: give either bits or step");
  if (o.bits > 24) {
    return InvalidArgument("options.bits: expected 1 to 24, found " + std::to_string(o.bits));
  }
  if (o.bits != 0) options.bits = static_cast<int>(o.bits);
  if (o.step != 0) options.step = o.step;
  if (o.weld > 0) options.weld = o.weld_distance;
  options.keep_apart = o.weld < 0;
  options.orient = o.orient != 0;
  if (o.normal_bits > 16) {
    return InvalidArgument("options.normal_bits: expected 4 to 16, found " +
                           std::to_string(o.normal_bits));
  }
  if (o.normal_bits != 0) options.normal_bits = static_cast<int>(o.normal_bits);
  MTDB_ASSIGN_OR_RETURN(const auto steps, TakeAll(o.attribute_steps, o.attribute_step_count,
                                                  "options.attribute_steps"));
  for (const mtdb_attribute_step& step : steps) {
    MTDB_RETURN_IF_ERROR(NeedAll({{step.name, "options.attribute_steps.name"}}));
    options.attribute_steps.push_back({step.name, step.step});
  }
  if (o.threads > kMostThreads) {
    return InvalidArgument("options.threads: " + std::to_string(o.threads) + " are more than " +
                           std::to_string(kMostThreads));
  }
  options.threads = o.threads;
  if (o.memory_bytes != 0) options.memory_bytes = o.memory_bytes;
  if (o.max_tmp_bytes != 0) options.max_tmp_bytes = o.max_tmp_bytes;
  options.tmp_directory = TmpFolderOf(o, store);
  if (o.journal_path != nullptr) options.journal_path = o.journal_path;
  if (o.resume != 0 && options.journal_path.empty()) {
    return InvalidArgument("options.resume: needs a journal_path");
  }
  options.resume = o.resume != 0;
  const Vec3d up{o.up[0], o.up[1], o.up[2]};
  if (up != Vec3d{}) options.up = up;
  if (o.units != nullptr) options.units = o.units;
  return options;
}

// The packed file's objects: the given ones, or all.
Result<ObjectSources> SourcesOf(const Database& database, const char* const* names, size_t count) {
  ObjectSources sources;
  if (count == 0) {
    MTDB_ASSIGN_OR_RETURN(const std::vector<ObjectRecord> records, database.List());
    for (const ObjectRecord& r : records) {
      MTDB_ASSIGN_OR_RETURN(sources.emplace_back(), database.OpenObject(r.name, true));
    }
    if (sources.empty()) return NotFound(database.path() + ": the store holds no object");
    return sources;
  }
  MTDB_RETURN_IF_ERROR(NeedAll({{names, "names"}}));
  std::set<std::string> seen;
  for (size_t i = 0; i < count; ++i) {
    MTDB_RETURN_IF_ERROR(NeedAll({{names[i], "names"}}));
    if (!seen.insert(names[i]).second) {
      return InvalidArgument("names: " + std::string(names[i]) + " is given twice");
    }
    MTDB_ASSIGN_OR_RETURN(sources.emplace_back(), database.OpenObject(names[i], true));
  }
  return sources;
}

CopyProgress CopyWatch(const Watch& watch, const char* stage) {
  return [&watch, stage](uint64_t done, uint64_t total) {
    return watch.Look(stage,
                      total == 0 ? 1 : static_cast<double>(done) / static_cast<double>(total));
  };
}

}  // namespace

Status Ingest(mtdb_database* database, const char* name, const MeshProducer& input,
              const mtdb_ingest_options* options, const mtdb_watch* watch,
              std::optional<TerrainInput> terrain) {
  MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {name, "name"}}));
  MTDB_RETURN_IF_ERROR(CheckObjectName(name));
  MTDB_ASSIGN_OR_RETURN(const mtdb_ingest_options given, Take(options, "options"));
  MTDB_ASSIGN_OR_RETURN(const Watch watcher, Watch::Of(watch));
  Database& store = *database->database;
  MTDB_ASSIGN_OR_RETURN(BuildOptions build, OptionsOf(given, store.path()));
  if (!terrain && given.height_step != 0) {
    return InvalidArgument("options.height_step: is for rasters of heights");
  }
  if (!terrain && given.fill != 0) {
    return InvalidArgument("options.fill: is for rasters of heights");
  }
  build.terrain = std::move(terrain);
  build.height_field = given.terrain != 0 && !build.terrain;
  MTDB_ASSIGN_OR_RETURN(const auto writer, store.Create(name, given.replace != 0));
  return BuildObject(input, build, *writer,
                     [&](const BuildProgress& p) {
                       const std::string stage =
                           p.round == 0 ? p.stage : "round " + std::to_string(p.round);
                       return watcher.Look(stage.c_str(), p.overall);
                     })
      .status();
}

Result<Watch> Watch::Of(const mtdb_watch* watch) {
  MTDB_ASSIGN_OR_RETURN(const mtdb_watch given, Take(watch, "watch"));
  return Watch(given);
}

Status Watch::Look(const char* stage, double overall) const {
  if (watch_.control != nullptr && watch_.control->control->cancelled()) {
    return {StatusCode::kCancelled, "cancelled"};
  }
  if (watch_.progress == nullptr) return Status::Ok();
  return Answer(watch_.progress(watch_.user, stage, overall));
}

}  // namespace mtdb::internal

using mtdb::Result;
using mtdb::Status;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::Take;
using mtdb::internal::Watch;

mtdb_code mtdb_open_writable_abi(uint32_t abi_version, const char* path, mtdb_database** database,
                                 mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(mtdb::internal::CheckAbi(abi_version));
    MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}, {database, "database"}}));
    MTDB_ASSIGN_OR_RETURN(auto opened, mtdb::Database::Open(path, {.writable = true}));
    *database = new mtdb_database{std::move(opened)};
    return Status::Ok();
  });
}

mtdb_code mtdb_ingest_arrays(mtdb_database* database, const char* name, const mtdb_input* input,
                             const mtdb_ingest_options* options, const mtdb_watch* watch,
                             mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{input, "input"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_input given, Take(input, "input"));
    MTDB_ASSIGN_OR_RETURN(const mtdb::AttributeLayout layout,
                          mtdb::internal::LayoutOf(given.attributes, given.attribute_count));
    return mtdb::internal::Ingest(
        database, name,
        [&](mtdb::MeshSink& sink) { return mtdb::internal::SendInput(given, layout, sink); },
        options, watch);
  });
}

mtdb_code mtdb_ingest_source(mtdb_database* database, const char* name, const mtdb_source* source,
                             const mtdb_ingest_options* options, const mtdb_watch* watch,
                             mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{source, "source"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_source given, Take(source, "source"));
    if (given.produce == nullptr) return mtdb::InvalidArgument("source.produce: is NULL");
    mtdb::MeshHeader header;
    MTDB_ASSIGN_OR_RETURN(header.attributes,
                          mtdb::internal::LayoutOf(given.attributes, given.attribute_count));
    header.double_positions = given.double_positions != 0;
    const auto produce = [&](mtdb::MeshSink& sink) -> Status {
      MTDB_RETURN_IF_ERROR(sink.Begin(header));
      mtdb_ingest ingest{&sink, header.attributes.row_bytes(), Status::Ok()};
      const int stop = given.produce(given.user, &ingest);
      MTDB_RETURN_IF_ERROR(ingest.status);
      MTDB_RETURN_IF_ERROR(mtdb::internal::Answer(stop));
      return sink.End();
    };
    return mtdb::internal::Ingest(database, name, produce, options, watch);
  });
}

mtdb_code mtdb_ingest_part(mtdb_ingest* ingest, const mtdb_input* part, mtdb_error* error) {
  if (ingest == nullptr) {
    return Guarded(error, [] { return NeedAll({{nullptr, "ingest"}}); });
  }
  const mtdb_code code = Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(ingest->status);
    MTDB_RETURN_IF_ERROR(NeedAll({{part, "part"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_input given, Take(part, "part"));
    ingest->status = mtdb::internal::SendPart(given, ingest->row_bytes, *ingest->sink);
    return ingest->status;
  });
  if (code == MTDB_NO_SPACE && ingest->status.ok()) ingest->status = mtdb::OutOfMemory();
  return code;
}

mtdb_code mtdb_ingest_file(mtdb_database* database, const char* name, const char* path,
                           const mtdb_ingest_options* options, const mtdb_watch* watch,
                           mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {path, "path"}}));
    if (mtdb::IsRaster(path)) {
      return mtdb::internal::IngestRasters(database, name, &path, 1, options, watch);
    }
    MTDB_ASSIGN_OR_RETURN(mtdb_ingest_options given, Take(options, "options"));
    MTDB_ASSIGN_OR_RETURN(const Watch watcher, Watch::Of(watch));
    mtdb::MeshReadOptions reading;
    reading.tmp_directory = mtdb::internal::TmpFolderOf(given, database->database->path());
    if (given.max_tmp_bytes != 0) reading.max_tmp_bytes = given.max_tmp_bytes;
    reading.look = [&] { return watcher.Look("read", 0); };
    MTDB_ASSIGN_OR_RETURN(const mtdb::MeshInput input, mtdb::MeshInput::Open(path, reading));
    if (given.max_tmp_bytes != 0) {
      given.max_tmp_bytes = std::max<uint64_t>(1, given.max_tmp_bytes - input.temporary_bytes());
      given.struct_bytes = sizeof(given);
      options = &given;
    }
    const auto read = [&](mtdb::MeshSink& sink) {
      mtdb::MeshReadReport report;
      return input.Read(sink, &report);
    };
    return mtdb::internal::Ingest(database, name, read, options, watch);
  });
}

mtdb_code mtdb_remove_object(mtdb_database* database, const char* name, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {name, "name"}}));
    return database->database->Remove(name);
  });
}

mtdb_code mtdb_rename_object(mtdb_database* database, const char* name, const char* new_name,
                             mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {name, "name"}, {new_name, "new_name"}}));
    return database->database->Rename(name, new_name);
  });
}

mtdb_code mtdb_copy_object(mtdb_object* object, mtdb_database* target, const char* name,
                           int replace, const mtdb_watch* watch, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{object, "object"}, {target, "target"}, {name, "name"}}));
    MTDB_ASSIGN_OR_RETURN(const Watch watcher, Watch::Of(watch));
    // All rows of its index are needed, which an object behind a URL may lack.
    MTDB_ASSIGN_OR_RETURN(const auto source,
                          object->database->OpenObject(object->surface->record().name, true));
    return mtdb::CopyObject(*source, *target->database, name, replace != 0,
                            mtdb::internal::CopyWatch(watcher, "copy"))
        .status();
  });
}

mtdb_code mtdb_copy_store(mtdb_database* database, const char* path, const mtdb_watch* watch,
                          mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {path, "path"}}));
    MTDB_ASSIGN_OR_RETURN(const Watch watcher, Watch::Of(watch));
    mtdb::ObjectSources sources;
    if (database->database->is_packed()) {
      MTDB_ASSIGN_OR_RETURN(sources, mtdb::internal::SourcesOf(*database->database, nullptr, 0));
    } else {
      MTDB_ASSIGN_OR_RETURN(sources, database->database->OpenAll());
    }
    return mtdb::CopyToNewStore(sources, path, mtdb::internal::CopyWatch(watcher, "copy"));
  });
}

mtdb_code mtdb_compact_store(const char* path, const mtdb_watch* watch, mtdb_sizes* sizes,
                             mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}}));
    MTDB_ASSIGN_OR_RETURN(const Watch watcher, Watch::Of(watch));
    MTDB_ASSIGN_OR_RETURN(const mtdb::CompactReport report,
                          mtdb::CompactStore(path, mtdb::internal::CopyWatch(watcher, "compact")));
    if (sizes == nullptr) return Status::Ok();
    return mtdb::internal::PutStruct(mtdb_sizes{0, report.bytes_before, report.bytes_after, 0},
                                     "sizes", sizes);
  });
}

mtdb_code mtdb_pack(mtdb_database* database, const char* const* names, size_t count,
                    const char* path, const mtdb_watch* watch, mtdb_sizes* sizes,
                    mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {path, "path"}}));
    MTDB_ASSIGN_OR_RETURN(const Watch watcher, Watch::Of(watch));
    MTDB_ASSIGN_OR_RETURN(const auto sources,
                          mtdb::internal::SourcesOf(*database->database, names, count));
    uint64_t total = 0;
    uint64_t textures = 0;
    uint64_t done = 0;
    for (const auto& source : sources) {
      total += source->record().payload_bytes;
      textures += mtdb::TextureBytes(source->record());
    }
    // As `mtdb pack`: others of the file's objects would be lost.
    const std::string kept = count == 0 ? "" : database->database->path();
    MTDB_ASSIGN_OR_RETURN(
        const auto file,
        mtdb::AtomicFile::Create(path, {.replaces_packed_file = true, .source = kept}));
    MTDB_ASSIGN_OR_RETURN(
        const mtdb::PackReport report,
        mtdb::PackObjects(sources, [&](mtdb::ByteSpan bytes) -> Status {
          done += bytes.size();
          MTDB_RETURN_IF_ERROR(
              watcher.Look("pack", std::min(1.0, static_cast<double>(done) /
                                                     static_cast<double>(total + textures + 1))));
          return file->Append(bytes);
        }));
    MTDB_RETURN_IF_ERROR(file->Commit());
    if (sizes == nullptr) return Status::Ok();
    return mtdb::internal::PutStruct(mtdb_sizes{0, total, report.file_bytes, report.first_bytes},
                                     "sizes", sizes);
  });
}

mtdb_code mtdb_unpack(mtdb_database* database, const char* const* names, size_t count,
                      const char* path, int replace, const mtdb_watch* watch, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{database, "database"}, {path, "path"}}));
    MTDB_ASSIGN_OR_RETURN(const Watch watcher, Watch::Of(watch));
    if (!database->database->is_packed()) {
      return mtdb::InvalidArgument("database: expected a packed file, found a store");
    }
    MTDB_ASSIGN_OR_RETURN(const auto sources,
                          mtdb::internal::SourcesOf(*database->database, names, count));
    return mtdb::CopyToStore(sources, path, replace != 0,
                             mtdb::internal::CopyWatch(watcher, "unpack"));
  });
}
