// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/polygons/face_emitter.h"

#include <algorithm>
#include <utility>

namespace mtdb::internal {

Status FaceEmitter::EndFace() {
  if (std::exchange(is_fan_, false)) {
    ++report_->polygons;
    ++report_->fans;
    Resize(0);
    return Status::Ok();
  }
  const size_t size = corners_.size() - face_;
  if (size < 3) {
    ++report_->short_faces;
    Resize(face_);
    return Status::Ok();
  }
  if (size == 3 && face_ == 0) {
    const Status status = Emit(0, 1, 2);
    Resize(0);
    return status;
  }
  if (size > 3) ++report_->polygons;
  sizes_.push_back(static_cast<uint32_t>(size));
  face_ = corners_.size();
  return face_ < kMostCollected ? Status::Ok() : Flush();
}

Status FaceEmitter::AddTriangle(VertexIndex a, VertexIndex b, VertexIndex c) {
  return AddTriangle({a, b, c}, {kNoTexture, kNoTexture, kNoTexture});
}

Status FaceEmitter::AddTriangle(const TriangleVertices& t,
                                const std::array<TextureCorner, 3>& textures) {
  corners_.insert(corners_.end(), t.begin(), t.end());
  if (emitter_.is_textured()) textures_.insert(textures_.end(), textures.begin(), textures.end());
  return EndFace();
}

Status FaceEmitter::AddTriangles(std::span<const TriangleVertices> triangles) {
  if (face_ == 0 && left_out_.count() == 0) return emitter_.AddTriangles(triangles);
  for (const TriangleVertices& t : triangles) {
    MTDB_RETURN_IF_ERROR(AddTriangle(t[0], t[1], t[2]));
  }
  return Status::Ok();
}

Status FaceEmitter::End() { return Flush(); }

Status FaceEmitter::ExtendFan() {
  if (!is_fan_) {
    MTDB_RETURN_IF_ERROR(Flush());
    is_fan_ = true;
  }
  for (size_t i = 2; i < corners_.size(); ++i) MTDB_RETURN_IF_ERROR(Emit(0, i - 1, i));
  corners_[1] = corners_.back();
  if (!textures_.empty()) textures_[1] = textures_.back();
  Resize(2);
  return Status::Ok();
}

Status FaceEmitter::Flush() {
  if (sizes_.empty()) return Status::Ok();
  MTDB_RETURN_IF_ERROR(LookUp());
  size_t first = 0;
  const Vec3d* position = found_.data();
  for (const uint32_t size : sizes_) {
    if (size == 3) {
      MTDB_RETURN_IF_ERROR(Emit(first, first + 1, first + 2));
    } else {
      MTDB_RETURN_IF_ERROR(EmitPolygon(first, {position, size}));
      position += size;
    }
    first += size;
  }
  const auto done = static_cast<std::ptrdiff_t>(face_);
  corners_.erase(corners_.begin(), corners_.begin() + done);
  if (!textures_.empty()) textures_.erase(textures_.begin(), textures_.begin() + done);
  sizes_.clear();
  face_ = 0;
  return Status::Ok();
}

Status FaceEmitter::EmitPolygon(size_t first, std::span<const Vec3d> positions) {
  bool is_fan = false;
  for (const auto& [a, b, c] : triangulator_.Triangulate(positions, &is_fan)) {
    MTDB_RETURN_IF_ERROR(Emit(first + a, first + b, first + c));
  }
  if (is_fan) ++report_->fans;
  return Status::Ok();
}

Status FaceEmitter::LookUp() {
  if (positions_ == nullptr) {
    MTDB_ASSIGN_OR_RETURN(positions_, open_());
  }
  // Of polygons alone, one behind the other.
  order_.clear();
  uint32_t at = 0;
  for (const uint32_t size : sizes_) {
    for (uint32_t i = 0; size > 3 && i < size; ++i) order_.push_back(at + i);
    at += size;
  }
  found_.resize(order_.size());
  const std::span<const Vec3d> all = positions_->all();
  if (all.empty()) return LookUpBlocks();
  for (size_t i = 0; i < order_.size(); ++i) found_[i] = all[corners_[order_[i]]];
  return Status::Ok();
}

// Sorts the corners by counting, then reads each block that has some.
Status FaceEmitter::LookUpBlocks() {
  const uint64_t block = positions_->block_vertices();
  VertexIndex least = corners_[order_[0]], most = least;
  for (const uint32_t corner : order_) {
    least = std::min(least, corners_[corner]);
    most = std::max(most, corners_[corner]);
  }
  const uint64_t first_block = least / block;
  const uint64_t blocks = most / block - first_block + 1;
  const auto block_of = [&](uint32_t corner) { return corners_[corner] / block - first_block; };
  begin_.assign(blocks + 1, 0);
  for (const uint32_t corner : order_) ++begin_[block_of(corner) + 1];
  for (uint64_t b = 0; b < blocks; ++b) begin_[b + 1] += begin_[b];
  std::vector<uint32_t> sorted(order_.size());  // places in order_
  for (uint32_t i = 0; i < order_.size(); ++i) sorted[begin_[block_of(order_[i])]++] = i;
  std::vector<Vec3d> positions;
  for (size_t i = 0; i < sorted.size();) {
    const uint64_t b = block_of(order_[sorted[i]]);
    const uint64_t first = (first_block + b) * block;
    positions.resize(std::min(block, most + 1 - first));
    MTDB_RETURN_IF_ERROR(positions_->Read(first, positions));
    for (; i < begin_[b]; ++i) found_[sorted[i]] = positions[corners_[order_[sorted[i]]] - first];
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
