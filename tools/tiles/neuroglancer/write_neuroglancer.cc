// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/neuroglancer/write_neuroglancer.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <filesystem>
#include <sys/stat.h>
#include <system_error>
#include <utility>

#include "codecs/mesh_file/atomic_file.h"
#include "store/base/out_of_memory.h"
#include "store/files/posix_file.h"
#include "tools/request/read_file.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/neuroglancer/fragment_manifest.h"
#include "tools/tiles/neuroglancer/shard_file.h"
#include "tools/tiles/tile_folder.h"

namespace mtdb {

namespace {

class NeuroglancerWriter {
 public:
  NeuroglancerWriter(const std::vector<NeuroglancerSegment>& segments, const SurfaceOpener& open,
                     const NeuroglancerSetOptions& set, const TileSetOptions& options,
                     TileFolder& folder)
      : segments_(segments),
        open_(open),
        set_(set),
        options_(options),
        folder_(folder),
        moved_(NeuroglancerMove(segments, set)) {}

  Result<TileSetReport> Run() {
    if (folder_.progress().contains("complete")) {
      MTDB_RETURN_IF_ERROR(RemoveParts());
      return WrittenBefore();
    }
    MTDB_RETURN_IF_ERROR(folder_.Record({{"levels", Json(Json::Array{})}}));
    const std::string parts = folder_.path() + "/" + kTileParts;
    if (::mkdir(parts.c_str(), 0777) != 0 && errno != EEXIST) {
      return Status(FileErrorCode(errno), parts + ": " + std::generic_category().message(errno));
    }
    for (size_t i = 0; i < segments_.size(); ++i) MTDB_RETURN_IF_ERROR(WriteParts(i));
    MTDB_RETURN_IF_ERROR(Assemble());
    MTDB_RETURN_IF_ERROR(WriteJson("segment_properties/info", NeuroglancerProperties(segments_)));
    Json info = NeuroglancerInfo(set_, moved_);
    if (layout_) info["sharding"] = layout_->ToJson();
    MTDB_RETURN_IF_ERROR(WriteJson("info", info));
    Json levels(Json::Array{});
    for (const TileLevel& level : report_.levels) levels.push_back(TileLevelJson(level));
    MTDB_RETURN_IF_ERROR(folder_.Record({{"levels", std::move(levels)},
                                         {"files", report_.files},
                                         {"complete", true},
                                         {"file_bytes", report_.file_bytes}}));
    MTDB_RETURN_IF_ERROR(RemoveParts());
    return report_;
  }

 private:
  std::string PartsOf(const NeuroglancerSegment& s) const {
    return folder_.path() + "/" + kTileParts + "/" + std::to_string(s.id);
  }
  // What is left of them, after a kill, too.
  Status RemoveParts() const {
    std::error_code error;
    for (const NeuroglancerSegment& s : segments_) {
      if (!std::filesystem::exists(PartsOf(s), error)) continue;
      MTDB_RETURN_IF_ERROR(TileFolder::Remove(PartsOf(s)));
    }
    std::filesystem::remove(folder_.path() + "/" + kTileParts, error);
    return Status::Ok();
  }
  Result<TileSetReport> WrittenBefore() {
    try {
      for (const Json& level : ElementsOf(At(folder_.progress(), "levels"))) {
        report_.levels.push_back(TileLevelOf(level));
      }
      report_.levels_found = static_cast<uint32_t>(report_.levels.size());
      report_.files = CountOf(At(folder_.progress(), "files"));
      report_.file_bytes = CountOf(At(folder_.progress(), "file_bytes"));
      return report_;
    } catch (const UnexpectedJson& error) {
      return Corrupt(folder_.path() + "/" + kTileRecord + ": " + error.what() +
                     "; remove the folder, and begin anew");
    }
  }

  // The fragments of a segment in a folder of their own.
  Status WriteParts(size_t index) {
    const NeuroglancerSegment& s = segments_[index];
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, open_(s.record));
    TileSetOptions options = options_;
    options.identity["moved"] = {moved_.x, moved_.y, moved_.z};
    if (options_.progress) {
      options.progress = [&](double part, const std::string& what) {
        const auto count = static_cast<double>(segments_.size());
        return options_.progress((static_cast<double>(index) + part) / count,
                                 s.record.name + ": " + what);
      };
    }
    const std::unique_ptr<TileFormat> format =
        MakeNeuroglancerLevels(s.record, NeuroglancerOptionsOf(s.record, set_, moved_));
    MTDB_ASSIGN_OR_RETURN(const TileSetReport report,
                          WriteTileSet(*surface, PartsOf(s), *format, options));
    report_.levels_found += report.levels_found;
    AddLevels(report.levels);
    return Status::Ok();
  }

  // By their distance from the finest.
  void AddLevels(const std::vector<TileLevel>& levels) {
    std::vector<TileLevel>& all = report_.levels;
    if (levels.size() > all.size())
      all.insert(all.begin(), levels.size() - all.size(), TileLevel());
    for (size_t i = 0; i < levels.size(); ++i) {
      TileLevel& sum = all[all.size() - levels.size() + i];
      sum.error_bound = std::max(sum.error_bound, levels[i].error_bound);
      sum.triangles += levels[i].triangles;
      sum.tiles += levels[i].tiles;
      sum.written_triangles += levels[i].written_triangles;
      sum.bytes += levels[i].bytes;
    }
  }

  // A segment's fragments, fine to coarse, and its manifest.
  Result<ShardEntry> EntryOf(const NeuroglancerSegment& s) const {
    ShardEntry entry;
    entry.id = s.id;
    MTDB_ASSIGN_OR_RETURN(const std::string text, ReadFile(PartsOf(s) + "/" + kFragmentManifest));
    MTDB_ASSIGN_OR_RETURN(const FragmentManifest manifest, DecodeManifest(AsBytes(text)));
    for (size_t level = 0; level < manifest.levels.size(); ++level) {
      for (const ManifestFragment& f : manifest.levels[level].fragments) {
        if (f.bytes > 0) entry.files.push_back(PartsOf(s) + "/" + FragmentPath(level, f.cell));
      }
    }
    const ByteSpan bytes = AsBytes(text);
    entry.manifest.assign(bytes.begin(), bytes.end());
    return entry;
  }

  Status Assemble() {
    std::vector<ShardEntry> entries;
    for (const NeuroglancerSegment& s : segments_) {
      MTDB_ASSIGN_OR_RETURN(ShardEntry entry, EntryOf(s));
      report_.file_bytes += entry.manifest.size();
      ++report_.files;
      if (set_.sharded) {
        entries.push_back(std::move(entry));
        continue;
      }
      const std::string name = std::to_string(s.id);
      MTDB_ASSIGN_OR_RETURN(const auto file, AtomicFile::Create(folder_.path() + "/" + name));
      for (const std::string& part : entry.files) {
        MTDB_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(part));
        MTDB_RETURN_IF_ERROR(file->Append(bytes));
      }
      MTDB_RETURN_IF_ERROR(file->Commit());
      MTDB_RETURN_IF_ERROR(folder_.Write(name + ".index", entry.manifest));
    }
    if (!set_.sharded) return Status::Ok();
    uint64_t bytes = 0;
    for (const TileLevel& level : report_.levels) bytes += level.bytes;
    layout_ = ChooseShards(segments_.size(), bytes);
    return WriteShards(folder_.path(), *layout_, entries);
  }

  Status WriteJson(const std::string& name, const Json& json) {
    const std::string text = json.Text() + "\n";
    report_.file_bytes += text.size();
    ++report_.files;
    return folder_.Write(name, AsBytes(text));
  }

  const std::vector<NeuroglancerSegment>& segments_;
  const SurfaceOpener& open_;
  const NeuroglancerSetOptions& set_;
  const TileSetOptions& options_;
  TileFolder& folder_;
  const Vec3d moved_;
  std::optional<ShardLayout> layout_;
  TileSetReport report_;
};

Json IdentityOf(const std::vector<NeuroglancerSegment>& segments, const NeuroglancerSetOptions& set,
                const Json& more) {
  Json objects(Json::Array{});
  for (const NeuroglancerSegment& s : segments) {
    objects.push_back({{"id", std::to_string(s.id)},
                       {"object", s.record.name},
                       {"digest", s.record.digest_hex()}});
  }
  Json identity = {{"format", "neuroglancer"}, {"objects", std::move(objects)},
                   {"bits", set.bits},         {"tile_triangles", set.tile_triangles},
                   {"pixels", set.pixels},     {"sharded", set.sharded}};
  if (const auto& r = set.resolution) identity["resolution"] = {r->x, r->y, r->z};
  if (more.is_object()) identity.Update(more);
  return identity;
}

}  // namespace

Result<TileSetReport> WriteNeuroglancer(const std::vector<NeuroglancerSegment>& segments,
                                        const SurfaceOpener& open, const std::string& path,
                                        const NeuroglancerSetOptions& set,
                                        const TileSetOptions& options) {
  for (const NeuroglancerSegment& s : segments) MTDB_RETURN_IF_ERROR(CheckSegment(s.record));
  return CatchOutOfMemory([&]() -> Result<TileSetReport> {
    TileSetOptions of_segment = options;
    of_segment.force = true;  // what is in "parts" is of this program alone
    of_segment.identity = {{"bits", set.bits}, {"tile_triangles", set.tile_triangles}};
    if (const auto& r = set.resolution) of_segment.identity["resolution"] = {r->x, r->y, r->z};
    MTDB_ASSIGN_OR_RETURN(
        const std::unique_ptr<TileFolder> folder,
        TileFolder::Open(path, IdentityOf(segments, set, options.identity), options.force));
    return NeuroglancerWriter(segments, open, set, of_segment, *folder).Run();
  });
}

}  // namespace mtdb
