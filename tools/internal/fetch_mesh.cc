#include <cstdlib>

#include "tools/client.h"
#include "tools/internal/http_client.h"
#include "tools/internal/remote_object.h"
#include "tools/internal/shortfall_json.h"

namespace mtdb {

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
    if (response.status != 200) return AppendText(piece, &text);
    if (response.header("x-mtdb-triangles").empty()) return wrong;
    answer.bytes_received += piece.size();
    return receive(piece);
  };
  MTDB_ASSIGN_OR_RETURN(
      const HttpResponse response,
      client->Send("POST", answer.path + "/mesh?format=" + options.format, query, take));
  if (response.status != 200) return Refused(where, response.status, text);
  // A mesh without triangles may be a file without bytes.
  if (response.header("x-mtdb-triangles").empty()) return wrong;
  const auto count = [&](const char* name) -> uint64_t {
    return std::strtoull(response.header(name).c_str(), nullptr, 10);
  };
  answer.triangles = count("x-mtdb-triangles");
  answer.vertices = count("x-mtdb-vertices");
  answer.active_triangles = count("x-mtdb-active-triangles");
  answer.error_bound = std::strtod(response.header("x-mtdb-error-bound").c_str(), nullptr);
  const auto shortfall = nlohmann::json::parse(response.header("x-mtdb-shortfall"), nullptr, false);
  if (!ParseShortfall(shortfall, &answer.shortfall)) return wrong;
  answer.limit = response.header("x-mtdb-limit");
  answer.clusters_read = count("x-mtdb-clusters-read");
  answer.clusters_cached = count("x-mtdb-clusters-cached");
  answer.clusters_total = count("x-mtdb-clusters-total");
  answer.bytes_read = count("x-mtdb-bytes-read");
  return answer;
}

}  // namespace mtdb
