// SPDX-License-Identifier: Apache-2.0
#include "tools/client/internal/remote_object.h"

#include "store/base/json.h"
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
  const Json json = Json::ParseObject(text);
  const Json& objects = json["objects"];
  if (objects.is_array() && objects.size() != 1) {
    return InvalidArgument(url.origin() + ": holds " +
                           (objects.size() == 0 ? std::string("no object")
                                                : std::to_string(objects.size()) +
                                                      " objects; choose one by its name (--name)"));
  }
  const std::string* const name = objects[0]["object"].string();
  if (name == nullptr || Printable(*name) != *name) {
    return BadInput(url.origin() + ": /objects is not a catalog; is this mtdb serve?");
  }
  return std::string(kObjects) + PercentEncode(*name);
}

Status Refused(const std::string& where, unsigned status, const std::string& text) {
  const Json json = Json::ParseObject(text);
  const std::string* const told = json["error"].string();
  const std::string message =
      where + ": " + std::to_string(status) + ": " +
      (told != nullptr ? *told : "not an answer of mtdb serve; does it run there?");
  if (told == nullptr && status < 500) return BadInput(message);
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
