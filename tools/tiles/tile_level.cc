// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/tile_level.h"

#include <optional>
#include <span>
#include <vector>

namespace mtdb {

namespace {

constexpr size_t kBucketBytes = 32;  // of a triangle while it is sorted

Status Tell(const PrepareOptions& options, const char* what, uint64_t triangles) {
  return options.tell ? options.tell(what, triangles) : Status::Ok();
}

// As long as the triangle is large.
void AddNormal(const TileFormat& format, const LevelMesh& mesh, const LevelTriangle& t,
               const Triangle3d& corners) {
  const Vec3d metres = format.MetresAt(corners[0]);
  const auto scaled = [&](Vec3d v) {
    return Vec3d{v.x * metres.x, v.y * metres.y, v.z * metres.z};
  };
  const Vec3d n = Cross(scaled(corners[1] - corners[0]), scaled(corners[2] - corners[0]));
  const Vec3f f{static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)};
  for (const uint32_t v : t) mesh.vertex(v).normal += f;
}

}  // namespace

PreparedLevel::PreparedLevel(TileFormat& format, const PrepareOptions& options)
    : mesh_(options.tmp_directory, [&format](Vec3d p) { return format.Place(p); }),
      buckets_(options.tmp_directory, options.memory_bytes / kBucketBytes) {}

Result<std::unique_ptr<PreparedLevel>> PreparedLevel::Make(const Surface& surface,
                                                           TileFormat& format, const Query& query,
                                                           const PrepareOptions& options) {
  MTDB_RETURN_IF_ERROR(Tell(options, "cut", 0));
  std::unique_ptr<PreparedLevel> level(new PreparedLevel(format, options));
  MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, surface.Extract(query, level->mesh_));
  MTDB_ASSIGN_OR_RETURN(const std::optional<uint32_t> tiles, format.Plan(level->mesh_, stats));
  if (!tiles) return std::unique_ptr<PreparedLevel>();
  level->tiles_ = *tiles;
  MTDB_RETURN_IF_ERROR(level->Sort(format, options));
  return level;
}

// Triangles go to their tiles, and their normals to their vertices.
Status PreparedLevel::Sort(TileFormat& format, const PrepareOptions& options) {
  const bool adds_normals = format.has_normals() && !mesh_.has_normals();
  std::vector<uint32_t> tiles;
  uint64_t done = 0;
  const Status visited = mesh_.Visit([&](std::span<const LevelTriangle> triangles) -> Status {
    MTDB_RETURN_IF_ERROR(Tell(options, "sort", mesh_.triangle_count() / 2 + done / 2));
    for (const LevelTriangle& t : triangles) {
      const Triangle3d corners = mesh_.Corners(t);
      format.TilesOf(corners, &tiles);
      for (const uint32_t tile : tiles) {
        format.Note(tile, corners);
        MTDB_RETURN_IF_ERROR(buckets_.Add(tile, t));
      }
      if (adds_normals) AddNormal(format, mesh_, t, corners);
    }
    done += triangles.size();
    return Status::Ok();
  });
  MTDB_RETURN_IF_ERROR(visited);
  return buckets_.Finish();
}

Result<TileFile> PreparedLevel::Encode(TileFormat& format, TileId id,
                                       std::vector<LevelTriangle>* triangles) const {
  MTDB_RETURN_IF_ERROR(buckets_.Read(id.tile, triangles));
  return format.Encode(id, *triangles, mesh_);
}

}  // namespace mtdb
