// SPDX-License-Identifier: Apache-2.0
#include "tools/client/session_message.h"

#include <cmath>

#include "store/base/json.h"
#include "tools/client/printable.h"
#include "tools/client/shortfall_json.h"

namespace mtdb {

namespace {

std::optional<uint64_t> IdOf(const Json& json) {
  const uint64_t* const id = json["id"].whole_number();
  return id != nullptr && *id <= kLargestId ? std::optional(*id) : std::nullopt;
}

// Takes the values of an object's keys, all of which must be there and of the right kind.
class Fields {
 public:
  explicit Fields(const Json& json) : json_(json), ok_(json.is_object()) {}
  bool ok() const { return ok_; }

  void Take(const char* key, uint64_t* value) { Take(json_[key].whole_number(), value); }
  void Take(const char* key, std::string* value) { Take(json_[key].string(), value); }
  void Take(const char* key, bool* value) { Take(json_[key].boolean(), value); }
  void Take(const char* key, double* value) {
    const Json& json = json_[key];
    ok_ = ok_ && json.is_number() && json.number() >= 0;
    if (ok_) *value = json.number();
  }

 private:
  template <typename Value>
  void Take(const Value* found, Value* value) {
    ok_ = ok_ && found != nullptr;
    if (ok_) *value = *found;
  }
  const Json& json_;
  bool ok_;
};

Status NotReply() { return BadInput("the server sent a control message that mtdb does not know"); }

Result<SessionHello> HelloOf(const Json& json) {
  uint64_t protocol = 0;
  Fields head(json);
  head.Take("protocol", &protocol);
  if (!head.ok()) return NotReply();
  if (protocol != kSessionProtocol) {
    return Unsupported("the server speaks version " + std::to_string(protocol) +
                       " of the session protocol, this program version " +
                       std::to_string(kSessionProtocol));
  }
  SessionHello hello;
  Fields fields(json);
  fields.Take("object", &hello.object);
  fields.Take("triangles", &hello.triangles);
  fields.Take("vertices", &hello.vertices);
  fields.Take("diagonal", &hello.diagonal);
  fields.Take("rounding_error", &hello.rounding_error);
  fields.Take("double_positions", &hello.double_positions);
  fields.Take("remember", &hello.remembered_vertices);
  fields.Take("max_triangles", &hello.max_triangles);
  fields.Take("max_message_bytes", &hello.max_message_bytes);
  if (!fields.ok() || Printable(hello.object) != hello.object) return NotReply();
  return hello;
}

Result<SessionDone> DoneOf(const Json& json) {
  SessionDone done;
  Fields fields(json);
  fields.Take("triangles", &done.triangles);
  fields.Take("vertices", &done.vertices);
  fields.Take("active_triangles", &done.active_triangles);
  fields.Take("error_bound", &done.error_bound);
  fields.Take("limit", &done.limit);
  if (!fields.ok() || !IsWord(done.limit) || !json.contains("shortfall") ||
      !ParseShortfall(json["shortfall"], &done.shortfall)) {
    return NotReply();
  }
  fields.Take("insertions", &done.insertions);
  fields.Take("removals", &done.removals);
  fields.Take("messages", &done.messages);
  fields.Take("bytes", &done.bytes);
  fields.Take("milliseconds", &done.milliseconds);
  if (!fields.ok()) return NotReply();
  return done;
}

}  // namespace

Result<SessionRequest> ParseSessionRequest(std::string_view text, std::optional<uint64_t>* id) {
  constexpr const char* kForm = R"({"id": 7, "query": {...}})";
  id->reset();
  const Json json = Json::ParseObject(text);
  if (json.is_null()) {
    return InvalidArgument(std::string("expected a JSON object such as ") + kForm);
  }
  *id = IdOf(json);
  if (!*id) {
    return InvalidArgument("id: expected a whole number from 0 to 9007199254740991, as in " +
                           std::string(kForm));
  }
  const Json& query = json["query"];
  if (!query.is_object()) {
    return InvalidArgument("query: expected an object, as in " + std::string(kForm));
  }
  if (const std::string* const key = json.UnknownKey({"id", "query"})) {
    return InvalidArgument("no key " + Json(*key).Text() + " here; known are id, query");
  }
  return SessionRequest{**id, query.Text()};
}

std::string SessionRequestText(const SessionRequest& request) {
  return R"({"id":)" + std::to_string(request.id) + R"(,"query":)" + request.query + "}";
}

Result<SessionReply> ParseSessionReply(std::string_view text) {
  const Json json = Json::ParseObject(text);
  if (json.is_null()) return NotReply();
  SessionReply reply;
  reply.id = IdOf(json);
  if (json.contains("hello")) {
    reply.kind = SessionReply::Kind::kHello;
    MTDB_ASSIGN_OR_RETURN(reply.hello, HelloOf(json["hello"]));
    return reply;
  }
  Fields fields(json);
  if (json.contains("error")) {
    fields.Take("error", &reply.error);
    fields.Take("code", &reply.code);
    return fields.ok() ? Result<SessionReply>(std::move(reply)) : NotReply();
  }
  if (!reply.id) return NotReply();
  if (json.contains("done")) {
    reply.kind = SessionReply::Kind::kDone;
    MTDB_ASSIGN_OR_RETURN(reply.done, DoneOf(json["done"]));
    return reply;
  }
  bool superseded = false;
  fields.Take("superseded", &superseded);
  if (!fields.ok() || !superseded) return NotReply();
  reply.kind = SessionReply::Kind::kSuperseded;
  return reply;
}

std::string SessionReplyText(const SessionReply& reply) {
  Json json = Json::Object();
  if (reply.id) json["id"] = *reply.id;
  const SessionHello& hello = reply.hello;
  const SessionDone& done = reply.done;
  switch (reply.kind) {
    case SessionReply::Kind::kHello:
      json["hello"] = {{"protocol", kSessionProtocol},
                       {"object", hello.object},
                       {"triangles", hello.triangles},
                       {"vertices", hello.vertices},
                       {"diagonal", hello.diagonal},
                       {"rounding_error", hello.rounding_error},
                       {"double_positions", hello.double_positions},
                       {"remember", hello.remembered_vertices},
                       {"max_triangles", hello.max_triangles},
                       {"max_message_bytes", hello.max_message_bytes}};
      break;
    case SessionReply::Kind::kDone:
      json["done"] = {{"triangles", done.triangles},
                      {"vertices", done.vertices},
                      {"active_triangles", done.active_triangles},
                      {"error_bound", done.error_bound},
                      {"shortfall", ShortfallJson(done.shortfall)},
                      {"limit", done.limit},
                      {"insertions", done.insertions},
                      {"removals", done.removals},
                      {"messages", done.messages},
                      {"bytes", done.bytes},
                      {"milliseconds", done.milliseconds}};
      break;
    case SessionReply::Kind::kSuperseded: json["superseded"] = true; break;
    case SessionReply::Kind::kError: json["error"] = reply.error; json["code"] = reply.code;
  }
  return json.Text();
}

}  // namespace mtdb
