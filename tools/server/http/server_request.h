// SPDX-License-Identifier: Apache-2.0
// What a request to `mtdb serve` asks for (docs/protocol.md): its target, and its parameters or
// body as a query. Safe on any input.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "query/probe.h"
#include "store/base/status.h"
#include "tools/request/arguments.h"
#include "tools/request/query_options.h"

namespace mtdb::internal {

// A request's target, percent escapes decoded. "/objects/a%2Fb/mesh?clip" has the path
// {"objects", "a/b", "mesh"} and the parameters {{"clip", ""}}. A plus sign stands for itself.
struct RequestTarget {
  std::vector<std::string> path;
  std::vector<std::pair<std::string, std::string>> parameters;
};
// kInvalidArgument for what is no target.
Result<RequestTarget> ParseTarget(const std::string& text);

struct MeshRequest {
  bool double_positions = false;  // of ply
  std::string format = "ply";     // see FindWrittenMeshFormat
  Json query;                     // as docs/query.md has it; its values are not yet checked
};
// The query is the body when there is one, else the parameters, which are the options of `mtdb
// extract` without dashes. kInvalidArgument with a message that begins with the parameter.
Result<MeshRequest> ParseMeshRequest(const RequestTarget& target, const std::string& body);

struct ProbeRequest {
  std::optional<Vec3d> point;  // either this
  std::optional<Ray> ray;      // or this
  std::optional<AskedError> error;
  ProbeOptions options;  // but for the error
};
// The parameters are the options of `mtdb probe` without dashes; errors as above.
Result<ProbeRequest> ParseProbeRequest(const RequestTarget& target);

}  // namespace mtdb::internal
