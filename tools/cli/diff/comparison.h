// SPDX-License-Identifier: Apache-2.0
// What `mtdb diff` is asked for, and what it tells.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "query/compare.h"
#include "tools/cli/query_report.h"
#include "tools/cli/verbs.h"
#include "tools/request/compare_request.h"
#include "tools/request/query_options.h"

namespace mtdb {

// What is written beside the answer.
struct DiffFiles {
  std::string csv;                // the places
  std::string places_query;       // a query for them
  std::string geojson;            // a polygon for each
  std::vector<std::string> into;  // a store and the name of an object; empty: no map
};

struct DiffArguments {
  QueryArguments a, b;  // of these the store, the object and the cache
  QueryOptions region;
  CompareRequest request;  // but for the region
  unsigned threads = 0;
  DiffFiles files;
  bool json = false;
  bool verbose = false;
};

// "M11,M12,...,M44".
Result<Transform> ParseTransform(const std::string& text);
// The exit status of a verdict.
int DiffStatus(bool has_tolerance, CompareVerdict verdict);
// Compares, tells, and sets the exit status.
Status Diff(const DiffArguments& arguments, Invocation& invocation);

}  // namespace mtdb
