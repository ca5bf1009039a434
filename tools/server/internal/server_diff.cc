// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_diff.h"

#include <algorithm>

#include "tools/request/report_json.h"

namespace mtdb::internal {
namespace {

// Of each direction; each is some 400 bytes of JSON.
constexpr size_t kMostPlaces = 5000;

Result<Json> CompareHeightsForClient(const Surface& a, const Surface& b,
                                     const CompareRequest& request, QueryControl* control) {
  HeightChangeOptions options = HeightChangeOptionsOf(request, a.record());
  options.threads = 1;
  options.control = control;
  MTDB_ASSIGN_OR_RETURN(const HeightChange found, CompareHeights(a, b, options));
  return HeightChangeJson(a.record(), b.record(), found);
}

}  // namespace

Result<Json> CompareForClient(const Surface& a, const Surface& b, const CompareRequest& request,
                              QueryControl* control, ServerLedger::Account* memory) {
  if (request.heights) return CompareHeightsForClient(a, b, request, control);
  MTDB_ASSIGN_OR_RETURN(CompareOptions options, CompareOptionsOf(request, a.record()));
  options.max_places = std::min(options.max_places, kMostPlaces);
  options.threads = 1;
  options.control = control;
  options.may_hold = [memory](uint64_t bytes) { return memory->Set(bytes); };
  Result<Comparison> found = Compare(a, b, options);
  memory->Note(0);
  if (!found.ok()) return found.status();
  return ComparisonJson(a.record(), b.record(), *found);
}

}  // namespace mtdb::internal
