// SPDX-License-Identifier: Apache-2.0
#include "tools/generate/internal/surface_walker.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "store/base/check.h"
#include "tools/generate/internal/marching.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kNoVertex = ~uint64_t{0};
constexpr size_t kFlushCount = 65536;
constexpr uint8_t kNotSampled = 2;
// A crossing keeps this distance from the ends of its cell edge, so that no triangle is degenerate.
constexpr double kLeastFraction = 0.06;

}  // namespace

const SurfaceWalker::FaceIds* SurfaceWalker::KeptFaces::Find(BlockIndex block) {
  while (next < faces.size() && faces[next].block < block) ++next;
  return next < faces.size() && faces[next].block == block ? &faces[next].ids : nullptr;
}

void SurfaceWalker::KeptFaces::StartOver(KeptFaces* fresh) {
  std::swap(faces, fresh->faces);
  next = 0;
  fresh->faces.clear();
}

SurfaceWalker::SurfaceWalker(uint64_t seed, double cell_size, MeshSink* sink)
    : field_(seed, cell_size), cell_size_(cell_size), sink_(sink) {
  for (size_t level = 0; level < kLevels; ++level) {
    deviation_[level] = field_.DeviationWithinCube((kBlock >> level) * cell_size);
  }
  const Box3d bounds = SculptureField::Bounds();
  const double margin = 2 * cell_size;
  low_ = bounds.min - Vec3d{margin, margin, margin};
  for (int i = 0; i < 3; ++i) {
    const double cells = (bounds.max[i] + margin - low_[i]) / cell_size;
    block_count_[static_cast<size_t>(i)] = static_cast<int32_t>(std::ceil(cells / kBlock));
  }
}

Status SurfaceWalker::Walk() {
  MTDB_CHECK(sink_ != nullptr, "only a walker with a sink can walk");
  std::vector<BlockIndex> blocks;
  for (int32_t z = 0; z < block_count_[2]; ++z) {
    below_.StartOver(&above_);
    row_.faces.clear();
    FindBlocks(z, &blocks);
    for (size_t i = 0; i < blocks.size(); ++i) {
      if (i == 0 || blocks[i].y != blocks[i - 1].y) row_before_.StartOver(&row_);
      MTDB_RETURN_IF_ERROR(WalkBlock(blocks[i], z));
    }
  }
  // A crossed cell edge belongs to four cells. Were one of them skipped, there would be a hole.
  MTDB_CHECK(crossing_uses_ == 4 * vertex_count_, "a cell that the surface enters was skipped");
  return Flush();
}

double SurfaceWalker::EstimateTriangles(uint32_t sampling) {
  MTDB_CHECK(sink_ == nullptr, "a walker with a sink does not estimate");
  // The sampled blocks form a lattice without short vectors: steps by irrational shares.
  const auto step_y = static_cast<uint64_t>(0.6180 * sampling) | 1;
  const auto step_z = static_cast<uint64_t>(0.4142 * sampling) | 1;
  std::vector<BlockIndex> blocks;
  for (int32_t z = 0; z < block_count_[2]; ++z) {
    FindBlocks(z, &blocks);
    for (const BlockIndex& block : blocks) {
      const uint64_t place = static_cast<uint64_t>(block.x) +
                             static_cast<uint64_t>(block.y) * step_y +
                             static_cast<uint64_t>(z) * step_z;
      if (place % sampling != 0) continue;
      FindCubes(block, z);
      FindCells(block, z);
    }
  }
  return static_cast<double>(triangle_count_) * sampling;
}

void SurfaceWalker::FindBlocks(int32_t z, std::vector<BlockIndex>* blocks) {
  int32_t size = 1;
  while (size < std::max(block_count_[0], block_count_[1])) size *= 2;
  blocks->assign(1, BlockIndex{0, 0});
  std::vector<BlockIndex> children;
  for (;; size /= 2) {
    // Squares of `size` x `size` blocks, one block high.
    batch_.Clear();
    const double half = 0.5 * kBlock * size;
    for (const BlockIndex& b : *blocks) {
      batch_.Add(PointAt(b.x * kBlock + half, b.y * kBlock + half, (z + 0.5) * kBlock));
    }
    const double half_height = 0.5 * kBlock;
    field_.EvaluateNearness(cell_size_ * std::sqrt(2 * half * half + half_height * half_height),
                            &batch_);
    children.clear();
    for (size_t i = 0; i < blocks->size(); ++i) {
      if (batch_.complete[i] == 0) continue;
      if (size == 1) {
        children.push_back((*blocks)[i]);
        continue;
      }
      for (int32_t c = 0; c < 4; ++c) {
        const BlockIndex child{(*blocks)[i].y + (c >> 1) * (size / 2),
                               (*blocks)[i].x + (c & 1) * (size / 2)};
        if (child.x < block_count_[0] && child.y < block_count_[1]) children.push_back(child);
      }
    }
    std::swap(*blocks, children);
    if (size == 1) break;
  }
  std::sort(blocks->begin(), blocks->end());
}

Status SurfaceWalker::WalkBlock(BlockIndex block, int32_t z) {
  FindCubes(block, z);
  FindCells(block, z);
  if (cells_.empty()) return Status::Ok();
  MTDB_RETURN_IF_ERROR(EmitCells(block, z));
  KeepFaces(block);
  return Status::Ok();
}

void SurfaceWalker::FindCubes(BlockIndex block, int32_t z) {
  complete_.fill(kNotSampled);
  cubes_.assign(1, 0);
  for (size_t level = 0; level < kLevels; ++level) {
    const int edge = kBlock >> level;
    SampleCubes(block, z, edge, std::max(deviation_[level], 2 * cell_size_));
    // Keep the cubes that the surface may enter, and split them.
    split_cubes_.clear();
    for (const uint16_t cube : cubes_) {
      bool active = false;
      for (const int offset : kCornerOffset) {
        const float value = samples_[static_cast<size_t>(cube + offset * edge)];
        active |= std::abs(value) <= deviation_[level] || (value < 0) != (samples_[cube] < 0);
      }
      if (!active) continue;
      for (const int offset : kCornerOffset) {
        split_cubes_.push_back(static_cast<uint16_t>(cube + offset * (edge / 2)));
      }
    }
    std::swap(cubes_, split_cubes_);
  }
  SampleCubes(block, z, 1, 2 * cell_size_);
}

void SurfaceWalker::SampleCubes(BlockIndex block, int32_t z, int edge, double margin) {
  batch_.Clear();
  batch_samples_.clear();
  for (const uint16_t cube : cubes_) {
    for (const int offset : kCornerOffset) {
      const int sample = cube + offset * edge;
      uint8_t& state = complete_[static_cast<size_t>(sample)];
      if (state != kNotSampled) continue;
      state = 0;
      AddToBatch(block, z, sample);
    }
  }
  field_.EvaluateSigns(margin, &batch_);
  for (size_t i = 0; i < batch_.size(); ++i) {
    samples_[batch_samples_[i]] = batch_.value[i];
    complete_[batch_samples_[i]] = batch_.complete[i];
  }
}

void SurfaceWalker::AddToBatch(BlockIndex block, int32_t z, int sample) {
  batch_.Add(PointAt(block.x * kBlock + sample % kSide, block.y * kBlock + sample / kSide % kSide,
                     z * kBlock + sample / kLayer));
  batch_samples_.push_back(static_cast<uint16_t>(sample));
}

void SurfaceWalker::FindCells(BlockIndex block, int32_t z) {
  const std::array<MarchingCase, 256>& cases = MarchingCases();
  cells_.clear();
  batch_.Clear();
  batch_samples_.clear();
  const auto complete = [&](int sample) {
    uint8_t& done = complete_[static_cast<size_t>(sample)];
    if (done != 0) return;
    done = 1;
    AddToBatch(block, z, sample);
  };
  for (const uint16_t cell : cubes_) {
    unsigned inside = 0;
    for (size_t c = 0; c < 8; ++c) {
      inside |= static_cast<unsigned>(samples_[static_cast<size_t>(cell + kCornerOffset[c])] < 0)
                << c;
    }
    if (inside == 0 || inside == 255) continue;
    const MarchingCase& marching = cases[inside];
    cells_.push_back({cell, static_cast<uint8_t>(inside)});
    triangle_count_ += marching.triangle_count;
    if (sink_ == nullptr) continue;
    crossing_uses_ += static_cast<uint64_t>(std::popcount(marching.edges));
    for (size_t e = 0; e < 12; ++e) {
      if ((marching.edges >> e & 1) == 0) continue;
      const int start = cell + kCornerOffset[kCubeEdgeStart[e]];
      complete(start);
      complete(start + kStride[e / 4]);
    }
  }
  if (batch_.size() == 0) return;
  field_.EvaluateAll(&batch_);
  for (size_t i = 0; i < batch_.size(); ++i) samples_[batch_samples_[i]] = batch_.value[i];
}

Status SurfaceWalker::EmitCells(BlockIndex block, int32_t z) {
  const std::array<MarchingCase, 256>& cases = MarchingCases();
  for (auto& ids : edge_ids_) ids.fill(kNoVertex);
  const FaceIds* before[3] = {left_block_ == BlockIndex{block.y, block.x - 1} ? &left_ : nullptr,
                              row_before_.Find({block.y - 1, block.x}), below_.Find(block)};
  for (const Cell& cell : cells_) {
    const MarchingCase& c = cases[cell.inside];
    uint64_t ids[12] = {};
    for (int e = 0; e < 12; ++e) {
      if ((c.edges >> e & 1) == 0) continue;
      const int corner = kCubeEdgeStart[static_cast<size_t>(e)];
      const int sample = cell.sample + kCornerOffset[static_cast<size_t>(corner)];
      const int axis = e / 4;
      uint64_t& id = edge_ids_[static_cast<size_t>(axis)][static_cast<size_t>(sample)];
      if (id == kNoVertex) {
        const int at[3] = {sample % kSide, sample / kSide % kSide, sample / kLayer};
        for (int face = 0; face < 3 && id == kNoVertex; ++face) {
          if (at[face] != 0 || face == axis) continue;
          // The two other axes, in order, index the face.
          const int a = face == 0 ? 1 : 0, b = face == 2 ? 1 : 2;
          MTDB_CHECK(before[face] != nullptr, "a block that the surface enters was skipped");
          id = (*before[face])[static_cast<size_t>(((axis == a ? 0 : kSide) + at[b]) * kSide +
                                                   at[a])];
          MTDB_CHECK(id != kNoVertex, "a part of a block that the surface enters was skipped");
        }
        if (id == kNoVertex) id = NewVertex(axis, sample, block, z);
      }
      ids[e] = id;
    }
    for (size_t t = 0; t < c.triangle_count; ++t) {
      const std::array<uint8_t, 3>& corner = c.triangles[t];
      triangles_.push_back({ids[corner[0]], ids[corner[1]], ids[corner[2]]});
    }
  }
  // A block adds at most some 2,600 of either.
  constexpr size_t kFull = kFlushCount - 4096;
  return std::max(triangles_.size(), vertices_.size()) > kFull ? Flush() : Status::Ok();
}

uint64_t SurfaceWalker::NewVertex(int edge_axis, int sample, BlockIndex block, int32_t z) {
  const double a = samples_[static_cast<size_t>(sample)];
  const double b = samples_[static_cast<size_t>(sample + kStride[static_cast<size_t>(edge_axis)])];
  Vec3d at{static_cast<double>(block.x * kBlock + sample % kSide),
           static_cast<double>(block.y * kBlock + sample / kSide % kSide),
           static_cast<double>(z * kBlock + sample / kLayer)};
  at[edge_axis] += std::clamp(a / (a - b), kLeastFraction, 1 - kLeastFraction);
  const Vec3d p = PointAt(at.x, at.y, at.z);
  // g++ 12 leaves out the rounding of neighbours from double to float32 and back when it vectorises
  // it; volatile keeps it.
  volatile const auto px = static_cast<float>(p.x);
  volatile const auto py = static_cast<float>(p.y);
  volatile const auto pz = static_cast<float>(p.z);
  vertices_.push_back({px, py, pz});
  return vertex_count_++;
}

void SurfaceWalker::KeepFaces(BlockIndex block) {
  const auto fill = [&](int face, FaceIds* ids) {
    const auto a = static_cast<size_t>(face == 0 ? 1 : 0);
    const auto b = static_cast<size_t>(face == 2 ? 1 : 2);
    uint64_t any = kNoVertex;
    size_t out = 0;
    for (const size_t axis : {a, b}) {
      for (int j = 0; j < kSide; ++j) {
        for (int i = 0; i < kSide; ++i) {
          const int sample =
              kBlock * kStride[static_cast<size_t>(face)] + j * kStride[b] + i * kStride[a];
          const uint64_t id = edge_ids_[axis][static_cast<size_t>(sample)];
          any &= id;
          (*ids)[out++] = id;
        }
      }
    }
    return any != kNoVertex;
  };
  left_block_ = fill(0, &left_) ? block : BlockIndex{-1, -1};
  for (int face = 1; face < 3; ++face) {
    std::vector<KeptFace>& faces = face == 1 ? row_.faces : above_.faces;
    faces.emplace_back();
    faces.back().block = block;
    if (!fill(face, &faces.back().ids)) faces.pop_back();
  }
}

Status SurfaceWalker::Flush() {
  if (!vertices_.empty()) MTDB_RETURN_IF_ERROR(sink_->AddVertices(vertices_, {}));
  if (!triangles_.empty()) MTDB_RETURN_IF_ERROR(sink_->AddTriangles(triangles_));
  vertices_.clear();
  triangles_.clear();
  return Status::Ok();
}

}  // namespace mtdb::internal
