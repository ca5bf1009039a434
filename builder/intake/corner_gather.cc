// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/corner_gather.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

namespace mtdb::internal {

namespace {

constexpr uint64_t kMaxRanges = 256;
constexpr size_t kTriangleBytes = 12;
constexpr size_t kLeastTableBytes = size_t{1} << 20;

// Rows [first, first + count) into `rows`.
Status LoadRows(const CornerTable& table, uint64_t first, uint64_t count, Bytes* rows) {
  rows->resize(count * table.bytes);
  SpoolReader reader(table.spool, first * table.stride, (first + count) * table.stride);
  for (uint64_t i = 0; i < count; ++i) {
    const std::byte* row = reader.Next(table.stride);
    if (row == nullptr) return reader.status();
    std::memcpy(rows->data() + i * table.bytes, row, table.bytes);
  }
  return Status::Ok();
}

Status GatherInMemory(const Spool& triangles, const CornerTable& table,
                      const CornersReceiver& receive) {
  Bytes rows;
  MTDB_RETURN_IF_ERROR(LoadRows(table, 0, table.rows, &rows));
  SpoolReader reader(&triangles);
  std::array<uint32_t, 3> t;
  for (uint64_t left = triangles.size() / kTriangleBytes; left > 0; --left) {
    if (!reader.Get(&t)) return reader.status();
    MTDB_RETURN_IF_ERROR(
        receive(t, {rows.data() + t[0] * table.bytes, rows.data() + t[1] * table.bytes,
                    rows.data() + t[2] * table.bytes}));
  }
  return Status::Ok();
}

class Gather {
 public:
  Gather(const Spool& triangles, const CornerTable& table, const SpoolSpace* space,
         size_t memory_bytes)
      : triangles_(triangles), table_(table) {
    const uint64_t room = std::max<uint64_t>(memory_bytes / 2, kLeastTableBytes);
    const uint64_t ranges = std::min(kMaxRanges, table.rows * table.bytes / room + 1);
    while ((table.rows >> range_bits_) >= ranges) ++range_bits_;
    const uint64_t count = ((table.rows - 1) >> range_bits_) + 1;
    fits_ = (uint64_t{1} << range_bits_) * table.bytes <= 2 * room;
    spool_memory_ = memory_bytes / 2 / count / 2;
    for (uint64_t r = 0; r < count; ++r) {
      questions_.emplace_back(space, spool_memory_);
      answers_.emplace_back(space, spool_memory_);
    }
  }

  Status Run(const CornersReceiver& receive) {
    if (!fits_) {
      return Status(StatusCode::kBudgetExceeded,
                    std::to_string(table_.rows) + " vertices need " +
                        std::to_string(((uint64_t{table_.bytes} << range_bits_) >> 20) + 1) +
                        " MiB to be looked up; allow more --memory");
    }
    MTDB_RETURN_IF_ERROR(Ask());
    for (size_t r = 0; r < questions_.size(); ++r) MTDB_RETURN_IF_ERROR(Answer(r));
    return Collect(receive);
  }

 private:
  Status Ask() {
    SpoolReader reader(&triangles_);
    std::array<uint32_t, 3> t;
    for (uint64_t left = triangles_.size() / kTriangleBytes; left > 0; --left) {
      if (!reader.Get(&t)) return reader.status();
      for (const uint32_t row : t) {
        MTDB_RETURN_IF_ERROR(questions_[row >> range_bits_].Append(&row, sizeof(row)));
      }
    }
    for (Spool& q : questions_) MTDB_RETURN_IF_ERROR(q.Finish());
    return Status::Ok();
  }

  Status Answer(size_t r) {
    const uint64_t first = uint64_t{r} << range_bits_;
    const uint64_t count = std::min(uint64_t{1} << range_bits_, table_.rows - first);
    MTDB_RETURN_IF_ERROR(LoadRows(table_, first, count, &rows_));
    SpoolReader reader(&questions_[r]);
    while (reader.remaining() != 0) {
      uint32_t row = 0;
      if (!reader.Get(&row)) return reader.status();
      MTDB_RETURN_IF_ERROR(
          answers_[r].Append(rows_.data() + (row - first) * table_.bytes, table_.bytes));
    }
    questions_[r] = Spool(nullptr, 0);
    return answers_[r].Finish();
  }

  Status Collect(const CornersReceiver& receive) {
    rows_ = Bytes();
    const size_t block = std::clamp<size_t>(spool_memory_, 4096, Spool::kBlock);
    std::vector<SpoolReader> answers;
    for (const Spool& a : answers_) answers.emplace_back(&a, 0, ~uint64_t{0}, block);
    SpoolReader reader(&triangles_);
    std::array<uint32_t, 3> t;
    // Copied: corners of one range share a reader, whose answers do not outlive the next one.
    Bytes rows(3 * table_.bytes);
    for (uint64_t left = triangles_.size() / kTriangleBytes; left > 0; --left) {
      if (!reader.Get(&t)) return reader.status();
      for (size_t c = 0; c < 3; ++c) {
        SpoolReader& from = answers[t[c] >> range_bits_];
        const std::byte* row = from.Next(table_.bytes);
        if (row == nullptr) return from.status();
        std::memcpy(rows.data() + c * table_.bytes, row, table_.bytes);
      }
      MTDB_RETURN_IF_ERROR(
          receive(t, {rows.data(), rows.data() + table_.bytes, rows.data() + 2 * table_.bytes}));
    }
    return Status::Ok();
  }

  const Spool& triangles_;
  const CornerTable& table_;
  int range_bits_ = 0;  // of the number of rows in a range
  bool fits_ = true;
  size_t spool_memory_ = 0;
  std::vector<Spool> questions_;  // per range: numbers of rows
  std::vector<Spool> answers_;    // per range: rows
  Bytes rows_;
};

}  // namespace

Status GatherCorners(const Spool& triangles, const CornerTable& table, const SpoolSpace* space,
                     size_t memory_bytes, const CornersReceiver& receive) {
  if (table.rows == 0) return Status::Ok();
  if (table.rows * table.bytes <= memory_bytes) return GatherInMemory(triangles, table, receive);
  return Gather(triangles, table, space, memory_bytes).Run(receive);
}

}  // namespace mtdb::internal
