// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/neuroglancer/segment_files.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "tools/tiles/part_file.h"
#include "tools/tiles/tile_level.h"

namespace mtdb {

namespace {

// Files of fragments, one after the other.
using PartFiles = std::vector<std::unique_ptr<PartFile>>;

class PartContent final : public TileContent {
 public:
  explicit PartContent(const PartFiles& parts) : parts_(parts) {}
  uint64_t size() const override {
    uint64_t bytes = 0;
    for (const auto& part : parts_) bytes += part->size_bytes();
    return bytes;
  }
  Result<Bytes> Read(ByteRange range) const override {
    Bytes bytes(range.bytes);
    uint64_t begin = 0;  // of the part
    for (const auto& part : parts_) {
      const uint64_t end = begin + part->size_bytes();
      const uint64_t from = std::max(begin, range.offset);
      const uint64_t to = std::min(end, range.offset + range.bytes);
      if (from < to) {
        MTDB_RETURN_IF_ERROR(
            part->Read(from - begin, std::span(bytes).subspan(from - range.offset, to - from)));
      }
      begin = end;
    }
    return bytes;
  }

 private:
  const PartFiles& parts_;
};

class SegmentFiles final : public TileFiles {
 public:
  Status Make(const Surface& surface, const NeuroglancerSetOptions& set,
              const TileFilesOptions& options) {
    const ObjectRecord& record = surface.record();
    id_ = std::to_string(SegmentIdIn(record.name).value_or(1));
    const std::vector<NeuroglancerSegment> segment{{SegmentIdIn(record.name).value_or(1), record}};
    const Vec3d moved = NeuroglancerMove(segment, set);
    const auto format = MakeNeuroglancerLevels(record, NeuroglancerOptionsOf(record, set, moved));
    while (std::optional<Query> query = format->NextLevel()) {
      query->control = options.control;
      MTDB_RETURN_IF_ERROR(AddLevel(surface, *query, *format, options));
    }
    MTDB_ASSIGN_OR_RETURN(auto files, format->Finish());  // the manifest
    files_[id_ + ".index"] = std::move(files.at(0).second);
    files_["info"] = NeuroglancerInfo(set, moved).Text() + "\n";
    files_["segment_properties/info"] = NeuroglancerProperties(segment).Text() + "\n";
    return Status::Ok();
  }

  uint64_t file_bytes() const override { return PartContent(parts_).size(); }

  Result<std::unique_ptr<const TileContent>> Find(const std::string& path) const override {
    std::unique_ptr<const TileContent> content;
    if (const auto file = files_.find(path); file != files_.end()) {
      const ByteSpan text = AsBytes(file->second);
      content = std::make_unique<TileBytes>(Bytes(text.begin(), text.end()));
    } else if (path == id_) {
      content = std::make_unique<PartContent>(parts_);
    }
    return content;
  }

 private:
  // Levels are made coarse to fine, and lie fine to coarse.
  Status AddLevel(const Surface& surface, const Query& query, TileFormat& format,
                  const TileFilesOptions& options) {
    const auto tell = [control = options.control] {
      const bool stopped = control != nullptr && control->cancelled();
      return stopped ? Status(StatusCode::kCancelled, "cancelled") : Status::Ok();
    };
    PrepareOptions prepare;
    prepare.tmp_directory = options.tmp_directory;
    prepare.tell = [&tell](const char*, uint64_t) { return tell(); };
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<PreparedLevel> level,
                          PreparedLevel::Make(surface, format, query, prepare));
    if (level == nullptr) return Status::Ok();
    MTDB_ASSIGN_OR_RETURN(std::unique_ptr<PartFile> part, PartFile::Create(options.tmp_directory));
    std::vector<LevelTriangle> triangles;
    for (uint32_t tile = 0; tile < level->tiles(); ++tile) {
      MTDB_RETURN_IF_ERROR(tell());
      const TileId id{static_cast<uint32_t>(parts_.size()), tile};
      MTDB_ASSIGN_OR_RETURN(const TileFile file, level->Encode(format, id, &triangles));
      MTDB_RETURN_IF_ERROR(part->Append(file.bytes));
    }
    format.EndLevel();
    parts_.insert(parts_.begin(), std::move(part));
    return Status::Ok();
  }

  std::string id_;
  PartFiles parts_;  // of the levels, fine to coarse
  std::map<std::string, std::string> files_;
};

}  // namespace

Result<std::unique_ptr<TileFiles>> MakeSegmentFiles(const Surface& surface,
                                                    const NeuroglancerSetOptions& set,
                                                    const TileFilesOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckSegment(surface.record()));
  auto files = std::make_unique<SegmentFiles>();
  MTDB_RETURN_IF_ERROR(files->Make(surface, set, options));
  return std::unique_ptr<TileFiles>(std::move(files));
}

}  // namespace mtdb
