// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/input_spool.h"

#include <algorithm>
#include <utility>

#include "builder/intake/corner_gather.h"
#include "builder/intake/near_join.h"
#include "builder/intake/seam_join.h"
#include "builder/intake/soup_join.h"
#include "store/base/coordinate_limit.h"

namespace mtdb::internal {

InputSpool::InputSpool(const SpoolSpace* space, size_t memory_bytes, bool lossless)
    : space_(space), memory_bytes_(memory_bytes), soup_spool_(space, 0), lossless_(lossless) {}

Status InputSpool::Begin(const MeshHeader& header) {
  MTDB_CHECK(!begun_, "a mesh begins once");
  begun_ = true;
  header_ = header;
  for (Spool* spool : {&soup_spool_, &vertex_spool_, &triangle_spool_}) {
    *spool = Spool(space_, memory_bytes_ / 4);
  }
  if (header.textured) {
    if (header.soup) return InvalidArgument("a triangle soup with texture coordinates");
    corners_ = CornerSpool(space_, memory_bytes_ / 4, header.texture_step, header.textures.size());
  }
  doubles_ = header.double_positions || (header.from_text && !lossless_);
  row_bytes_ = header.attributes.row_bytes();
  return Status::Ok();
}

Status InputSpool::AddVertices(std::span<const Vec3d> positions, ByteSpan rows) {
  MTDB_CHECK(rows.size() == positions.size() * row_bytes_, "a row for each vertex");
  for (size_t i = 0; i < positions.size(); ++i) {
    const Vec3d p = positions[i];
    const auto where = [&] { return "vertex " + std::to_string(report_.vertices); };
    if (!AreCoordinates(p)) {
      return BadInput(where() + ": coordinates are not numbers from -1e30 to 1e30");
    }
    const Vec3f f{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
    const Vec3d single{f.x, f.y, f.z};
    if (lossless_ && single != p && !MayMean(p, f)) {
      return BadInput(where() +
                      ": a coordinate does not fit float32, so that --lossless would "
                      "lose it; use --step or --bits");
    }
    if (!doubles_) rounding_ = std::max(rounding_, Length(single - p));
    const void* const position = doubles_ ? static_cast<const void*>(&p) : &f;
    if (header_.soup) {
      ++report_.vertices;
      MTDB_RETURN_IF_ERROR(soup_spool_.Append(position, position_bytes()));
      continue;
    }
    MTDB_RETURN_IF_ERROR(vertex_spool_.Append(position, position_bytes()));
    if (row_bytes_ != 0) {
      MTDB_RETURN_IF_ERROR(vertex_spool_.Append(rows.data() + i * row_bytes_, row_bytes_));
    }
    if (++report_.vertices > kMaxVertices) return TooManyVertices();
  }
  return Status::Ok();
}

Result<bool> InputSpool::AppendTriangle(const std::array<uint32_t, 3>& t) {
  if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
    ++report_.degenerate_triangles;
    return false;
  }
  MTDB_RETURN_IF_ERROR(triangle_spool_.Append(t.data(), kTriangleBytes));
  return true;
}

// A stray vertex must not make the grid coarser.
Status InputSpool::FindBounds() {
  std::vector<bool> referenced(vertices_, false);
  SpoolReader triangle_reader(&triangle_spool_);
  for (uint64_t left = triangles(); left > 0; --left) {
    std::array<uint32_t, 3> t;
    if (!triangle_reader.Get(&t)) return triangle_reader.status();
    for (const uint32_t v : t) referenced[v] = true;
  }
  SpoolReader vertex_reader(&vertex_spool_);
  for (uint64_t v = 0; v < vertices_; ++v) {
    const std::byte* bytes = vertex_reader.Next(vertex_bytes());
    if (bytes == nullptr) return vertex_reader.status();
    if (!referenced[v]) continue;
    bounds_.Add(Position(bytes));
    if (!lossless_) decimals_.Add(Position(bytes), is_single());
  }
  return Status::Ok();
}

Status InputSpool::AddTriangles(std::span<const TriangleVertices> triangles) {
  appended_.clear();
  for (const TriangleVertices& t : triangles) {
    for (const VertexIndex v : t) {
      if (v > largest_index_) {
        largest_index_ = v;
        largest_at_ = report_.triangles;
      }
    }
    ++report_.triangles;
    if (header_.soup) continue;                   // their corners are all that there is to know
    if (largest_index_ > kMaxVertices) continue;  // an error, at End()
    MTDB_ASSIGN_OR_RETURN(const bool stays,
                          AppendTriangle({static_cast<uint32_t>(t[0]), static_cast<uint32_t>(t[1]),
                                          static_cast<uint32_t>(t[2])}));
    if (header_.textured) appended_.push_back(stays);
  }
  return Status::Ok();
}

Status InputSpool::AddCorners(std::span<const TextureCorner> corners) {
  if (!header_.textured || largest_index_ > kMaxVertices) return Status::Ok();
  MTDB_CHECK(corners.size() == 3 * appended_.size(), "three corners for each triangle");
  const uint64_t first = report_.triangles - appended_.size();
  for (size_t i = 0; i < appended_.size(); ++i) {
    if (!appended_[i]) continue;
    MTDB_RETURN_IF_ERROR(
        corners_.Add({corners[3 * i], corners[3 * i + 1], corners[3 * i + 2]}, first + i));
  }
  appended_.clear();
  return Status::Ok();
}

Status InputSpool::End() {
  if (report_.triangles != 0 && largest_index_ >= report_.vertices) {
    return BadInput("triangle " + std::to_string(largest_at_) + ": vertex index " +
                    std::to_string(static_cast<int64_t>(largest_index_)) +  // -1, not 2^64 - 1
                    ", but the mesh has " + std::to_string(report_.vertices) + " vertices");
  }
  if (header_.soup) {
    MTDB_RETURN_IF_ERROR(soup_spool_.Finish());
    MTDB_ASSIGN_OR_RETURN(
        report_.vertices,
        JoinSoup(soup_spool_, doubles_, space_, memory_bytes_ / 4, &vertex_spool_,
                 [&](const std::array<uint32_t, 3>& t) { return AppendTriangle(t).status(); }));
    soup_spool_ = Spool(space_, 0);
  }
  vertices_ = report_.vertices;
  MTDB_RETURN_IF_ERROR(vertex_spool_.Finish());
  MTDB_RETURN_IF_ERROR(triangle_spool_.Finish());
  if (header_.textured) {
    MTDB_RETURN_IF_ERROR(corners_.Finish(texture_step_given_));
    header_.texture_step = corners_.step();
    MTDB_CHECK(corners_.triangles() == triangles(), "three corners for each triangle");
  }
  if (weld_ && vertices_ != 0) {
    if (!header_.soup) MTDB_RETURN_IF_ERROR(WeldEqual());
    if (*weld_ > 0) MTDB_RETURN_IF_ERROR(WeldNear());
  } else if (join_seams_ && !header_.soup && triangles() != 0) {
    MTDB_RETURN_IF_ERROR(WeldSeams());
  }
  if (triangles() == 0) {
    return BadInput("no triangle to keep: " + std::to_string(report_.triangles) + " read, " +
                    std::to_string(report_.degenerate_triangles) +
                    " of them with two equal vertices; mtdb stores surfaces");
  }
  return FindBounds();
}

Status InputSpool::WeldEqual() {
  Spool left(space_, memory_bytes_ / 4), numbers(space_, memory_bytes_ / 8);
  MTDB_ASSIGN_OR_RETURN(
      vertices_,
      JoinEqualPositions(vertex_spool_, doubles_, row_bytes_, space_, memory_bytes_ / 4, &left,
                         [&](uint32_t number) { return numbers.Append(&number, sizeof(number)); }));
  vertex_spool_ = std::move(left);
  MTDB_RETURN_IF_ERROR(vertex_spool_.Finish());
  return Renumber(numbers);
}

Status InputSpool::WeldNear() {
  Spool left(space_, memory_bytes_ / 4), numbers(space_, memory_bytes_ / 8);
  const NearJoinInput input{&vertex_spool_, vertex_bytes(),
                            [&](const std::byte* vertex) { return Position(vertex); }, *weld_};
  MTDB_ASSIGN_OR_RETURN(const NearJoinTotals totals,
                        JoinNear(input, space_, memory_bytes_ / 2, &left, &numbers));
  vertices_ = totals.vertices;
  rounding_ += totals.displacement;
  vertex_spool_ = std::move(left);
  MTDB_RETURN_IF_ERROR(vertex_spool_.Finish());
  return Renumber(numbers);
}

Status InputSpool::WeldSeams() {
  Spool left(space_, memory_bytes_ / 4), triangles_left(space_, memory_bytes_ / 4);
  SeamJoinInput input{&vertex_spool_, vertex_bytes(), doubles_, &triangle_spool_, {}};
  if (textured()) {
    corners_.BeginKeeping();
    input.told = [&](bool stays) { return corners_.Keep(stays); };
  }
  MTDB_ASSIGN_OR_RETURN(const SeamJoinTotals totals,
                        internal::JoinSeams(input, space_, memory_bytes_, &left, &triangles_left));
  equal_vertices_ = totals.equal;
  attributes_differ_ = totals.attributes_differ;
  if (totals.joined == 0) {
    corners_.KeepAll();
    return Status::Ok();
  }
  if (textured()) MTDB_RETURN_IF_ERROR(corners_.EndKeeping());
  vertices_ = totals.vertices;
  vertex_spool_ = std::move(left);
  MTDB_RETURN_IF_ERROR(vertex_spool_.Finish());
  const uint64_t before = triangles();
  triangle_spool_ = std::move(triangles_left);
  MTDB_RETURN_IF_ERROR(triangle_spool_.Finish());
  report_.degenerate_triangles += before - triangles();
  return Status::Ok();
}

Status InputSpool::Renumber(Spool& numbers) {
  MTDB_RETURN_IF_ERROR(numbers.Finish());
  const Spool old = std::exchange(triangle_spool_, Spool(space_, memory_bytes_ / 4));
  const CornerTable table{&numbers, numbers.size() / sizeof(uint32_t), sizeof(uint32_t),
                          sizeof(uint32_t)};
  if (textured()) corners_.BeginKeeping();
  MTDB_RETURN_IF_ERROR(GatherCorners(
      old, table, space_, memory_bytes_ / 4,
      [&](const std::array<uint32_t, 3>&, const std::array<const std::byte*, 3>& corners) {
        std::array<uint32_t, 3> t;
        for (size_t c = 0; c < 3; ++c) std::memcpy(&t[c], corners[c], sizeof(uint32_t));
        MTDB_ASSIGN_OR_RETURN(const bool stays, AppendTriangle(t));
        return textured() ? corners_.Keep(stays) : Status::Ok();
      }));
  if (textured()) MTDB_RETURN_IF_ERROR(corners_.EndKeeping());
  return triangle_spool_.Finish();
}

}  // namespace mtdb::internal
