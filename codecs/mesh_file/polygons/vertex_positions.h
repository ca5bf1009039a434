// SPDX-License-Identifier: Apache-2.0
// VertexPositions: where the vertices of a file lie, by their numbers in the file.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Where readers may write temporary files, and how much of them.
struct ReaderSpace {
  std::string directory;  // empty: the system's
  uint64_t max_bytes = ~uint64_t{0};
};

class VertexPositions {
 public:
  virtual ~VertexPositions() = default;
  // All of them, when they are in memory; else none.
  virtual std::span<const Vec3d> all() const { return {}; }
  // How many are best read at once; 2^20 blocks are enough for all.
  virtual uint64_t block_vertices() const = 0;
  virtual Status Read(uint64_t first, std::span<Vec3d> out) = 0;

 protected:
  static uint64_t BlockOf(uint64_t bytes, uint64_t vertex_bytes) {
    constexpr uint64_t kLeastBytes = uint64_t{1} << 16;
    return std::max(kLeastBytes, bytes >> 20) / vertex_bytes + 1;
  }
};

// Of formats in which a vertex has no fixed place: written one after the other, in memory while
// they are few, then in a nameless temporary file.
class PositionSpool final : public VertexPositions {
 public:
  explicit PositionSpool(ReaderSpace space)
      : folder_(std::move(space.directory)), max_bytes_(space.max_bytes) {}
  ~PositionSpool() override;
  PositionSpool(const PositionSpool&) = delete;
  PositionSpool& operator=(const PositionSpool&) = delete;

  // kNoSpace, kIoError: naming the folder; kBudgetExceeded.
  Status Append(Vec3d position) {
    positions_.push_back(position);
    return positions_.size() < kInMemory ? Status::Ok() : Flush();
  }
  // After the last one.
  Status Finish() { return file_ < 0 ? Status::Ok() : Flush(); }

  std::span<const Vec3d> all() const override {
    return file_ < 0 ? std::span<const Vec3d>(positions_) : std::span<const Vec3d>();
  }
  uint64_t block_vertices() const override {
    return BlockOf(written_ * sizeof(Vec3d), sizeof(Vec3d));
  }
  Status Read(uint64_t first, std::span<Vec3d> out) override;

 private:
  static constexpr size_t kInMemory = size_t{1} << 18;
  Status Flush();
  Status FileError() const;

  std::string folder_;
  uint64_t max_bytes_;
  std::vector<Vec3d> positions_;  // all, or those not written yet
  int file_ = -1;
  uint64_t written_ = 0;
};

}  // namespace mtdb::internal
