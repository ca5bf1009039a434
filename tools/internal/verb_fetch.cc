#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <unistd.h>

#include "tools/internal/http_client.h"
#include "tools/internal/report_json.h"
#include "tools/internal/server_request.h"
#include "tools/internal/verbs.h"

namespace mtdb {

namespace {

using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

constexpr size_t kMaxTextBytes = 16 << 20;  // of a catalog or an error
constexpr const char* kExtensions[] = {".ply", ".obj", ".stl", ".off", ".glb", ".drc"};

// What is written under a temporary name and gets its own in the end.
class OutputFile {
 public:
  explicit OutputFile(const std::string& path)
      : path_(path), temporary_(path + "." + std::to_string(::getpid()) + ".tmp") {}
  ~OutputFile() {
    if (file_ == nullptr) return;
    std::fclose(file_);
    ::unlink(temporary_.c_str());
  }
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  Status Open() {
    file_ = std::fopen(temporary_.c_str(), "wbx");
    return file_ != nullptr ? Status::Ok() : Failure();
  }
  Status Append(std::string_view bytes) {
    bytes_ += bytes.size();
    return std::fwrite(bytes.data(), 1, bytes.size(), file_) == bytes.size() ? Status::Ok()
                                                                             : Failure();
  }
  Status Commit() {
    if (std::fflush(file_) != 0 || std::rename(temporary_.c_str(), path_.c_str()) != 0) {
      return Failure();
    }
    std::fclose(std::exchange(file_, nullptr));
    return Status::Ok();
  }
  uint64_t bytes() const { return bytes_; }

 private:
  Status Failure() const {
    return IoError(path_ + ": cannot be written: " + std::generic_category().message(errno));
  }
  const std::string path_, temporary_;
  std::FILE* file_ = nullptr;
  uint64_t bytes_ = 0;
};

Status AppendText(std::string_view piece, std::string* text) {
  if (text->size() + piece.size() > kMaxTextBytes) {
    return IoError("the server's answer is too long for what was asked");
  }
  text->append(piece);
  return Status::Ok();
}

// An answer that is no success, as an error; `text` is its body.
Status Refused(const std::string& where, const HttpResponse& response, const std::string& text) {
  const Json json = Json::parse(text, nullptr, false);
  const bool told = json.is_object() && json.contains("error") && json["error"].is_string();
  const std::string why =
      told ? json["error"].get<std::string>() : "an answer that mtdb does not know";
  const std::string message = where + ": " + std::to_string(response.status) + ": " + why;
  if (response.status == 404 || response.status == 410) return NotFound(message);
  if (response.status == 503) return {StatusCode::kBusy, message};
  return response.status >= 500 ? IoError(message) : InvalidArgument(message);
}

// The object's part of the URL's path: "/objects/NAME", escaped as it is. Empty: the path is "/".
Result<std::string> ObjectPath(const HttpUrl& url, const std::string& name) {
  constexpr std::string_view kObjects = "/objects/";
  const bool given = url.path.starts_with(kObjects) && url.path.size() > kObjects.size() &&
                     url.path.find('/', kObjects.size()) == std::string::npos;
  if (!given && url.path != "/" && url.path != "/objects" && url.path != kObjects) {
    return InvalidArgument(url.origin() + url.path +
                           ": expected http://HOST:PORT or http://HOST:PORT/objects/NAME");
  }
  if (given && !name.empty()) {
    return InvalidArgument("--name: the URL names an object already");
  }
  if (given) return url.path;
  return name.empty() ? "" : std::string(kObjects) + PercentEncode(name);
}

// That of the server's only object.
Result<std::string> OnlyObjectPath(const HttpUrl& url, HttpClient& client) {
  std::string text;
  MTDB_ASSIGN_OR_RETURN(
      const HttpResponse response,
      client.Send("GET", "/objects", "", [&](const HttpResponse&, std::string_view piece) {
        return AppendText(piece, &text);
      }));
  if (response.status != 200) return Refused(url.origin(), response, text);
  const Json json = Json::parse(text, nullptr, false);
  const Json* objects = json.is_object() && json.contains("objects") ? &json["objects"] : nullptr;
  if (objects == nullptr || !objects->is_array()) {
    return BadInput(url.origin() + ": /objects is not a catalog; is this mtdb serve?");
  }
  if (objects->size() != 1) {
    return InvalidArgument(url.origin() + ": holds " + std::to_string(objects->size()) +
                           " objects; choose one by its name (--name)");
  }
  const Json& object = (*objects)[0];
  if (!object.is_object() || !object.contains("object") || !object["object"].is_string()) {
    return BadInput(url.origin() + ": /objects is not a catalog; is this mtdb serve?");
  }
  return "/objects/" + PercentEncode(object["object"].get<std::string>());
}

void PrintAnswer(const QueryArguments& arguments, const std::string& path,
                 const HttpResponse& response, uint64_t bytes, double seconds) {
  const auto count = [&](const char* name) -> unsigned long long {
    return std::strtoull(response.header(name).c_str(), nullptr, 10);
  };
  const double error_bound = std::strtod(response.header("x-mtdb-error-bound").c_str(), nullptr);
  const std::string limit = response.header("x-mtdb-limit");
  if (arguments.json) {
    PrintJson({{"url", arguments.store},
               {"path", path},
               {"output", arguments.output},
               {"triangles", count("x-mtdb-triangles")},
               {"vertices", count("x-mtdb-vertices")},
               {"active_triangles", count("x-mtdb-active-triangles")},
               {"error_bound", error_bound},
               {"limit", limit},
               {"clusters_read", count("x-mtdb-clusters-read")},
               {"clusters_cached", count("x-mtdb-clusters-cached")},
               {"clusters_total", count("x-mtdb-clusters-total")},
               {"bytes_read", count("x-mtdb-bytes-read")},
               {"bytes_received", bytes},
               {"seconds", seconds}});
    return;
  }
  std::printf("%s: %llu triangles, %llu vertices, error at most %.6g\n", arguments.output.c_str(),
              count("x-mtdb-triangles"), count("x-mtdb-vertices"), error_bound);
  std::printf("  %llu triangles within reach of the region; refined until the limit of %s\n",
              count("x-mtdb-active-triangles"), limit.c_str());
  std::printf("  the server read %llu of %llu clusters, %.1f KB; %llu were in its cache\n",
              count("x-mtdb-clusters-read"), count("x-mtdb-clusters-total"),
              static_cast<double>(count("x-mtdb-bytes-read")) / 1e3,
              count("x-mtdb-clusters-cached"));
  std::printf("  received %.1f KB in %.1f ms\n", static_cast<double>(bytes) / 1e3, 1e3 * seconds);
}

}  // namespace

Status Fetch(const QueryArguments& arguments) {
  const Clock::time_point begin = Clock::now();
  MTDB_ASSIGN_OR_RETURN(const QueryJson query, QueryOf(arguments.query, arguments.size));
  if (arguments.print_query) {
    PrintJson(query);
    return Status::Ok();
  }
  const std::string extension = std::filesystem::path(arguments.output).extension().string();
  if (std::find(std::begin(kExtensions), std::end(kExtensions), extension) ==
      std::end(kExtensions)) {
    return Unsupported(arguments.output +
                       ": expected a name that ends in .ply, .obj, .stl, .off, .glb or .drc");
  }
  MTDB_ASSIGN_OR_RETURN(const HttpUrl url, ParseHttpUrl(arguments.store));
  MTDB_ASSIGN_OR_RETURN(std::string path, ObjectPath(url, arguments.name));
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<HttpClient> client,
                        HttpClient::Connect(url, arguments.timeout_seconds));
  if (path.empty()) {
    MTDB_ASSIGN_OR_RETURN(path, OnlyObjectPath(url, *client));
  }
  OutputFile output(arguments.output);
  std::string text;
  bool opened = false;
  const auto receive = [&](const HttpResponse& response, std::string_view piece) -> Status {
    if (response.status != 200) return AppendText(piece, &text);
    if (!opened) MTDB_RETURN_IF_ERROR(output.Open());
    opened = true;
    return output.Append(piece);
  };
  MTDB_ASSIGN_OR_RETURN(
      const HttpResponse response,
      client->Send("POST", path + "/mesh?format=" + extension.substr(1), query.dump(), receive));
  if (response.status != 200) return Refused(url.origin() + path, response, text);
  if (!opened || response.header("x-mtdb-triangles").empty()) {
    return BadInput(url.origin() + path + ": the answer is not a mesh; is this mtdb serve?");
  }
  MTDB_RETURN_IF_ERROR(output.Commit());
  PrintAnswer(arguments, path, response, output.bytes(),
              std::chrono::duration<double>(Clock::now() - begin).count());
  return Status::Ok();
}

}  // namespace mtdb
