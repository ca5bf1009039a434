// SPDX-License-Identifier: Apache-2.0
#include "tools/server/http/server_request.h"

#include <algorithm>
#include <set>
#include <string_view>

#include "codecs/mesh_file/mesh_file.h"
#include "tools/request/arguments.h"
#include "tools/request/query_options.h"

namespace mtdb::internal {

namespace {

int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

Result<std::string> PercentDecode(std::string_view text) {
  std::string decoded;
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      decoded += text[i];
      continue;
    }
    const int high = i + 2 < text.size() ? HexDigit(text[i + 1]) : -1;
    const int low = i + 2 < text.size() ? HexDigit(text[i + 2]) : -1;
    if (high < 0 || low < 0) {
      return InvalidArgument("the target's % is not followed by two hexadecimal digits");
    }
    decoded += static_cast<char>(16 * high + low);
    i += 2;
  }
  return decoded;
}

// Calls `take` with each part between separators; stops at its first error.
template <typename Take>
Status ForEachPart(std::string_view text, char separator, Take&& take) {
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find(separator, begin), text.size());
    MTDB_RETURN_IF_ERROR(take(text.substr(begin, end - begin)));
    begin = end + 1;
  }
  return Status::Ok();
}

Result<bool> ParseFlag(const std::string& text) {
  if (text.empty() || text == "1" || text == "true") return true;
  if (text == "0" || text == "false") return false;
  return Unexpected(text, "true, false or nothing");
}

// `*value` = what `parse` makes of `text`.
template <typename Value, typename Parse>
Status Set(Value* value, Parse parse, const std::string& text) {
  auto result = parse(text);
  if (!result.ok()) return result.status();
  *value = *std::move(result);
  return Status::Ok();
}

template <typename Parse>
Status Append(Json::Array* values, Parse parse, const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(Json value, parse(text));
  values->push_back(std::move(value));
  return Status::Ok();
}

// Null: the parameter is no region.
const RegionOption* FindRegion(const std::string& name) {
  const auto regions = RegionOptions();
  const auto found =
      std::ranges::find_if(regions, [&](const RegionOption& o) { return o.name == "--" + name; });
  return found == regions.end() ? nullptr : &*found;
}

// Whether it may be given several times.
bool IsList(const std::string& name) { return name == "error-at" || FindRegion(name) != nullptr; }

Status SetParameter(const std::string& name, const std::string& text, QueryOptions* q) {
  if (name == "full") return Set(&q->full, ParseFlag, text);
  if (name == "error") return Set(&q->error, ParseError, text);
  if (name == "pixels") return Set(&q->pixels, ParsePositive, text);
  if (name == "error-at") return Append(&q->errors_at, ErrorAtOption, text);
  if (name == "error-outside") return Set(&q->error_outside, ParseError, text);
  if (name == "triangles") return Set(&q->triangles, ParseCount, text);
  if (name == "max-bytes") return Set(&q->max_bytes, ParseSize, text);
  if (name == "max-milliseconds") return Set(&q->max_milliseconds, ParseNonNegative, text);
  if (name == "normals") return Set(&q->normals, ParseFlag, text);
  if (const RegionOption* const region = FindRegion(name)) {
    return Append(&q->regions, region->parse, text);
  }
  if (name == "frustum") return Set(&q->frustum, ParseFlag, text);
  if (name == "intersect") return Set(&q->intersect, ParseFlag, text);
  if (name == "outside") return Set(&q->outside, ParseFlag, text);
  if (name == "clip") return Set(&q->clip, ParseFlag, text);
  if (name == "eye") return Set(&q->eye, ParsePoint, text);
  if (name == "target") return Set(&q->target, ParsePoint, text);
  if (name == "up") return Set(&q->up, ParsePoint, text);
  if (name == "fov") return Set(&q->fov, ParsePositive, text);
  if (name == "viewport") return Set(&q->viewport, ParseExtent, text);
  return InvalidArgument("no such parameter; known are format and the options of 'mtdb extract'");
}

Status CheckExclusions(const QueryOptions& q) {
  if (q.full && (q.error || q.pixels || !q.errors_at.empty() || q.triangles)) {
    return InvalidArgument("full: does not go with error, pixels, error-at or triangles");
  }
  return CheckOptions(q, false);
}

// "--box: needs --eye" as a message about parameters.
std::string WithoutDashes(std::string text) {
  for (size_t at = 0; (at = text.find("--", at)) != std::string::npos;) text.erase(at, 2);
  return text;
}

}  // namespace

Result<RequestTarget> ParseTarget(const std::string& text) {
  std::string_view rest = text;
  if (rest.starts_with("http://")) {  // the form that proxies are sent
    rest.remove_prefix(std::min(rest.find('/', 7), rest.size()));
  }
  if (!rest.starts_with('/')) return InvalidArgument("the target does not begin with /");
  rest = rest.substr(0, rest.find('#'));
  const size_t question = rest.find('?');
  RequestTarget target;
  MTDB_RETURN_IF_ERROR(ForEachPart(rest.substr(1, std::min(question, rest.size()) - 1), '/',
                                   [&](std::string_view part) -> Status {
                                     MTDB_ASSIGN_OR_RETURN(std::string segment,
                                                           PercentDecode(part));
                                     target.path.push_back(std::move(segment));
                                     return Status::Ok();
                                   }));
  if (question == std::string_view::npos) return target;
  MTDB_RETURN_IF_ERROR(
      ForEachPart(rest.substr(question + 1), '&', [&](std::string_view part) -> Status {
        if (part.empty()) return Status::Ok();
        const size_t equals = std::min(part.find('='), part.size());
        MTDB_ASSIGN_OR_RETURN(std::string name, PercentDecode(part.substr(0, equals)));
        MTDB_ASSIGN_OR_RETURN(
            std::string value,
            PercentDecode(equals < part.size() ? part.substr(equals + 1) : std::string_view()));
        target.parameters.emplace_back(std::move(name), std::move(value));
        return Status::Ok();
      }));
  return target;
}

Result<MeshRequest> ParseMeshRequest(const RequestTarget& target, const std::string& body) {
  MeshRequest request;
  QueryOptions options;
  std::set<std::string> seen;
  for (const auto& [name, value] : target.parameters) {
    if (!seen.insert(name).second && !IsList(name)) {
      return InvalidArgument(name + ": is given twice");
    }
    if (name == "format") {
      const Status known = FindWrittenMeshFormat(value).status();
      if (!known.ok()) return InvalidArgument("format: " + known.message());
      request.format = value;
      continue;
    }
    if (name == "double-positions") {
      request.double_positions = value.empty() || value == "true";
      if (!request.double_positions && value != "false") {
        return InvalidArgument("double-positions: expected true, false or nothing, found '" +
                               value + "'");
      }
      continue;
    }
    const Status status = SetParameter(name, value, &options);
    if (!status.ok()) return InvalidArgument(name + ": " + status.message());
  }
  if (!body.empty()) {
    if (seen.size() > seen.count("format") + seen.count("double-positions")) {
      return InvalidArgument(
          "the body holds the query: give no other parameters than format and double-positions "
          "beside it");
    }
    Result<Json> json = ParseQueryText(body);
    if (!json.ok()) return InvalidArgument("body: " + json.status().message());
    request.query = *std::move(json);
    return request;
  }
  const Status status = CheckExclusions(options);
  if (!status.ok()) return InvalidArgument(WithoutDashes(status.message()));
  MTDB_ASSIGN_OR_RETURN(request.query, QueryOf(options, {1200, 900}));
  return request;
}

Result<ProbeRequest> ParseProbeRequest(const RequestTarget& target) {
  ProbeRequest request;
  std::set<std::string> seen;
  for (const auto& [name, text] : target.parameters) {
    if (!seen.insert(name).second) return InvalidArgument(name + ": given twice");
    Status status;
    if (name == "point") {
      status = Set(&request.point, ParsePoint, text);
    } else if (name == "ray") {
      status = Set(&request.ray, ParseRay, text);
    } else if (name == "error") {
      status = Set(&request.error, ParseError, text);
    } else if (name == "limit") {
      status = Set(&request.options.limit, ParseNonNegative, text);
    } else {
      status = InvalidArgument("no such parameter; known are point, ray, error and limit");
    }
    if (!status.ok()) return InvalidArgument(name + ": " + status.message());
  }
  if (request.point.has_value() == request.ray.has_value()) {
    return InvalidArgument("expected a point or a ray: point=X,Y,Z or ray=X,Y,Z,DX,DY,DZ");
  }
  return request;
}

}  // namespace mtdb::internal
