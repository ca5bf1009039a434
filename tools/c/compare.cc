// SPDX-License-Identifier: Apache-2.0
// Comparisons from C.
#include "query/compare.h"

#include <algorithm>

#include "query/height_change.h"
#include "tools/c/internal/handles.h"
#include "tools/c/mtdb_terrain.h"
#include "tools/request/report_json.h"

namespace mtdb::internal {
namespace {

std::optional<double> IfAboveZero(double value) {
  return value == 0 ? std::nullopt : std::optional<double>(value);
}

Result<CompareOptions> CompareOptionsOf(const mtdb_compare_options* options) {
  MTDB_ASSIGN_OR_RETURN(const mtdb_compare_options given, Take(options, "options"));
  CompareOptions with;
  if (given.has_tolerance != 0) with.tolerance = given.tolerance;
  with.width = IfAboveZero(given.width);
  with.reach = IfAboveZero(given.reach);
  if (given.has_max_milliseconds != 0) with.max_milliseconds = given.max_milliseconds;
  if (given.query != nullptr) with.region = given.query->query.region;
  if (given.transform != nullptr) std::copy_n(given.transform, 16, with.transform.begin());
  if (given.asks < MTDB_ASKS_BOTH || given.asks > MTDB_ASKS_B) {
    return InvalidArgument("options.asks: expected one of mtdb_asks");
  }
  with.a_asks = given.asks != MTDB_ASKS_B;
  with.b_asks = given.asks != MTDB_ASKS_A;
  with.as_stored = given.as_stored != 0;
  with.threads = given.threads;
  with.control = ControlOf(given.control);
  return with;
}

Result<HeightChangeOptions> HeightOptionsOf(const mtdb_height_change_options* options) {
  MTDB_ASSIGN_OR_RETURN(const mtdb_height_change_options given, Take(options, "options"));
  HeightChangeOptions with;
  if (given.has_tolerance != 0) with.tolerance = given.tolerance;
  if (given.has_width != 0) with.width = given.width;
  if (given.has_max_milliseconds != 0) with.max_milliseconds = given.max_milliseconds;
  if (given.window != nullptr) std::copy_n(given.window, 4, with.window.emplace().begin());
  with.as_stored = given.as_stored != 0;
  with.threads = given.threads;
  with.control = ControlOf(given.control);
  return with;
}

}  // namespace
}  // namespace mtdb::internal

mtdb_code mtdb_compare(mtdb_object* a, mtdb_object* b, const mtdb_compare_options* options,
                       mtdb_json** json, mtdb_error* error) {
  using mtdb::internal::NeedAll;
  return mtdb::internal::Guarded(error, [&]() -> mtdb::Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{a, "a"}, {b, "b"}, {json, "json"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb::CompareOptions with,
                          mtdb::internal::CompareOptionsOf(options));
    MTDB_ASSIGN_OR_RETURN(const mtdb::Comparison found, Compare(*a->surface, *b->surface, with));
    *json = new mtdb_json{
        mtdb::ComparisonJson(a->surface->record(), b->surface->record(), found).Text()};
    return mtdb::Status::Ok();
  });
}

mtdb_code mtdb_compare_heights(mtdb_object* a, mtdb_object* b,
                               const mtdb_height_change_options* options, mtdb_json** json,
                               mtdb_error* error) {
  using mtdb::internal::NeedAll;
  return mtdb::internal::Guarded(error, [&]() -> mtdb::Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{a, "a"}, {b, "b"}, {json, "json"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb::HeightChangeOptions with,
                          mtdb::internal::HeightOptionsOf(options));
    MTDB_ASSIGN_OR_RETURN(const mtdb::HeightChange found,
                          CompareHeights(*a->surface, *b->surface, with));
    *json = new mtdb_json{
        mtdb::HeightChangeJson(a->surface->record(), b->surface->record(), found).Text()};
    return mtdb::Status::Ok();
  });
}
