// Queries as JSON values, which options put together; query/query_json.h reads them as text.
#pragma once

#include <string>

#include "query/query_json.h"
#include "tools/client/json.h"

namespace mtdb {

using QueryJson = Json;

// As ParseQuery.
inline Result<Query> QueryFromJson(const QueryJson& json, double diagonal) {
  return ParseQuery(json.dump(), diagonal);
}

// The value of a text that is a query. Errors: those of ParseQuery.
inline Result<QueryJson> ParseQueryText(const std::string& text) {
  MTDB_RETURN_IF_ERROR(ParseQuery(text, 0).status());
  return QueryJson::parse(text);
}

}  // namespace mtdb
