// SPDX-License-Identifier: Apache-2.0
#include <charconv>

#include "store/base/json.h"
#include "tools/client/client.h"
#include "tools/client/http_client.h"
#include "tools/client/internal/remote_object.h"
#include "tools/client/shortfall_json.h"

namespace mtdb {

using namespace internal;

namespace {

// The headers of a mesh; false when one of them is missing or something else.
bool TakeHeaders(const HttpResponse& response, FetchAnswer* answer) {
  bool ok = true;
  const auto take = [&](const char* name, auto* number) {
    const std::string text = response.header(name);
    const char* end = text.data() + text.size();
    const auto [at, error] = std::from_chars(text.data(), end, *number);
    ok = ok && error == std::errc() && at == end && *number >= 0;
  };
  take("x-mtdb-triangles", &answer->triangles);
  take("x-mtdb-vertices", &answer->vertices);
  take("x-mtdb-active-triangles", &answer->active_triangles);
  take("x-mtdb-error-bound", &answer->error_bound);
  take("x-mtdb-clusters-read", &answer->clusters_read);
  take("x-mtdb-clusters-cached", &answer->clusters_cached);
  take("x-mtdb-clusters-total", &answer->clusters_total);
  take("x-mtdb-bytes-read", &answer->bytes_read);
  answer->limit = response.header("x-mtdb-limit");
  answer->file = response.header("x-mtdb-file");
  const std::string text = response.header("x-mtdb-shortfall");
  const Result<Json> shortfall = Json::Parse(text);
  return ok && IsWord(answer->limit) && shortfall.ok() &&
         ParseShortfall(*shortfall, &answer->shortfall);
}

}  // namespace

Status CheckUrl(const std::string& url) {
  MTDB_ASSIGN_OR_RETURN(const HttpUrl parsed, ParseHttpUrl(url));
  return ObjectPath(parsed, "").status();
}

Result<FetchAnswer> FetchMesh(const std::string& url, const std::string& query,
                              const FetchOptions& options,
                              const std::function<Status(std::string_view)>& receive) {
  MTDB_ASSIGN_OR_RETURN(const HttpUrl parsed, ParseHttpUrl(url));
  FetchAnswer answer;
  MTDB_ASSIGN_OR_RETURN(answer.path, ObjectPath(parsed, options.name));
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<HttpClient> client,
                        HttpClient::Connect(parsed, options.timeout_seconds));
  if (answer.path.empty()) {
    MTDB_ASSIGN_OR_RETURN(answer.path, OnlyObjectPath(parsed, *client));
  }
  const std::string where = parsed.origin() + answer.path;
  const Status wrong = BadInput(where + ": the answer is not a mesh; is this mtdb serve?");
  std::string text;
  const auto take = [&](const HttpResponse& response, std::string_view piece) -> Status {
    if (response.status != 200) return AppendText(where, piece, &text);
    if (response.header("x-mtdb-triangles").empty()) return wrong;
    if (response.until_close) {
      return BadInput(where + ": the answer has no length, so that it may not be whole");
    }
    answer.bytes_received += piece.size();
    return receive(piece);
  };
  MTDB_ASSIGN_OR_RETURN(const HttpResponse response,
                        client->Send("POST",
                                     answer.path + "/mesh?format=" + options.format +
                                         (options.double_positions ? "&double-positions" : ""),
                                     query, take));
  if (response.status != 200) return Refused(where, response.status, text);
  // A mesh without triangles may be a file without bytes.
  if (!TakeHeaders(response, &answer)) return wrong;
  return answer;
}

}  // namespace mtdb
