#include "builder/internal/triangle_sorter.h"

#include <algorithm>
#include <cstring>

#include "builder/internal/parallel.h"

namespace mtdb {

namespace {

// A record in a spool: its code, then the triangle and the rows.
constexpr size_t kCodeBytes = sizeof(uint64_t);

bool VerticesBefore(const std::byte* a, const std::byte* b) {
  std::array<uint32_t, 3> va;
  std::array<uint32_t, 3> vb;
  static_assert(offsetof(TileTriangle, vertices) == 0 && sizeof(TileTriangle::vertices) == 12);
  std::memcpy(va.data(), a, sizeof(va));
  std::memcpy(vb.data(), b, sizeof(vb));
  return va < vb;
}

}  // namespace

TriangleSorter::TriangleSorter(const RoundCurve& curve, const Grid& grid, const Options& options)
    : curve_(curve), grid_(grid), options_(options) {
  run_capacity_ = std::clamp<size_t>(options.memory_bytes / (record_bytes() + sizeof(Key)), 16384,
                                     size_t{1} << 31);
}

Status TriangleSorter::Add(const TileTriangle& triangle, const std::byte* rows) {
  if (keys_.size() >= run_capacity_) MTDB_RETURN_IF_ERROR(SpillRun());
  if (records_.capacity() - records_.size() < record_bytes()) {
    // Grow by half: doubling would overshoot the memory.
    records_.reserve(std::min(run_capacity_ * record_bytes(),
                              records_.capacity() + records_.capacity() / 2 + 64 * record_bytes()));
  }
  if (keys_.size() == keys_.capacity()) {
    keys_.reserve(std::min(run_capacity_, keys_.capacity() + keys_.capacity() / 2 + 64));
  }
  keys_.push_back({0, static_cast<uint32_t>(keys_.size())});  // SortKeys finds the code
  const auto* bytes = reinterpret_cast<const std::byte*>(&triangle);
  records_.insert(records_.end(), bytes, bytes + sizeof(triangle));
  records_.insert(records_.end(), rows, rows + 3 * options_.row_bytes);
  ++count_;
  return Status::Ok();
}

void TriangleSorter::SortKeys() {
  const auto before = [&](const Key& a, const Key& b) {
    return a.code != b.code ? a.code < b.code : VerticesBefore(Record(a.index), Record(b.index));
  };
  // Parts sorted in parallel, then merged pair by pair.
  const size_t n = keys_.size();
  constexpr size_t kLeastPart = 32768;
  const size_t parts = std::clamp<size_t>(n / kLeastPart, 1, options_.threads);
  const auto bound = [&](size_t p) {
    return keys_.begin() + static_cast<std::ptrdiff_t>(n * std::min(p, parts) / parts);
  };
  ParallelFor(parts, options_.threads, [&](unsigned, size_t p) {
    for (auto key = bound(p); key != bound(p + 1); ++key) {
      TileTriangle triangle;
      std::memcpy(&triangle, Record(key->index), sizeof(triangle));
      key->code = curve_.Code(triangle, grid_);
    }
    std::sort(bound(p), bound(p + 1), before);
  });
  for (size_t width = 1; width < parts; width *= 2) {
    for (size_t p = 0; p + width < parts; p += 2 * width) {
      std::inplace_merge(bound(p), bound(p + width), bound(p + 2 * width), before);
    }
  }
}

Status TriangleSorter::SpillRun() {
  SortKeys();
  Run& run = runs_.emplace_back();
  run.spool = std::make_unique<Spool>(options_.space, 0);
  run.left = keys_.size();
  for (const Key& key : keys_) {
    MTDB_RETURN_IF_ERROR(run.spool->Append(&key.code, kCodeBytes));
    MTDB_RETURN_IF_ERROR(run.spool->Append(Record(key.index), record_bytes()));
  }
  keys_.clear();
  records_.clear();
  return run.spool->Finish();
}

Status TriangleSorter::Advance(Run& run) {
  run.record = nullptr;
  if (run.left == 0) return Status::Ok();
  const std::byte* bytes = run.reader->Next(kCodeBytes + record_bytes());
  if (bytes == nullptr) return run.reader->status();
  std::memcpy(&run.code, bytes, kCodeBytes);
  run.record = bytes + kCodeBytes;
  --run.left;
  return Status::Ok();
}

bool TriangleSorter::Before(const Run& a, const Run& b) const {
  return a.code != b.code ? a.code < b.code : VerticesBefore(a.record, b.record);
}

Status TriangleSorter::Finish() {
  if (runs_.empty()) {
    SortKeys();
    return Status::Ok();
  }
  if (!keys_.empty()) MTDB_RETURN_IF_ERROR(SpillRun());
  Bytes().swap(records_);
  std::vector<Key>().swap(keys_);
  const size_t block =
      std::clamp<size_t>(options_.memory_bytes / 2 / runs_.size(), 65536, 4 * Spool::kBlock);
  for (Run& run : runs_) {
    run.reader = std::make_unique<SpoolReader>(run.spool.get(), 0, ~uint64_t{0}, block);
    MTDB_RETURN_IF_ERROR(Advance(run));
  }
  const auto after = [&](uint32_t a, uint32_t b) { return Before(runs_[b], runs_[a]); };
  for (uint32_t r = 0; r < runs_.size(); ++r) heap_.push_back(r);
  std::make_heap(heap_.begin(), heap_.end(), after);
  return Status::Ok();
}

Status TriangleSorter::Next(size_t count, std::vector<TileTriangle>* triangles, Bytes* rows,
                            uint64_t* code) {
  const auto append = [&](const std::byte* record) {
    if (triangles == nullptr) return;
    std::memcpy(&triangles->emplace_back(), record, sizeof(TileTriangle));
    rows->insert(rows->end(), record + sizeof(TileTriangle), record + record_bytes());
  };
  if (triangles != nullptr) triangles->reserve(triangles->size() + count);
  for (size_t i = 0; i < count; ++i) {
    if (runs_.empty()) {
      MTDB_CHECK(next_key_ < keys_.size(), "more triangles asked for than were added");
      if (i == 0) *code = keys_[next_key_].code;
      append(Record(keys_[next_key_++].index));
      continue;
    }
    const auto after = [&](uint32_t a, uint32_t b) { return Before(runs_[b], runs_[a]); };
    std::pop_heap(heap_.begin(), heap_.end(), after);
    Run& run = runs_[heap_.back()];
    if (i == 0) *code = run.code;
    append(run.record);
    MTDB_RETURN_IF_ERROR(Advance(run));
    if (run.record == nullptr) {
      heap_.pop_back();
      run.reader.reset();
      run.spool.reset();
    } else {
      std::push_heap(heap_.begin(), heap_.end(), after);
    }
  }
  return Status::Ok();
}

}  // namespace mtdb
