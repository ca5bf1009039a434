// SPDX-License-Identifier: Apache-2.0
#include "builder/disk/triangle_sorter.h"

#include <algorithm>
#include <cstring>

#include "builder/disk/parallel.h"

namespace mtdb::internal {

namespace {

constexpr size_t kChunkBytes = size_t{1} << 19;  // of records in memory
constexpr size_t kLeastBlock = size_t{1} << 16;  // that is read of a run at once

bool VerticesBefore(const std::byte* a, const std::byte* b) {
  std::array<uint32_t, 3> va;
  std::array<uint32_t, 3> vb;
  static_assert(offsetof(TileTriangle, vertices) == 0 && sizeof(TileTriangle::vertices) == 12);
  std::memcpy(va.data(), a, sizeof(va));
  std::memcpy(vb.data(), b, sizeof(vb));
  return va < vb;
}

}  // namespace

class TriangleSorter::RunWriter {
 public:
  RunWriter(const Options& options, Run* run)
      : run_(*run), packer_(options.row_bytes), bytes_(packer_.max_bytes()) {
    run_.spool = std::make_unique<Spool>(options.space, 0);
    run_.left = 0;
  }
  Status Write(const TileTriangle& triangle, const std::byte* rows, uint64_t code) {
    ++run_.left;
    return run_.spool->Append(bytes_.data(), packer_.Pack(triangle, rows, code, bytes_.data()));
  }
  Status Finish() { return run_.spool->Finish(); }

 private:
  Run& run_;
  TrianglePacker packer_;
  Bytes bytes_;
};

TriangleSorter::TriangleSorter(const Options& options) : options_(options) {
  run_capacity_ = std::clamp<size_t>(options.memory_bytes / (record_bytes() + sizeof(Key)), 256,
                                     size_t{1} << 31);
  chunk_records_ = std::clamp<size_t>(kChunkBytes / record_bytes(), 1, 4096);
  // Of two levels at a time.
  merge_width_ = std::clamp<size_t>(options.memory_bytes / 4 / kLeastBlock, 4, 128);
}

Status TriangleSorter::Add(const TileTriangle& triangle, const std::byte* rows, uint64_t code) {
  if (keys_.size() >= run_capacity_) MTDB_RETURN_IF_ERROR(SpillRun());
  const auto index = static_cast<uint32_t>(keys_.size());
  if (index == chunks_.size() * chunk_records_) {
    chunks_.push_back(std::make_unique_for_overwrite<std::byte[]>(chunk_records_ * record_bytes()));
  }
  if (keys_.size() == keys_.capacity()) {  // doubling would overshoot the memory
    keys_.reserve(std::min(run_capacity_, keys_.capacity() + keys_.capacity() / 2 + 64));
  }
  keys_.push_back({code, index});
  std::byte* record = Record(index);
  std::memcpy(record, &triangle, sizeof(triangle));
  std::copy_n(rows, 3 * options_.row_bytes, record + sizeof(triangle));
  ++count_;
  return Status::Ok();
}

Status TriangleSorter::Add(const TriangleBlock& block, std::span<const uint64_t> codes) {
  const std::byte* rows = block.rows.data();
  for (size_t i = 0; i < codes.size(); ++i, rows += 3 * options_.row_bytes) {
    MTDB_RETURN_IF_ERROR(Add(block.triangles[i], rows, codes[i]));
  }
  return Status::Ok();
}

bool TriangleSorter::KeyBefore::operator()(const Key& a, const Key& b) const {
  return a.code != b.code ? a.code < b.code
                          : VerticesBefore(sorter->Record(a.index), sorter->Record(b.index));
}

std::vector<size_t> TriangleSorter::SortParts() {
  constexpr size_t kLeastPart = 32768;
  const size_t parts = std::clamp<size_t>(keys_.size() / kLeastPart, 1, options_.threads);
  std::vector<size_t> bounds;
  for (size_t p = 0; p <= parts; ++p) bounds.push_back(keys_.size() * p / parts);
  ParallelFor(parts, options_.threads, [&](unsigned, size_t p) {
    std::sort(keys_.begin() + static_cast<std::ptrdiff_t>(bounds[p]),
              keys_.begin() + static_cast<std::ptrdiff_t>(bounds[p + 1]), KeyBefore{this});
  });
  return bounds;
}

// Each part is a run of its own.
Status TriangleSorter::SpillRun() {
  const std::vector<size_t> bounds = SortParts();
  const size_t parts = bounds.size() - 1;
  std::vector<Status> statuses(parts);
  const size_t first = runs_.size();
  runs_.resize(first + parts);
  ParallelFor(parts, options_.threads, [&](unsigned, size_t p) {
    const auto write = [&](Run& run) {
      RunWriter writer(options_, &run);
      for (size_t i = bounds[p]; i < bounds[p + 1]; ++i) {
        const std::byte* record = Record(keys_[i].index);
        TileTriangle triangle;
        std::memcpy(&triangle, record, sizeof(triangle));
        MTDB_RETURN_IF_ERROR(writer.Write(triangle, record + sizeof(triangle), keys_[i].code));
      }
      return writer.Finish();
    };
    statuses[p] = write(runs_[first + p]);
  });
  for (const Status& status : statuses) MTDB_RETURN_IF_ERROR(status);
  keys_.clear();
  return MergeRuns();
}

Status TriangleSorter::MergeRuns() {
  for (;;) {
    if (runs_.empty()) return Status::Ok();
    const uint32_t level = runs_.back().level;
    const auto begin = std::find_if(runs_.rbegin(), runs_.rend(), [&](const Run& run) {
                         return run.level != level;
                       }).base();
    const auto first = static_cast<size_t>(begin - runs_.begin());
    if (runs_.size() - first < merge_width_) return Status::Ok();
    chunks_.clear();  // makes room for the readers
    MTDB_RETURN_IF_ERROR(OpenRuns(first, kLeastBlock));
    Run merged;
    merged.level = level + 1;
    RunWriter writer(options_, &merged);
    while (!heap_.empty()) {
      const Run& run = runs_[heap_.front()];
      MTDB_RETURN_IF_ERROR(writer.Write(run.triangle, run.rows.data(), run.code));
      MTDB_RETURN_IF_ERROR(Pop());
    }
    MTDB_RETURN_IF_ERROR(writer.Finish());
    runs_.resize(first);
    runs_.push_back(std::move(merged));
  }
}

Status TriangleSorter::OpenRuns(size_t first, size_t block_bytes) {
  const auto after = [&](uint32_t a, uint32_t b) { return Before(runs_[b], runs_[a]); };
  for (size_t r = first; r < runs_.size(); ++r) {
    Run& run = runs_[r];
    run.reader =
        std::make_unique<SpoolReader>(SpoolReader::Consuming(run.spool.get(), block_bytes));
    run.unpacker = std::make_unique<TriangleUnpacker>(options_.row_bytes);
    run.rows.resize(3 * options_.row_bytes);
    MTDB_RETURN_IF_ERROR(Read(run));
    heap_.push_back(static_cast<uint32_t>(r));
  }
  std::make_heap(heap_.begin(), heap_.end(), after);
  return Status::Ok();
}

Status TriangleSorter::Pop() {
  const auto after = [&](uint32_t a, uint32_t b) { return Before(runs_[b], runs_[a]); };
  std::pop_heap(heap_.begin(), heap_.end(), after);
  Run& run = runs_[heap_.back()];
  if (--run.left == 0) {
    heap_.pop_back();
    run.reader.reset();
    run.unpacker.reset();
    run.spool.reset();
    return Status::Ok();
  }
  MTDB_RETURN_IF_ERROR(Read(run));
  std::push_heap(heap_.begin(), heap_.end(), after);
  return Status::Ok();
}

Status TriangleSorter::Read(Run& run) {
  const std::byte* bytes = run.reader->Peek(run.unpacker->max_bytes());
  if (bytes == nullptr) return run.reader->status();
  const std::byte* end = run.unpacker->Unpack(bytes, &run.triangle, run.rows.data(), &run.code);
  run.reader->Skip(static_cast<size_t>(end - bytes));
  return Status::Ok();
}

bool TriangleSorter::Before(const Run& a, const Run& b) const {
  return a.code != b.code ? a.code < b.code : a.triangle.vertices < b.triangle.vertices;
}

Status TriangleSorter::Finish() {
  if (runs_.empty()) {
    const std::vector<size_t> bounds = SortParts();
    const auto at = [&](size_t i) { return keys_.begin() + static_cast<std::ptrdiff_t>(i); };
    for (size_t p = 1; p + 1 < bounds.size(); ++p) {
      std::inplace_merge(at(0), at(bounds[p]), at(bounds[p + 1]), KeyBefore{this});
    }
    return Status::Ok();
  }
  if (!keys_.empty()) MTDB_RETURN_IF_ERROR(SpillRun());
  chunks_.clear();
  std::vector<Key>().swap(keys_);
  return OpenRuns(0, std::clamp<size_t>(options_.memory_bytes / 2 / runs_.size(), kLeastBlock,
                                        4 * Spool::kBlock));
}

Status TriangleSorter::Next(size_t count, TriangleBlock* block, uint64_t* code) {
  const auto append = [&](const TileTriangle& triangle, const std::byte* rows) {
    if (block == nullptr) return;
    block->triangles.push_back(triangle);
    block->rows.insert(block->rows.end(), rows, rows + 3 * options_.row_bytes);
  };
  if (block != nullptr) {
    block->triangles.reserve(block->triangles.size() + count);
    block->rows.reserve(block->rows.size() + count * 3 * options_.row_bytes);
  }
  for (size_t i = 0; i < count; ++i) {
    if (runs_.empty()) {
      MTDB_CHECK(next_key_ < keys_.size(), "more triangles asked for than were added");
      if (i == 0) *code = keys_[next_key_].code;
      const std::byte* record = Record(keys_[next_key_++].index);
      TileTriangle triangle;
      std::memcpy(&triangle, record, sizeof(triangle));
      append(triangle, record + sizeof(triangle));
      continue;
    }
    const Run& run = runs_[heap_.front()];
    if (i == 0) *code = run.code;
    append(run.triangle, run.rows.data());
    MTDB_RETURN_IF_ERROR(Pop());
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
