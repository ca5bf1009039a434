// SPDX-License-Identifier: Apache-2.0
#include "query/compare.h"

#include <algorithm>
#include <utility>

#include "query/compare/check_options.h"
#include "query/compare/one_sided.h"
#include "query/fields/stopwatch.h"
#include "query/query_control.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

bool IsCancelled(const QueryControl* control) { return control != nullptr && control->cancelled(); }

class Comparer {
 public:
  Comparer(const Surface& a, const Surface& b, const Placement& placement,
           const CompareOptions& options)
      : options_(options),
        a_(a, {}, options.as_stored, options.control),
        b_(b, placement, options.as_stored, options.control) {
    result_.clusters_total = a.index().cluster_count();
    if (&a != &b) result_.clusters_total += b.index().cluster_count();
  }

  Result<Comparison> Run() {
    // The second direction has what the first one leaves of the time.
    const double part = options_.a_asks && options_.b_asks ? 0.5 : 1;
    if (options_.a_asks) MTDB_RETURN_IF_ERROR(Ask(a_, b_, part, &result_.a_to_b));
    if (options_.b_asks) MTDB_RETURN_IF_ERROR(Ask(b_, a_, 1, &result_.b_to_a));
    Join();
    return std::move(result_);
  }

 private:
  Status Ask(const Side& asking, const Side& answering, double part,
             std::optional<OneSidedDistance>* answer) {
    OneSided search(asking, answering, Limits(part));
    MTDB_RETURN_IF_ERROR(search.Run());
    if (IsCancelled(options_.control))
      return {StatusCode::kCancelled, "the comparison was cancelled"};
    *answer = search.Take();
    result_.out_of_memory |= search.out_of_memory();
    result_.out_of_time |= search.stopped() && !search.out_of_memory();
    result_.triangles += search.triangles();
    result_.clusters_read += search.reading().clusters;
    result_.bytes_read += search.reading().bytes;
    return Status::Ok();
  }

  OneSidedLimits Limits(double part) const {
    OneSidedLimits limits;
    limits.tolerance = options_.tolerance;
    limits.width = options_.width;
    limits.reach = options_.reach;
    limits.region = options_.region;
    if (!limits.tolerance && !limits.width) limits.width = StandardWidth(a_, b_);
    limits.most_places = options_.max_places;
    limits.may_hold = options_.may_hold;
    limits.threads = options_.threads > 0 ? options_.threads : ProcessorCount();
    limits.stop = [this, part] {
      if (IsCancelled(options_.control)) return true;
      return options_.max_milliseconds &&
             watch_.Seconds() * 1e3 >= part * *options_.max_milliseconds;
    };
    return limits;
  }

  void Join() {
    result_.distance = {0, 0};
    bool within = true, exceeds = false;
    for (const std::optional<OneSidedDistance>* side : {&result_.a_to_b, &result_.b_to_a}) {
      if (!*side) continue;
      const OneSidedDistance& one = **side;
      result_.distance.low = std::max(result_.distance.low, one.distance.low);
      result_.distance.high = std::max(result_.distance.high, one.distance.high);
      within &= one.verdict == CompareVerdict::kWithin;
      exceeds |= one.verdict == CompareVerdict::kExceeds;
    }
    if (within) result_.verdict = CompareVerdict::kWithin;
    if (exceeds) result_.verdict = CompareVerdict::kExceeds;
  }

  const CompareOptions& options_;
  const Side a_, b_;
  const Stopwatch watch_;
  Comparison result_;
};

Comparison Identical(const CompareOptions& options) {
  Comparison same;
  same.identical = true;
  same.distance = {0, 0};
  OneSidedDistance side;
  side.distance = {0, 0};
  if (options.tolerance) side.verdict = same.verdict = CompareVerdict::kWithin;
  if (options.a_asks) same.a_to_b = side;
  if (options.b_asks) same.b_to_a = side;
  return same;
}

bool HaveEqualDigests(const ObjectRecord& a, const ObjectRecord& b) {
  return a.digest_low == b.digest_low && a.digest_high == b.digest_high;
}

}  // namespace

Result<Comparison> Compare(const Surface& a, const Surface& b, const CompareOptions& options) {
  return CatchOutOfMemory([&]() -> Result<Comparison> {
    MTDB_RETURN_IF_ERROR(CheckCompareOptions(a, b, options));
    MTDB_ASSIGN_OR_RETURN(const Placement placement, Placement::Of(options.transform));
    if (placement.identity() && HaveEqualDigests(a.record(), b.record())) return Identical(options);
    return Comparer(a, b, placement, options).Run();
  });
}

}  // namespace mtdb
