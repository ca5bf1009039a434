// SPDX-License-Identifier: Apache-2.0
#include "tools/client/internal/remote_object.h"

#include "tools/client/json.h"
#include "tools/client/printable.h"

namespace mtdb::internal {

namespace {

constexpr size_t kMaxTextBytes = 16 << 20;
constexpr std::string_view kObjects = "/objects/";

}  // namespace

Result<std::string> ObjectPath(const HttpUrl& url, const std::string& name) {
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

Result<std::string> OnlyObjectPath(const HttpUrl& url, HttpClient& client) {
  std::string text;
  MTDB_ASSIGN_OR_RETURN(
      const HttpResponse response,
      client.Send("GET", "/objects", "", [&](const HttpResponse&, std::string_view piece) {
        return AppendText(url.origin(), piece, &text);
      }));
  if (response.status != 200) return Refused(url.origin(), response.status, text);
  const JsonTree json = ParseJsonObject(text);
  const JsonTree* objects =
      json.is_object() && json.contains("objects") ? &json["objects"] : nullptr;
  if (objects == nullptr || !objects->is_array()) {
    return BadInput(url.origin() + ": /objects is not a catalog; is this mtdb serve?");
  }
  if (objects->size() != 1) {
    return InvalidArgument(url.origin() + ": holds " +
                           (objects->empty() ? std::string("no object")
                                             : std::to_string(objects->size()) +
                                                   " objects; choose one by its name (--name)"));
  }
  const JsonTree& object = (*objects)[0];
  if (!object.is_object() || !object.contains("object") || !object["object"].is_string()) {
    return BadInput(url.origin() + ": /objects is not a catalog; is this mtdb serve?");
  }
  const std::string name = object["object"].get<std::string>();
  if (Printable(name) != name) {
    return BadInput(url.origin() + ": /objects is not a catalog; is this mtdb serve?");
  }
  return std::string(kObjects) + PercentEncode(name);
}

Status Refused(const std::string& where, unsigned status, const std::string& text) {
  const JsonTree json = ParseJsonObject(text);
  const bool told = json.is_object() && json.contains("error") && json["error"].is_string();
  const std::string message =
      where + ": " + std::to_string(status) + ": " +
      (told ? json["error"].get<std::string>() : "not an answer of mtdb serve; does it run there?");
  if (!told && status < 500) return BadInput(message);
  if (status == 404 || status == 410) return NotFound(message);
  if (status == 503) return {StatusCode::kBusy, message};
  return status >= 500 ? IoError(message) : InvalidArgument(message);
}

Status AppendText(const std::string& where, std::string_view piece, std::string* text) {
  if (text->size() + piece.size() > kMaxTextBytes) {
    return BadInput(where + ": the server's answer is too long for what was asked");
  }
  text->append(piece);
  return Status::Ok();
}

}  // namespace mtdb::internal
