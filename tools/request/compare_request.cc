// SPDX-License-Identifier: Apache-2.0
#include "tools/request/compare_request.h"

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "query/query_from_json.h"
#include "store/base/coordinate_limit.h"

namespace mtdb {
namespace {

constexpr size_t kExcerpt = 40;
const std::vector<const char*> kKeys{
    "object", "other", "tolerance", "width",     "reach",   "max_places", "max_milliseconds",
    "region", "asks",  "transform", "as_stored", "heights", "window"};

Status Wrong(const std::string& key, const std::string& expected, const Json& found) {
  std::string text = found.Text();
  if (text.size() > kExcerpt) text = text.substr(0, kExcerpt) + "...";
  return InvalidArgument(key + ": expected " + expected + ", found " + text);
}

Result<std::string> Name(const Json& json, const char* key) {
  const std::string* const name = json[key].string();
  if (name != nullptr && !name->empty()) return *name;
  return Wrong(key, "the name of an object", json[key]);
}

bool IsNonNegative(const Json& json) {
  return json.is_number() && json.number() >= 0 && IsCoordinate(json.number());
}

Result<std::optional<AskedError>> Length(const Json& json, const char* key) {
  if (!json.contains(key)) return std::optional<AskedError>();
  const Json& value = json[key];
  const bool relative = value.is_object() && value.size() == 1 && value.contains("relative");
  const Json& number = relative ? value["relative"] : value;
  if (IsNonNegative(number)) return std::optional(AskedError{number.number(), relative});
  return Wrong(key,
               "a length, or {\"relative\": F}, a fraction of the diagonal of \"object\"; at most "
               "1e30 and not negative",
               value);
}

// Four rows of four numbers.
Result<Transform> Matrix(const Json& json, const char* key) {
  Transform transform = kIdentity;
  if (!json.contains(key)) return transform;
  const Json& rows = json[key];
  bool is_matrix = rows.is_array() && rows.size() == 4;
  for (size_t i = 0; is_matrix && i < 16; ++i) {
    const Json& row = rows[i / 4];
    is_matrix = row.is_array() && row.size() == 4 && row[i % 4].is_number() &&
                IsCoordinate(row[i % 4].number());
    if (is_matrix) transform[i] = row[i % 4].number();
  }
  if (is_matrix) return transform;
  return Wrong(key, "a matrix as a list of 4 rows, each a list of 4 numbers", rows);
}

// [least x, least y, largest x, largest y]
Result<std::optional<std::array<double, 4>>> Window(const Json& json, const char* key) {
  if (!json.contains(key)) return std::optional<std::array<double, 4>>();
  const Json& value = json[key];
  std::array<double, 4> window{};
  bool is_window = value.is_array() && value.size() == 4;
  for (size_t i = 0; is_window && i < 4; ++i) {
    is_window = value[i].is_number() && IsCoordinate(value[i].number());
    if (is_window) window[i] = value[i].number();
  }
  if (is_window) return std::optional(window);
  return Wrong(key, "a list of least x and y, largest x and y", value);
}

Status ReadChoices(const Json& json, CompareRequest* request) {
  if (json.contains("asks")) {
    const std::string* const asks = json["asks"].string();
    if (asks == nullptr || (*asks != "a" && *asks != "b" && *asks != "both")) {
      return Wrong("asks", "\"a\", \"b\" or \"both\"", json["asks"]);
    }
    request->asks = *asks;
  }
  if (json.contains("as_stored")) {
    const bool* const as_stored = json["as_stored"].boolean();
    if (as_stored == nullptr) return Wrong("as_stored", "true or false", json["as_stored"]);
    request->as_stored = *as_stored;
  }
  if (json.contains("heights")) {
    const bool* const heights = json["heights"].boolean();
    if (heights == nullptr) return Wrong("heights", "true or false", json["heights"]);
    request->heights = *heights;
  }
  if (json.contains("max_milliseconds")) {
    const Json& most = json["max_milliseconds"];
    if (!IsNonNegative(most)) {
      return Wrong("max_milliseconds", "a number that is not negative", most);
    }
    request->max_milliseconds = most.number();
  }
  if (json.contains("max_places")) {
    const uint64_t* const most = json["max_places"].whole_number();
    if (most == nullptr || *most == 0) {
      return Wrong("max_places", "a whole number above 0", json["max_places"]);
    }
    request->max_places = *most;
  }
  return Status::Ok();
}

}  // namespace

Result<CompareOptions> CompareOptionsOf(const CompareRequest& request, const ObjectRecord& a) {
  CompareOptions options;
  const auto length = [&](const std::optional<AskedError>& asked) -> std::optional<double> {
    if (!asked) return std::nullopt;
    return ErrorModelOf(asked, a.diagonal());
  };
  options.tolerance = length(request.tolerance);
  options.width = length(request.width);
  options.reach = length(request.reach);
  options.max_milliseconds = request.max_milliseconds;
  if (request.max_places) options.max_places = *request.max_places;
  options.transform = request.transform;
  options.a_asks = request.asks != "b";
  options.b_asks = request.asks != "a";
  options.as_stored = request.as_stored;
  if (!request.region.is_null()) {
    MTDB_ASSIGN_OR_RETURN(const Query query, QueryFromJson({{"region", request.region}}, a));
    options.region = query.region;
  }
  return options;
}

std::optional<std::string> ConflictOf(const CompareRequest& request) {
  if (!request.heights) {
    return request.window ? std::optional<std::string>("window") : std::nullopt;
  }
  if (request.reach) return "reach";
  if (!request.region.is_null()) return "region";
  if (request.max_places) return "max_places";
  if (request.asks != "both") return "asks";
  if (request.transform != kIdentity) return "transform";
  return std::nullopt;
}

HeightChangeOptions HeightChangeOptionsOf(const CompareRequest& request, const ObjectRecord& a) {
  HeightChangeOptions options;
  const auto height = [&](const std::optional<AskedError>& asked) -> std::optional<double> {
    if (!asked) return std::nullopt;
    return ErrorModelOf(asked, a.bounds.max.z - a.bounds.min.z);
  };
  options.tolerance = height(request.tolerance);
  options.width = height(request.width);
  options.max_milliseconds = request.max_milliseconds;
  options.window = request.window;
  options.as_stored = request.as_stored;
  return options;
}

Result<NamedComparison> ParseComparison(std::string_view text) {
  MTDB_ASSIGN_OR_RETURN(Json json, Json::Parse(text, kDeepestQuery));
  if (!json.is_object()) {
    return InvalidArgument("expected an object with \"object\" and \"other\", the names of two");
  }
  if (const std::string* const key = json.UnknownKey(kKeys)) {
    std::string known;
    for (const char* const k : kKeys) known += (known.empty() ? "" : ", ") + std::string(k);
    return InvalidArgument("no key " + Json(key->substr(0, kExcerpt)).Text() + " here; known are " +
                           known);
  }
  NamedComparison named;
  MTDB_ASSIGN_OR_RETURN(named.object, Name(json, "object"));
  MTDB_ASSIGN_OR_RETURN(named.other, Name(json, "other"));
  CompareRequest& request = named.request;
  MTDB_ASSIGN_OR_RETURN(request.tolerance, Length(json, "tolerance"));
  MTDB_ASSIGN_OR_RETURN(request.width, Length(json, "width"));
  MTDB_ASSIGN_OR_RETURN(request.reach, Length(json, "reach"));
  MTDB_ASSIGN_OR_RETURN(request.transform, Matrix(json, "transform"));
  MTDB_RETURN_IF_ERROR(ReadChoices(json, &request));
  MTDB_ASSIGN_OR_RETURN(request.window, Window(json, "window"));
  request.region = json.Take("region");
  if (const std::optional<std::string> conflict = ConflictOf(request)) {
    return InvalidArgument(*conflict + (request.heights
                                            ? ": does not go with heights"
                                            : ": is for heights only; add \"heights\": true"));
  }
  return named;
}

}  // namespace mtdb
