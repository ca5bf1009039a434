// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/tile_set.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "store/base/out_of_memory.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/tile_folder.h"
#include "tools/tiles/tile_level.h"

namespace mtdb {

namespace {

// One tree, level after level.
class TileWriter {
 public:
  TileWriter(const Surface& surface, TileFormat& format, const TileSetOptions& options,
             TileFolder& folder)
      : surface_(surface), format_(format), options_(options), folder_(folder) {}

  Result<TileSetReport> Run() {
    MTDB_RETURN_IF_ERROR(TakeEarlierLevels());
    while (const std::optional<Query> query = format_.NextLevel()) {
      MTDB_RETURN_IF_ERROR(WriteLevel(*query));
    }
    MTDB_ASSIGN_OR_RETURN(const auto files, format_.Finish());
    for (const auto& [name, text] : files) {
      MTDB_RETURN_IF_ERROR(folder_.Write(name, AsBytes(text)));
      report_.file_bytes += text.size();
    }
    report_.files = files.size();
    return report_;
  }

 private:
  Status TakeEarlierLevels() {
    const Json& progress = folder_.progress();
    if (!progress.contains("levels")) return Status::Ok();
    try {
      for (const Json& level : ElementsOf(At(progress, "levels")))
        report_.levels.push_back(TileLevelOf(level));
      report_.levels_found = static_cast<uint32_t>(report_.levels.size());
      for (const TileLevel& level : report_.levels) done_ += 2 * level.triangles;
      if (format_.Restore(At(progress, "state"), report_.levels_found)) return Status::Ok();
    } catch (const UnexpectedJson&) {
      // It lacks a member, or has one of another type.
    }
    return Corrupt(folder_.path() + "/" + kTileRecord +
                   ": the record of what is written is damaged; remove the folder, and begin anew");
  }

  Status Record() {
    Json levels(Json::Array{});
    for (const TileLevel& level : report_.levels) levels.push_back(TileLevelJson(level));
    return folder_.Record({{"levels", std::move(levels)}, {"state", format_.State()}});
  }

  // Some four thirds of the finest level are cut, then encoded.
  Status Tell(uint64_t of_level, const std::string& what) {
    if (!options_.progress) return Status::Ok();
    const double all = 8.0 / 3 * static_cast<double>(surface_.record().triangles);
    const double part = static_cast<double>(done_ + of_level) / std::max(all, 1.0);
    return options_.progress(std::min(part, 1.0),
                             "level " + std::to_string(report_.levels.size()) + ": " + what);
  }

  Status WriteLevel(const Query& query) {
    PrepareOptions prepare;
    prepare.tmp_directory = options_.tmp_directory;
    prepare.memory_bytes = options_.memory_bytes / 2;
    prepare.tell = [this](const char* what, uint64_t triangles) { return Tell(triangles, what); };
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<PreparedLevel> prepared,
                          PreparedLevel::Make(surface_, format_, query, prepare));
    if (prepared == nullptr) return Status::Ok();
    TileLevel level;
    MTDB_RETURN_IF_ERROR(EncodeTiles(*prepared, &level));
    const TileLevel told = format_.EndLevel();
    level.error_bound = told.error_bound;
    level.triangles = prepared->mesh().triangle_count();
    done_ += 2 * level.triangles;
    report_.levels.push_back(level);
    return Record();
  }

  Status EncodeTiles(const PreparedLevel& prepared, TileLevel* level) {
    const LevelMesh& mesh = prepared.mesh();
    const uint32_t tiles = prepared.tiles();
    std::atomic<uint32_t> next{0};
    std::mutex mutex;
    std::condition_variable changed;
    Status failure;
    unsigned working = 0;
    const auto work = [&] {
      std::vector<LevelTriangle> triangles;
      for (uint32_t tile = next++; tile < tiles; tile = next++) {
        uint64_t bytes = 0, written = 0;
        const Status status = CatchOutOfMemory(
            [&] { return EncodeTile(prepared, tile, &triangles, &bytes, &written); });
        const std::lock_guard lock(mutex);
        level->tiles += bytes > 0 ? 1 : 0;
        level->bytes += bytes;
        level->written_triangles += written;
        if (!status.ok() && failure.ok()) failure = status;
        if (!failure.ok()) break;
      }
      const std::lock_guard lock(mutex);
      --working;
      changed.notify_all();
    };
    const unsigned wanted = std::max(options_.threads, 1u);
    std::vector<std::jthread> threads;  // joined before what they use goes
    threads.reserve(wanted);
    while (threads.size() < wanted) {
      {
        const std::lock_guard lock(mutex);
        ++working;
      }
      try {
        threads.emplace_back(work);
      } catch (const std::system_error&) {  // no more threads
        if (threads.empty()) {
          work();
          break;
        }
        const std::lock_guard lock(mutex);
        --working;
        break;
      }
    }
    {
      std::unique_lock lock(mutex);
      while (working > 0) {
        changed.wait_for(lock, std::chrono::milliseconds(100));
        const uint64_t part =
            mesh.triangle_count() * std::min(next.load(), tiles) / std::max(tiles, 1u);
        const Status told =
            CatchOutOfMemory([&] { return Tell(mesh.triangle_count() + part, "write tiles"); });
        if (!told.ok() && failure.ok()) failure = told;
        mesh.Release();
      }
    }
    threads.clear();
    return failure;
  }

  Status EncodeTile(const PreparedLevel& prepared, uint32_t tile,
                    std::vector<LevelTriangle>* triangles, uint64_t* bytes, uint64_t* written) {
    const TileId id{static_cast<uint32_t>(report_.levels.size()), tile};
    MTDB_ASSIGN_OR_RETURN(const TileFile file, prepared.Encode(format_, id, triangles));
    if (file.bytes.empty()) return Status::Ok();
    MTDB_RETURN_IF_ERROR(folder_.Write(file.path, file.bytes));
    *bytes = file.bytes.size();
    *written = file.triangles;
    return Status::Ok();
  }

  const Surface& surface_;
  TileFormat& format_;
  const TileSetOptions& options_;
  TileFolder& folder_;
  TileSetReport report_;
  uint64_t done_ = 0;  // twice the triangles of the levels that are written
};

}  // namespace

Json TileLevelJson(const TileLevel& level) {
  return {{"error_bound", level.error_bound},
          {"triangles", level.triangles},
          {"tiles", level.tiles},
          {"written_triangles", level.written_triangles},
          {"bytes", level.bytes}};
}

TileLevel TileLevelOf(const Json& json) {
  return {NumberOf(At(json, "error_bound")), CountOf(At(json, "triangles")),
          CountOf(At(json, "tiles")), CountOf(At(json, "written_triangles")),
          CountOf(At(json, "bytes"))};
}

Result<TileSetReport> WriteTileSet(const Surface& surface, const std::string& path,
                                   TileFormat& format, const TileSetOptions& options) {
  return CatchOutOfMemory([&]() -> Result<TileSetReport> {
    Json identity = {{"format", format.name()},
                     {"object", surface.record().name},
                     {"digest", surface.record().digest_hex()}};
    if (options.identity.is_object()) identity.Update(options.identity);
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<TileFolder> folder,
                          TileFolder::Open(path, identity, options.force));
    return TileWriter(surface, format, options, *folder).Run();
  });
}

}  // namespace mtdb
