// SPDX-License-Identifier: Apache-2.0
#include "query/height_change.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <queue>
#include <string>
#include <utility>
#include <vector>

#include "query/compare/helpers.h"
#include "query/compare/outward.h"
#include "query/fields/stopwatch.h"
#include "query/heights.h"
#include "query/query_control.h"
#include "query/terrain/cell_change.h"
#include "query/terrain/terrain_patch.h"
#include "store/base/coordinate_limit.h"
#include "store/base/out_of_memory.h"
#include "store/base/threading.h"
#include "store/metres_of_unit.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr double kFall = 4;                  // of the threshold from level to level
constexpr double kStandardWidth = 1e-4;      // of the range of heights
constexpr uint64_t kMostTriangles = 65'536;  // of one cut in a cell
constexpr uint64_t kQuartered = 4'096;       // of both cuts of a cell that is asked again
constexpr double kSmallestCell = 0x1p-24;    // of the window's sides
constexpr uint64_t kNoLimit = std::numeric_limits<uint64_t>::max();

double VolumeDoubt(const CellChange& c) {
  return std::max(c.fill.high - c.fill.low, c.cut.high - c.cut.low);
}

void Keep(const CellExtreme& found, LargestChange* largest) {
  if (found.low <= largest->height.low) return;
  largest->height.low = found.low;
  largest->point = found.point;
}

// Best first over cells: those that leave most in doubt are asked again.
class HeightComparer {
 public:
  HeightComparer(const Surface& a, const Surface& b, const HeightChangeOptions& options)
      : options_(options),
        a_(a, options.as_stored, options.control),
        b_(b, options.as_stored, options.control),
        threads_(options.threads > 0 ? options.threads : ProcessorCount()) {
    window_ = WindowOf(a.record().bounds, b.record().bounds);
    width_ = options.width;
    if (!width_ && !options.tolerance) width_ = kStandardWidth * HeightRange();
    result_.clusters_total = a.index().cluster_count();
    if (&a != &b) result_.clusters_total += b.index().cluster_count();
    MakeThresholds();
  }

  Result<HeightChange> Run() {
    if (!window_.empty()) Add(Unasked(), 0);
    for (;;) {
      std::vector<size_t> chosen;
      while (chosen.size() < threads_) {
        const std::optional<size_t> next = Next();
        if (!next) break;
        cells_[*next].chosen = true;
        chosen.push_back(*next);
      }
      if (chosen.empty() || IsStopped()) break;
      MTDB_RETURN_IF_ERROR(AskAgain(chosen));
    }
    if (IsCancelled()) return Status(StatusCode::kCancelled, "the comparison was cancelled");
    return Sum();
  }
  // Of copies of one object.
  Result<HeightChange> RunIdentical() {
    if (options_.tolerance) result_.verdict = CompareVerdict::kWithin;
    result_.identical = true;
    if (window_.empty()) return result_;
    MTDB_ASSIGN_OR_RETURN(const std::optional<TerrainPatch> patch,
                          a_.Take(window_, thresholds_[0], kNoLimit));
    const CellChange cell = MeasureCell(window_, *patch, TerrainPatch());
    result_.area_both = cell.area_a;
    CountReading();
    return result_;
  }

 private:
  struct Question {
    PlaneWindow window;
    size_t level = 0;
  };
  struct Cell {
    CellChange change;
    size_t next_level = 0;     // that it is to be asked at
    bool chosen = false;       // to be asked again
    bool asked_again = false;  // others stand for it
  };
  struct Asked {
    Question question;
    TerrainPatch a, b;
    CellChange change;
  };
  // Sums over cells: how wide intervals of volumes are, and what both terrains cover.
  struct Doubt {
    double fill = 0, cut = 0, area = 0;
  };
  // Cells, what they may hide first.
  using Queue = std::priority_queue<std::pair<double, size_t>>;

  PlaneWindow WindowOf(const Box3d& a, const Box3d& b) const {
    PlaneWindow w{std::min(a.min.x, b.min.x), std::min(a.min.y, b.min.y),
                  std::max(a.max.x, b.max.x), std::max(a.max.y, b.max.y)};
    if (!options_.window) return w;
    const auto& [min_x, min_y, max_x, max_y] = *options_.window;
    return {std::max(w.min_x, min_x), std::max(w.min_y, min_y), std::min(w.max_x, max_x),
            std::min(w.max_y, max_y)};
  }
  double HeightRange() const {
    const Box3d &a = a_.record().bounds, &b = b_.record().bounds;
    return std::max(a.max.z, b.max.z) - std::min(a.min.z, b.min.z);
  }
  void MakeThresholds() {
    const double largest = std::max(a_.largest_error(), b_.largest_error());
    const double least = std::max(a_.least_error(), b_.least_error());
    const double finest = std::max(2 * least, largest * 0x1p-24);
    for (double t = largest; t > finest; t /= kFall) thresholds_.push_back(t);
    thresholds_.push_back(-1);
  }

  bool IsStopped() {
    if (IsCancelled()) return true;
    if (!options_.max_milliseconds) return false;
    if (watch_.Seconds() * 1e3 < *options_.max_milliseconds) return false;
    result_.out_of_time = true;
    return true;
  }
  bool IsCancelled() const { return options_.control != nullptr && options_.control->cancelled(); }

  // By the catalog alone.
  CellChange Unasked() const {
    const auto part = [&](const ObjectRecord& r) {
      PlaneWindow w = window_;
      w.min_x = std::max(w.min_x, r.bounds.min.x), w.max_x = std::min(w.max_x, r.bounds.max.x);
      w.min_y = std::max(w.min_y, r.bounds.min.y), w.max_y = std::min(w.max_y, r.bounds.max.y);
      return w;
    };
    const PlaneWindow a = part(a_.record()), b = part(b_.record());
    const PlaneWindow both{std::max(a.min_x, b.min_x), std::max(a.min_y, b.min_y),
                           std::min(a.max_x, b.max_x), std::min(a.max_y, b.max_y)};
    CellChange cell;
    cell.window = window_;
    if (!a.empty()) cell.area_a.high = Up(a.area());
    if (!b.empty()) cell.area_b.high = Up(b.area());
    if (both.empty()) return cell;
    const double error = a_.least_error() + b_.least_error();
    const double highest = b_.record().bounds.max.z - a_.record().bounds.min.z + error;
    const double lowest = b_.record().bounds.min.z - a_.record().bounds.max.z - error;
    const double none = -std::numeric_limits<double>::infinity();
    cell.common = true;
    cell.rise = {none, highest, {}};
    cell.fall = {none, -lowest, {}};
    cell.area_both.high = Up(both.area());
    cell.fill.high = Up(both.area()) * std::max(0.0, highest);
    cell.cut.high = Up(both.area()) * std::max(0.0, -lowest);
    cell.net = {-cell.cut.high, cell.fill.high};
    return cell;
  }

  // Replaces the cells by what is known of their rectangles at the next level; all of them or,
  // where it is stopped, none.
  Status AskAgain(const std::vector<size_t>& chosen) {
    std::vector<Question> questions;
    for (const size_t number : chosen) Ask(cells_[number], &questions);
    std::vector<Asked> all;
    for (size_t next = 0; next < questions.size();) {
      std::vector<Asked> asked;
      while (asked.size() < threads_ && next < questions.size()) {
        if (IsStopped()) return Status::Ok();
        MTDB_RETURN_IF_ERROR(Take(questions[next++], &questions, &asked));
      }
      Measure(&asked);
      for (Asked& q : asked) {
        q.a.triangles = q.b.triangles = {};
        all.push_back(std::move(q));
      }
    }
    for (const size_t number : chosen) {
      cells_[number].asked_again = true;
      Count(cells_[number].change, -1);
    }
    for (const Asked& q : all) Add(q.change, NextLevel(q));
    return Status::Ok();
  }
  // At which the cuts can be others.
  size_t NextLevel(const Asked& asked) const {
    if (asked.a.error <= a_.least_error() && asked.b.error <= b_.least_error()) {
      return thresholds_.size();
    }
    size_t level = asked.question.level + 1;
    const double error = std::max(asked.a.error, asked.b.error);
    while (level < thresholds_.size() && thresholds_[level] >= error) ++level;
    return level;
  }
  static void Ask(const Cell& cell, std::vector<Question>* questions) {
    const Question question{cell.change.window, cell.next_level};
    if (cell.change.triangles > kQuartered) {
      Quarter(question, questions);
    } else {
      questions->push_back(question);
    }
  }
  void Measure(std::vector<Asked>* asked) const {
    std::atomic<size_t> next{0};
    std::atomic<bool> out_of_memory{false};
    WithHelpers(std::min<size_t>(threads_, asked->size()), [&] {
      for (size_t i; (i = next.fetch_add(1)) < asked->size();) {
        Asked& q = (*asked)[i];
        const auto measure = [&] { q.change = MeasureCell(q.question.window, q.a, q.b); };
        if (!TryAllocate(measure)) out_of_memory = true;
      }
    });
    if (out_of_memory) ThrowOutOfMemory();
  }
  // The cuts for a question; of one that is too large, quarters are asked instead.
  Status Take(Question question, std::vector<Question>* questions, std::vector<Asked>* asked) {
    const PlaneWindow& w = question.window;
    const bool is_small = w.max_x - w.min_x < kSmallestCell * (window_.max_x - window_.min_x) ||
                          w.max_y - w.min_y < kSmallestCell * (window_.max_y - window_.min_y);
    const uint64_t most = is_small ? kNoLimit : kMostTriangles;
    const double threshold = thresholds_[question.level];
    MTDB_ASSIGN_OR_RETURN(std::optional<TerrainPatch> a, a_.Take(w, threshold, most));
    if (a) {
      MTDB_ASSIGN_OR_RETURN(std::optional<TerrainPatch> b, b_.Take(w, threshold, most));
      if (b) {
        asked->push_back({question, *std::move(a), *std::move(b), {}});
        return Status::Ok();
      }
    }
    Quarter(question, questions);
    return Status::Ok();
  }
  static void Quarter(const Question& question, std::vector<Question>* questions) {
    const PlaneWindow w = question.window;
    const double x = w.min_x + (w.max_x - w.min_x) / 2, y = w.min_y + (w.max_y - w.min_y) / 2;
    for (const PlaneWindow& part : {PlaneWindow{w.min_x, w.min_y, x, y},
                                    {x, w.min_y, w.max_x, y},
                                    {w.min_x, y, x, w.max_y},
                                    {x, y, w.max_x, w.max_y}}) {
      if (!part.empty()) questions->push_back({part, question.level});
    }
  }

  void Add(const CellChange& change, size_t next_level) {
    const size_t number = cells_.size();
    cells_.push_back({change, next_level, false, false});
    Count(change, 1);
    if (change.common) {
      Keep(change.rise, &result_.rise);
      Keep(change.fall, &result_.fall);
      highest_rise_.emplace(change.rise.high, number);
      highest_fall_.emplace(change.fall.high, number);
    }
    widest_.emplace(VolumeDoubt(change), number);
  }
  void Count(const CellChange& c, double sign) {
    doubt_.fill += sign * (c.fill.high - c.fill.low);
    doubt_.cut += sign * (c.cut.high - c.cut.low);
    doubt_.area += sign * c.area_both.low;
  }
  // The cell that is to be asked again; none: enough is known.
  std::optional<size_t> Next() {
    for (const auto& extreme : {std::pair{&highest_rise_, &result_.rise.height.low},
                                std::pair{&highest_fall_, &result_.fall.height.low}}) {
      if (const std::optional<size_t> next = Top(
              extreme.first, [&](double high) { return WantsExtreme(*extreme.second, high); })) {
        return next;
      }
    }
    return Top(&widest_, [&](double doubt) { return doubt > 0 && WantsVolume(); });
  }
  // The first cell that can be asked again, while it is wanted. What is left behind cannot.
  template <typename Wanted>
  std::optional<size_t> Top(Queue* queue, const Wanted& wanted) {
    while (!queue->empty()) {
      const auto [value, number] = queue->top();
      if (cells_[number].chosen || cells_[number].next_level == thresholds_.size()) {
        queue->pop();
        continue;
      }
      if (wanted(value)) return number;
      return std::nullopt;
    }
    return std::nullopt;
  }
  bool WantsExtreme(double low, double high) const {
    if (high <= 0) return false;
    const std::optional<double>& tolerance = options_.tolerance;
    if (tolerance && !IsExceeded() && high > *tolerance) return true;
    return width_ && high > low + *width_;
  }
  bool WantsVolume() const {
    return width_ && std::max(doubt_.fill, doubt_.cut) > *width_ * doubt_.area;
  }
  bool IsExceeded() const {
    return options_.tolerance &&
           std::max(result_.rise.height.low, result_.fall.height.low) > *options_.tolerance;
  }

  Result<HeightChange> Sum() {
    const auto add = [](const ValueInterval& from, ValueInterval* to) {
      to->low += from.low;
      to->high += from.high;
    };
    result_.rise.height.high = result_.fall.height.high = 0;
    for (const Cell& cell : cells_) {
      if (cell.asked_again) continue;
      const CellChange& c = cell.change;
      if (c.common) {
        result_.rise.height.high = std::max(result_.rise.height.high, c.rise.high);
        result_.fall.height.high = std::max(result_.fall.height.high, c.fall.high);
      }
      add(c.fill, &result_.fill_volume);
      add(c.cut, &result_.cut_volume);
      add(c.net, &result_.net_volume);
      add(c.area_both, &result_.area_both);
      add(c.area_a, &result_.area_a);
      add(c.area_b, &result_.area_b);
    }
    const double volume = result_.fill_volume.high + result_.cut_volume.high;
    for (ValueInterval* v : {&result_.fill_volume, &result_.cut_volume, &result_.area_both,
                             &result_.area_a, &result_.area_b}) {
      v->low *= 1 - 0x1p-40;
      v->high *= 1 + 0x1p-40;
    }
    result_.net_volume.low = std::max(result_.net_volume.low - 0x1p-40 * volume,
                                      result_.fill_volume.low - result_.cut_volume.high);
    result_.net_volume.high = std::min(result_.net_volume.high + 0x1p-40 * volume,
                                       result_.fill_volume.high - result_.cut_volume.low);
    if (options_.tolerance) {
      const double high = std::max(result_.rise.height.high, result_.fall.height.high);
      if (IsExceeded()) result_.verdict = CompareVerdict::kExceeds;
      if (high <= *options_.tolerance) result_.verdict = CompareVerdict::kWithin;
    }
    CountReading();
    return std::move(result_);
  }
  void CountReading() {
    for (const TerrainSide* side : {&a_, &b_}) {
      result_.triangles += side->reading().triangles;
      result_.clusters_read += side->reading().clusters;
      result_.bytes_read += side->reading().bytes;
    }
  }

  const HeightChangeOptions& options_;
  TerrainSide a_, b_;
  const size_t threads_;
  const Stopwatch watch_;
  PlaneWindow window_;
  std::optional<double> width_;
  std::vector<double> thresholds_;  // falling; the last is negative, for full resolution
  std::vector<Cell> cells_;
  Queue highest_rise_, highest_fall_, widest_;
  Doubt doubt_;
  HeightChange result_;
};

Status CheckLength(const std::optional<double>& value, const char* name) {
  if (!value || (*value >= 0 && IsCoordinate(*value))) return Status::Ok();
  return InvalidArgument(std::string(name) + ": expected a height from 0 to 1e30, found " +
                         std::to_string(*value));
}

Status CheckTerrains(const ObjectRecord& a, const ObjectRecord& b) {
  for (const ObjectRecord* record : {&a, &b}) {
    if (IsTerrain(*record)) continue;
    return InvalidArgument(record->name +
                           ": is no terrain, so it has no heights; compare distances instead, or "
                           "ingest it as a terrain");
  }
  const std::string a_units = a.raster ? a.raster->height_units : a.units;
  const std::string b_units = b.raster ? b.raster->height_units : b.units;
  if (!a_units.empty() && !b_units.empty() && a_units != b_units) {
    return InvalidArgument(b.name + ": its heights are in '" + b_units + "', those of " + a.name +
                           " in '" + a_units + "'; convert one of them");
  }
  const bool a_degrees = MetresOfUnit(a)[1] != 1, b_degrees = MetresOfUnit(b)[1] != 1;
  if (a_degrees == b_degrees) return Status::Ok();
  return InvalidArgument((a_degrees ? a : b).name + ": its places are in degrees, those of " +
                         (a_degrees ? b : a).name +
                         " are not; bring one of them to the other's "
                         "coordinate system");
}

Status CheckHeightOptions(const HeightChangeOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckLength(options.tolerance, "tolerance"));
  MTDB_RETURN_IF_ERROR(CheckLength(options.width, "width"));
  if (options.max_milliseconds && !(*options.max_milliseconds >= 0)) {
    return InvalidArgument("max_milliseconds: expected a number that is not negative");
  }
  if (!options.window) return Status::Ok();
  const auto& [min_x, min_y, max_x, max_y] = *options.window;
  const bool numbers = AreCoordinates({min_x, min_y, max_x}) && IsCoordinate(max_y);
  if (numbers && min_x < max_x && min_y < max_y) return Status::Ok();
  return InvalidArgument(
      "window: expected least x and y, then largest x and y that are above them");
}

}  // namespace

Result<HeightChange> CompareHeights(const Surface& a, const Surface& b,
                                    const HeightChangeOptions& options) {
  return CatchOutOfMemory([&]() -> Result<HeightChange> {
    MTDB_RETURN_IF_ERROR(CheckHeightOptions(options));
    MTDB_RETURN_IF_ERROR(CheckTerrains(a.record(), b.record()));
    HeightComparer comparer(a, b, options);
    const bool identical = a.record().digest_low == b.record().digest_low &&
                           a.record().digest_high == b.record().digest_high;
    return identical ? comparer.RunIdentical() : comparer.Run();
  });
}

}  // namespace mtdb
