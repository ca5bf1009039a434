// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "store/base/coordinate_limit.h"
#include "tools/request/read_file.h"
#include "tools/tiles/file_piece.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/neuroglancer/draco_fragment.h"
#include "tools/tiles/neuroglancer/fragment_manifest.h"
#include "tools/tiles/neuroglancer/shard_file.h"
#include "tools/tiles/neuroglancer/write_neuroglancer.h"
#include "tools/tiles/verify/verifiers.h"

namespace mtdb {

namespace {

constexpr uint64_t kMostManifestBytes = uint64_t{1} << 30;

// Where a segment's bytes are.
struct Segment {
  std::string fragments, index;  // files
  uint64_t begin = 0;            // of the fragments in their file
  Bytes manifest;
};

class SegmentVerifier {
 public:
  SegmentVerifier(std::string folder, const Json& of, TileJudge* judge)
      : folder_(std::move(folder)), of_(of), judge_(*judge) {}

  Status Run() {
    const std::optional<uint64_t> id = FindId();
    if (!id) return Status::Ok();
    const Result<std::string> text = ReadPieceOf("info");
    const Json info = text.ok() ? Json::ParseObject(*text) : Json();
    if (At(info, "@type") != Json("neuroglancer_multilod_draco")) {
      throw UnexpectedJson("info is not of neuroglancer's meshes");
    }
    const uint64_t bits = CountOf(At(info, "vertex_quantization_bits"));
    if (bits != 10 && bits != 16) throw UnexpectedJson("expected positions of 10 or 16 bits");
    most_ = (1 << bits) - 1;
    resolution_ = ResolutionOf();
    for (int i = 0; i < 3; ++i) {
      moved_[i] = NumberOf(At(At(info, "transform"), static_cast<size_t>(4 * i + 3)));
    }
    const Result<Segment> segment = Find(*id, info);
    const auto manifest = segment.ok() ? DecodeManifest(segment->manifest) : segment.status();
    if (!manifest.ok()) {
      judge_.Fail(std::to_string(*id), manifest.status().message());
      return Status::Ok();
    }
    return VerifyLevels(*segment, *manifest);
  }

 private:
  std::optional<uint64_t> FindId() {
    for (const Json& object : ElementsOf(At(of_, "objects"))) {
      if (TextOf(At(object, "object")) != judge_.record().name) continue;
      if (At(object, "digest") != Json(judge_.record().digest_hex())) {
        judge_.Fail("mtdb-tiles.json",
                    "the tiles are of another version of the object; write them anew");
        return std::nullopt;
      }
      uint64_t id = 0;
      for (const char c : TextOf(At(object, "id"))) id = 10 * id + static_cast<uint64_t>(c - '0');
      return id;
    }
    judge_.Fail("mtdb-tiles.json", "no segment is of " + judge_.record().name);
    return std::nullopt;
  }

  Vec3d ResolutionOf() const {
    const double unit = NanometresOf(judge_.record());
    if (!of_.contains("resolution")) return {unit, unit, unit};
    Vec3d resolution;
    for (int i = 0; i < 3; ++i) {
      resolution[i] = NumberOf(At(At(of_, "resolution"), static_cast<size_t>(i)));
    }
    return resolution;
  }

  Result<std::string> ReadPieceOf(const std::string& name) const {
    return ReadFile(folder_ + "/" + name, kMostManifestBytes);
  }

  Result<Segment> Find(uint64_t id, const Json& info) const {
    Segment segment;
    if (!info.contains("sharding")) {
      segment.fragments = std::to_string(id);
      segment.index = segment.fragments + ".index";
      MTDB_ASSIGN_OR_RETURN(const std::string text, ReadPieceOf(segment.index));
      const ByteSpan bytes = AsBytes(text);
      segment.manifest.assign(bytes.begin(), bytes.end());
      return segment;
    }
    const std::optional<ShardLayout> layout = ShardLayoutOf(At(info, "sharding"));
    if (!layout) throw UnexpectedJson("info has shards of another kind");
    segment.fragments = segment.index = layout->FileOf(id);
    const std::string shard = folder_ + "/" + segment.index;
    MTDB_ASSIGN_OR_RETURN(const ShardPlace place, FindInShard(shard, *layout, id));
    MTDB_ASSIGN_OR_RETURN(segment.manifest, ReadPiece(shard, place.offset, place.bytes));
    MTDB_ASSIGN_OR_RETURN(const FragmentManifest manifest, DecodeManifest(segment.manifest));
    uint64_t all = 0;
    for (const ManifestLevel& level : manifest.levels) {
      for (const ManifestFragment& f : level.fragments) all += f.bytes;
    }
    if (all > place.offset) return Corrupt("has fragments before the beginning of its shard");
    segment.begin = place.offset - all;
    return segment;
  }

  Status VerifyLevels(const Segment& segment, const FragmentManifest& manifest) {
    uint64_t at = segment.begin;
    float scale = 0;
    std::vector<std::set<FragmentCell>> cells;
    for (const ManifestLevel& level : manifest.levels) {
      cells.emplace_back();
      for (const ManifestFragment& f : level.fragments) cells.back().insert(f.cell);
    }
    for (size_t level = 0; level < manifest.levels.size(); ++level) {
      const ManifestLevel& of_level = manifest.levels[level];
      if (!(of_level.scale > 0) || of_level.scale < scale) {
        judge_.Fail(segment.index, "the errors of levels do not rise");
      }
      scale = of_level.scale;
      for (const ManifestFragment& f : of_level.fragments) {
        if (level + 1 < cells.size() &&
            !cells[level + 1].contains({f.cell[0] / 2, f.cell[1] / 2, f.cell[2] / 2})) {
          judge_.Fail(segment.index,
                      NameOf(level, f.cell) + " lies in no fragment of the next level");
        }
        if (f.bytes == 0) continue;
        MTDB_RETURN_IF_ERROR(VerifyFragment(segment, manifest, level, f, at,
                                            level > 0 ? &cells[level - 1] : nullptr));
        at += f.bytes;
      }
    }
    return Status::Ok();
  }

  static std::string NameOf(size_t level, const FragmentCell& c) {
    return "fragment " + std::to_string(level) + "/" + std::to_string(c[0]) + "_" +
           std::to_string(c[1]) + "_" + std::to_string(c[2]);
  }

  Status VerifyFragment(const Segment& segment, const FragmentManifest& manifest, size_t level,
                        const ManifestFragment& f, uint64_t at,
                        const std::set<FragmentCell>* finer) {
    judge_.CountTile();
    const std::string name = segment.fragments + ": " + NameOf(level, f.cell);
    const Result<Bytes> bytes = ReadPiece(folder_ + "/" + segment.fragments, at, f.bytes);
    const Result<DracoFragment> fragment =
        bytes.ok() ? DecodeDracoFragment(*bytes) : Result<DracoFragment>(bytes.status());
    if (!fragment.ok()) {
      judge_.Fail(name, fragment.status().message());
      return Status::Ok();
    }
    for (const auto& p : fragment->positions) {
      if (std::all_of(p.begin(), p.end(), [&](int32_t q) { return q >= 0 && q <= most_; }))
        continue;
      judge_.Fail(name, "a vertex lies outside of its cell");
      return Status::Ok();
    }
    if (finer != nullptr) CheckOctants(*fragment, f.cell, *finer, name);
    const double side = std::ldexp(static_cast<double>(manifest.chunk[0]), static_cast<int>(level));
    std::vector<Vec3d> points;
    const size_t step = std::max<size_t>(fragment->triangles.size() / kPointsOfTile, 1);
    for (size_t t = 0; t < fragment->triangles.size(); t += step) {
      Vec3d middle;
      for (const uint32_t v : fragment->triangles[t]) {
        for (int i = 0; i < 3; ++i) {
          const auto axis = static_cast<size_t>(i);
          const double q = 1.0 * fragment->positions[v][axis] / most_ + f.cell[axis];
          middle[i] += (static_cast<double>(manifest.origin[axis]) + side * q) / 3;
        }
      }
      for (int i = 0; i < 3; ++i) middle[i] = (middle[i] + moved_[i]) / resolution_[i];
      if (AreCoordinates(middle)) points.push_back(middle);
    }
    // The least of the units: along others the same distance is more nanometres.
    return judge_.MeasureDistances(name, points,
                                   std::min({resolution_.x, resolution_.y, resolution_.z}),
                                   static_cast<double>(manifest.levels[level].scale));
  }

  // Clients draw the parts of a fragment apart, where the next level has no fragment.
  void CheckOctants(const DracoFragment& fragment, const FragmentCell& cell,
                    const std::set<FragmentCell>& finer, const std::string& name) {
    const int32_t middle = most_ / 2 + 1;
    for (const auto& t : fragment.triangles) {
      FragmentCell part{};
      for (size_t axis = 0; axis < 3; ++axis) {
        const auto [low, high] =
            std::minmax({fragment.positions[t[0]][axis], fragment.positions[t[1]][axis],
                         fragment.positions[t[2]][axis]});
        if (low < middle && high > middle)
          return judge_.Fail(name, "a triangle crosses its middle");
        part[axis] = 2 * cell[axis] + (high > middle ? 1 : 0);
      }
      if (!finer.contains(part)) {
        return judge_.Fail(name, "a part of it has no fragment in the next finer level");
      }
    }
  }

  const std::string folder_;
  const Json& of_;
  TileJudge& judge_;
  Vec3d resolution_, moved_;
  int32_t most_ = 1;
};

}  // namespace

Status VerifyNeuroglancer(const std::string& folder, const Json& of, TileJudge* judge) {
  return SegmentVerifier(folder, of, judge).Run();
}

}  // namespace mtdb
