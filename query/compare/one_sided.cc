// SPDX-License-Identifier: Apache-2.0
#include "query/compare/one_sided.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "query/compare/curve.h"
#include "query/compare/helpers.h"
#include "query/compare/outward.h"
#include "query/compare/touching.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {
namespace {

constexpr double kFall = 4;  // of the threshold from level to level
// Two cuts of one surface with such bounds are nearer to each other than half of the tolerance, and
// what they stand for than all of it.
constexpr double kPartOfTolerance = 0.23;
// Of the triangles of an item; those of the other surface around it.
constexpr uint64_t kMostAsking = 200'000, kMostAnswering = 600'000, kMostOfWhole = 1'000'000;
constexpr uint64_t kNoLimit = std::numeric_limits<uint64_t>::max();
// That make one item: the next level has some eight triangles for each.
constexpr size_t kDoubtsOfItem = 16'384;
constexpr size_t kTrianglesPerTake = 64;
constexpr uint64_t kTreeBytes = 64;  // of a tree of boxes, for each triangle
// Of all triangles of an item together, beside what each may have in any case.
constexpr size_t kMostParts = size_t{1} << 18, kMostPartsAtLast = size_t{1} << 22;
constexpr double kPlaceAsAWhole = 1.0 / 16;  // so small are places that are not looked into
constexpr double kResolution = 1.0 / 512;    // of places, in the surface's diagonal
constexpr double kSmallestBox = 1e-3;        // that is cut in two, of the surface's diagonal

// Between points of both boxes, at most.
double FarthestBetween(const Box3d& a, const Box3d& b) {
  double far2 = 0;
  for (int i = 0; i < 3; ++i) {
    const double far = std::max(a.max[i] - b.min[i], b.max[i] - a.min[i]);
    far2 += far * far;
  }
  return Up(std::sqrt(far2));
}

double HighestOf(auto first, auto last) {
  double high = 0;
  for (; first != last; ++first) high = std::max(high, first->distance.high);
  return high;
}

BoxSetPtr BoxesOf(const auto& doubts) {
  if (doubts.empty()) return nullptr;
  std::vector<Box3d> boxes;
  boxes.reserve(doubts.size());
  for (const auto& d : doubts) boxes.push_back(d.box);
  return std::make_shared<BoxSet>(std::move(boxes));
}

}  // namespace

bool OneSided::Item::operator<(const Item& other) const {
  return high != other.high ? high < other.high : number > other.number;
}

OneSided::OneSided(const Side& asking, const Side& answering, const OneSidedLimits& limits)
    : asking_(asking),
      answering_(answering),
      limits_(limits),
      goals_(limits.tolerance, limits.width, limits.reach),
      places_(limits.reach, limits.most_places) {
  if (asking.empty()) return;
  outward_ = kOutward * std::max(LargestMagnitude(asking.bounds()),
                                 answering.empty() ? 0 : LargestMagnitude(answering.bounds()));
  MakeThresholds();
  Item whole;
  whole.high = answering.empty() ? std::numeric_limits<double>::infinity()
                                 : Up(FarthestBetween(asking.bounds(), answering.bounds()) +
                                      asking.least_bound() + answering.least_bound());
  Push(std::move(whole));
}

void OneSided::MakeThresholds() {
  const double least = std::max(asking_.least_bound(), answering_.least_bound());
  const double largest = std::max(asking_.largest_bound(), answering_.largest_bound());
  double threshold = largest / kFall;
  if (limits_.tolerance) {
    const double part = *limits_.tolerance * kPartOfTolerance;
    if (part < threshold / 2 && threshold > least) thresholds_.push_back(threshold);
    threshold = std::min(threshold, part);
  } else {
    // One of them is a fifth of the width, where both bounds leave intervals that are narrow
    // enough.
    const double part = *limits_.width / 5;
    if (part > 0)
      threshold = std::min(threshold, part * std::pow(kFall, std::floor(std::log(threshold / part) /
                                                                        std::log(kFall))));
  }
  // Below this there is nothing between the errors and none.
  const double finest = std::max(2 * least, largest * 0x1p-24);
  for (; threshold > finest; threshold /= kFall) thresholds_.push_back(threshold);
  thresholds_.push_back(-1);
}

void OneSided::Push(Item item) {
  item.number = numbers_++;
  item_bytes_ += item.doubts.size() * sizeof(Doubt);
  items_.push(std::move(item));
}

void OneSided::Pop() {
  item_bytes_ -= items_.top().doubts.size() * sizeof(Doubt);
  items_.pop();
}

bool OneSided::MayHold(uint64_t bytes) {
  if (!limits_.may_hold || limits_.may_hold(item_bytes_ + bytes)) return true;
  out_of_memory_ = true;
  return false;
}

Status OneSided::Run() {
  if (answering_.empty() && !items_.empty()) {
    goals_.Raise(std::numeric_limits<double>::infinity(), asking_.bounds().min);
    return Status::Ok();
  }
  while (!items_.empty() && !stopped_) {
    if (limits_.stop() || !MayHold(0)) {
      stopped_ = true;
      break;
    }
    if (goals_.Met(0, items_.top().high)) {
      proved_high_ = std::max(proved_high_, items_.top().high);
      Pop();
      continue;
    }
    // It stays there until it has been looked at, in case that is interrupted.
    MTDB_RETURN_IF_ERROR(Look(items_.top()));
  }
  return Status::Ok();
}

Status OneSided::Look(Item item) {
  BoxSetPtr boxes = BoxesOf(item.doubts);
  const double threshold = thresholds_[item.level];
  std::optional<Patch> asking;
  if (item.most) {
    MTDB_ASSIGN_OR_RETURN(asking, asking_.Take(nullptr, 0, threshold, kMostOfWhole, &reading_));
    if (asking) boxes = nullptr;
  }
  if (!asking) {
    const uint64_t most = boxes == nullptr ? kNoLimit : kMostAsking;
    MTDB_ASSIGN_OR_RETURN(asking, asking_.Take(boxes, 0, threshold, most, &reading_));
  }
  if (!asking) {
    if (PushHalves(item)) return Status::Ok();
    MTDB_ASSIGN_OR_RETURN(asking, asking_.Take(boxes, 0, threshold, kNoLimit, &reading_));
  }
  return Compare(item, *asking, boxes);
}

Status OneSided::Compare(const Item& item, const Patch& asking, const BoxSetPtr& boxes) {
  GapQuestion question;
  question.high = item.high;
  question.known = Up(item.high);
  if (limits_.reach) {
    question.known = std::min(question.known, Up(*limits_.reach + 4 * asking.bound + 4 * outward_));
  }
  question.asking = {boxes, limits_.region, Up(asking.bound + outward_)};
  MTDB_ASSIGN_OR_RETURN(const std::optional<Patch> answering,
                        Answering(item, boxes, question.known + question.asking.bound));
  if (!answering) return Status::Ok();
  const TriangleTree tree(answering->triangles, outward_);
  question.tree = &tree;
  question.answer_bound = answering->bound;
  const bool last = thresholds_[item.level] < 0;
  const double blur = asking.bound + answering->bound;
  const double fine = goals_.width() ? *goals_.width() / 4 : *goals_.tolerance() / 256;
  question.accuracy = std::max(last ? std::max(fine, blur / 8) : blur / 4, 8 * outward_);
  question.resolution = Diagonal(asking_.bounds()) * kResolution;
  question.most_parts =
      (last ? kMostPartsAtLast : kMostParts) / (asking.triangles.size() + 1) + (last ? 4096 : 256);
  std::vector<GapAnswer> answers(asking.triangles.size());
  const uint64_t held_bytes = asking.triangles.size() * (sizeof(Triangle3d) + sizeof(GapAnswer)) +
                              answering->triangles.size() * (2 * sizeof(Triangle3d) + kTreeBytes);
  if (Ask(asking.triangles, question, held_bytes, &answers)) {
    Pop();
    Gather(item, answers);
  }
  return Status::Ok();
}

Result<std::optional<Patch>> OneSided::Answering(const Item& item, const BoxSetPtr& boxes,
                                                 double within) {
  double threshold = thresholds_[item.level];
  for (;;) {
    const uint64_t most = item.doubts.empty() ? kNoLimit
                          : boxes == nullptr  ? kMostOfWhole
                                              : kMostAnswering;
    MTDB_ASSIGN_OR_RETURN(std::optional<Patch> patch,
                          answering_.Take(boxes, Up(within), threshold, most, &reading_));
    if (patch) return patch;
    if (PushHalves(item)) return std::optional<Patch>();
    // A small box that is far away from much: all of it at the same error is not to be had.
    threshold = threshold < 0
                    ? std::max(2 * answering_.least_bound(), answering_.largest_bound() * 0x1p-20)
                    : 2 * threshold;
    if (threshold < answering_.largest_bound()) continue;
    MTDB_ASSIGN_OR_RETURN(patch,
                          answering_.Take(boxes, Up(within), threshold, kNoLimit, &reading_));
    return patch;
  }
}

bool OneSided::PushHalves(const Item& item) {
  std::vector<Doubt> doubts = item.doubts;
  if (doubts.size() == 1) {
    const Box3d box = doubts[0].box;
    const Vec3d size = box.max - box.min;
    if (Length(size) < kSmallestBox * Diagonal(asking_.bounds())) return false;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    doubts.push_back(doubts[0]);
    doubts[0].box.max[axis] = doubts[1].box.min[axis] = box.min[axis] + size[axis] / 2;
  }
  if (doubts.empty()) return false;
  std::array<std::vector<Doubt>, 2> halves;
  const auto middle = doubts.begin() + static_cast<ptrdiff_t>(doubts.size() / 2);
  halves[0].assign(doubts.begin(), middle);
  halves[1].assign(middle, doubts.end());
  const size_t level = item.level;
  Pop();
  for (std::vector<Doubt>& half : halves) {
    const double high = HighestOf(half.begin(), half.end());
    Push({std::move(half), false, high, level, 0});
  }
  return true;
}

bool OneSided::Ask(const std::vector<Triangle3d>& triangles, const GapQuestion& question,
                   uint64_t held_bytes, std::vector<GapAnswer>* answers) {
  std::atomic<size_t> next{0};
  std::atomic<uint64_t> held{held_bytes};
  std::atomic<bool> stop{false}, out_of_memory{false};
  const auto work = [&] {
    TriangleGap gap(question, &goals_);
    for (size_t first; !stop && (first = next.fetch_add(kTrianglesPerTake)) < triangles.size();) {
      if (limits_.stop() || !MayHold(held)) stop = true;
      const size_t last = std::min(first + kTrianglesPerTake, triangles.size());
      for (size_t i = first; i < last && !stop; ++i) {
        GapAnswer& answer = (*answers)[i] = gap.Find(triangles[i]);
        held += (answer.doubts.capacity() + answer.excesses.capacity()) * sizeof(GapPart);
      }
    }
  };
  const auto safely = [&] {
    if (!TryAllocate(work)) stop = out_of_memory = true;
  };
  WithHelpers(std::min<size_t>(limits_.threads, triangles.size() / kTrianglesPerTake), safely);
  if (out_of_memory) ThrowOutOfMemory();
  triangles_ += triangles.size();
  stopped_ |= stop;
  return !stop;
}

void OneSided::Gather(const Item& item, const std::vector<GapAnswer>& answers) {
  std::vector<Doubt> doubts;
  size_t in_doubt = 0;
  for (const GapAnswer& a : answers) {
    proved_high_ = std::max(proved_high_, a.met_high);
    for (const GapPart& part : a.excesses) {
      places_.Add({part.box, part.point, part.distance, CompareVerdict::kExceeds, false});
    }
    AddDoubts(a.doubts, &doubts);
    in_doubt += a.doubts.empty() ? 0 : 1;
  }
  if (!goals_.width() && goals_.tolerance()) LeaveRims(answers, &doubts);
  if (item.level + 1 == thresholds_.size()) {
    LeaveUndecided(doubts);
  } else {
    const bool all_asked = item.doubts.empty() || item.most;
    PushGroups(std::move(doubts), item.level + 1, all_asked && in_doubt > answers.size() / 4);
  }
}

// Few boxes are asked faster than many: parts of a small triangle become one.
void OneSided::AddDoubts(const std::vector<GapPart>& parts, std::vector<Doubt>* doubts) const {
  Doubt together{{}, {0, 0}};
  for (const GapPart& part : parts) {
    together.box.Add(part.box);
    together.distance.low = std::max(together.distance.low, part.distance.low);
    together.distance.high = std::max(together.distance.high, part.distance.high);
  }
  const double small = 4 * kResolution * Diagonal(asking_.bounds());
  if (!parts.empty() && Diagonal(together.box) <= small) {
    doubts->push_back(together);
    return;
  }
  for (const GapPart& part : parts) doubts->push_back({part.box, part.distance});
}

// Where a small place ends exactly decides nothing: what hangs together with a part that exceeds
// the tolerance belongs to its place, and is not looked at again. But whether some of it is missing
// is found out.
void OneSided::LeaveRims(const std::vector<GapAnswer>& answers, std::vector<Doubt>* doubts) {
  std::vector<Doubt> parts = *doubts;
  for (const GapAnswer& a : answers) {
    for (const GapPart& part : a.excesses) parts.push_back({part.box, part.distance});
  }
  if (parts.size() == doubts->size()) return;
  std::vector<Box3d> boxes;
  for (const Doubt& d : parts) boxes.push_back(d.box);
  const std::vector<uint32_t> groups = TouchingGroups(boxes);
  std::vector<Doubt> around(parts.size());
  for (size_t i = 0; i < parts.size(); ++i) {
    Doubt& group = around[groups[i]];
    group.box.Add(parts[i].box);
    group.distance.low = std::max(i == groups[i] ? 0 : group.distance.low, parts[i].distance.low);
    group.distance.high =
        std::max(i == groups[i] ? 0 : group.distance.high, parts[i].distance.high);
  }
  const std::vector<Doubt> all = std::exchange(*doubts, {});
  std::vector<Doubt> rims;
  for (size_t i = 0; i < all.size(); ++i) {
    (IsKnownPlace(around[groups[i]]) ? rims : *doubts).push_back(all[i]);
  }
  LeaveUndecided(rims);
}

bool OneSided::IsKnownPlace(const Doubt& group) const {
  const auto& [low, high] = group.distance;
  const std::optional<double>& reach = goals_.reach();
  const bool decided = !reach || high <= *reach || low > *reach;
  return decided && goals_.Exceeds(low) &&
         Diagonal(group.box) <= kPlaceAsAWhole * Diagonal(asking_.bounds());
}

void OneSided::LeaveUndecided(const std::vector<Doubt>& doubts) {
  for (const Doubt& d : doubts) {
    proved_high_ = std::max(proved_high_, d.distance.high);
    if (goals_.Met(d.distance.low, d.distance.high)) continue;
    if (!goals_.tolerance() || d.distance.high <= *goals_.tolerance() ||
        goals_.Exceeds(d.distance.low))
      continue;
    places_.Add(
        {d.box, (d.box.min + d.box.max) * 0.5, d.distance, CompareVerdict::kUndecided, false});
  }
}

// Neighbours go into one item, so that the cuts around it are small.
void OneSided::PushGroups(std::vector<Doubt> doubts, size_t level, bool most) {
  if (doubts.empty()) return;
  SortAlongCurve(doubts, asking_.bounds(),
                 [](const Doubt& d) { return (d.box.min + d.box.max) * 0.5; });
  const size_t groups = most ? 1 : (doubts.size() + kDoubtsOfItem - 1) / kDoubtsOfItem;
  for (size_t group = 0; group < groups; ++group) {
    const auto first = doubts.begin() + static_cast<ptrdiff_t>(doubts.size() * group / groups);
    const auto last = doubts.begin() + static_cast<ptrdiff_t>(doubts.size() * (group + 1) / groups);
    Push({{first, last}, most, HighestOf(first, last), level, 0});
  }
}

OneSidedDistance OneSided::Take() {
  OneSidedDistance result;
  for (; !items_.empty(); Pop()) {
    const Item& item = items_.top();
    proved_high_ = std::max(proved_high_, item.high);
    LeaveUndecided(item.doubts);
  }
  result.distance = {goals_.lowest(), proved_high_};
  result.point = goals_.point();
  result.places = places_.Take();
  if (!goals_.tolerance()) return result;
  const double tolerance = *goals_.tolerance();
  if (proved_high_ <= tolerance) {
    result.verdict = CompareVerdict::kWithin;
  } else if (goals_.lowest() > tolerance) {
    result.verdict = CompareVerdict::kExceeds;
  }
  return result;
}

}  // namespace mtdb::internal
