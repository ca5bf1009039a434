// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/verbs/follow_path.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>
#include <sstream>
#include <string_view>

#include "codecs/mesh_file/mesh_file.h"

namespace mtdb {

namespace {

constexpr double kMostPixels = 1e6;
// Numbers that must stay whole between two keyframes.
const std::set<std::string> kWhole{"max_triangles", "max_bytes", "viewport"};

Status Wrong(size_t line, const std::string& what) {
  return InvalidArgument("line " + std::to_string(line) + ": " + what);
}

struct Keyframe {
  QueryJson query;
  size_t steps = 1;  // that lead to it
};

// Takes `key` away from `json`; null when it is not there.
QueryJson Taken(QueryJson& json, const char* key) {
  const auto at = json.find(key);
  if (at == json.end()) return nullptr;
  QueryJson value = std::move(*at);
  json.erase(at);
  return value;
}

Result<Keyframe> ParseKeyframe(const std::string& text) {
  Keyframe frame;
  QueryJson& json = frame.query;
  json = QueryJson::parse(text, nullptr, false);
  if (!json.is_object()) return InvalidArgument("expected a JSON object");
  if (const QueryJson steps = Taken(json, "steps"); !steps.is_null()) {
    if (!steps.is_number_unsigned() || steps == 0 || steps > kMostSteps) {
      return InvalidArgument("steps: expected a whole number from 1 to 1000000");
    }
    frame.steps = steps.get<size_t>();
  }
  const QueryJson camera = Taken(json, "camera");
  const QueryJson box = Taken(json, "box");
  const QueryJson error = Taken(json, "error");
  const QueryJson pixels = Taken(json, "pixels");
  const auto set = [&](const char* key, QueryJson value) -> Status {
    if (json.contains(key)) {
      return InvalidArgument(std::string(key) +
                             ": is given twice, by its own name and by camera, "
                             "box, error or pixels");
    }
    json[key] = std::move(value);
    return Status::Ok();
  };
  if (!box.is_null()) MTDB_RETURN_IF_ERROR(set("region", {{"box", box}}));
  if (!error.is_null()) MTDB_RETURN_IF_ERROR(set("threshold", error));
  if (!camera.is_null()) {
    if (!json.contains("region")) json["region"] = {{"frustum", camera}};
    if (!json.contains("threshold") || !pixels.is_null()) {
      if (!pixels.is_null() &&
          !(pixels.is_number() && pixels.get<double>() > 0 && pixels.get<double>() < kMostPixels)) {
        return InvalidArgument("pixels: expected a number above 0");
      }
      MTDB_RETURN_IF_ERROR(
          set("threshold",
              {{"screen",
                {{"camera", camera}, {"pixels", pixels.is_null() ? QueryJson(1) : pixels}}}}));
    }
  } else if (!pixels.is_null()) {
    return InvalidArgument("pixels: needs a camera");
  }
  MTDB_RETURN_IF_ERROR(ParseQueryText(json.dump()).status());
  return frame;
}

// What lies between two values of the same build; `key` is the nearest one above it.
Result<QueryJson> Between(const QueryJson& from, const QueryJson& to, double t,
                          const std::string& key) {
  if (from == to) return to;
  if (from.is_number() && to.is_number()) {
    const double value = from.get<double>() + t * (to.get<double>() - from.get<double>());
    if (kWhole.contains(key)) return QueryJson(static_cast<uint64_t>(std::llround(value)));
    return QueryJson(value);
  }
  if (from.type() != to.type() || from.size() != to.size() || !from.is_structured()) {
    return InvalidArgument(key +
                           ": steps lead from one line to the next only where both differ "
                           "in nothing but numbers");
  }
  QueryJson between = to;
  if (to.is_array()) {
    for (size_t i = 0; i < to.size(); ++i) {
      MTDB_ASSIGN_OR_RETURN(between[i], Between(from[i], to[i], t, key));
    }
    return between;
  }
  for (auto& [name, value] : between.items()) {
    const auto at = from.find(name);
    if (at == from.end()) return Between(QueryJson(), QueryJson(0), t, name);
    MTDB_ASSIGN_OR_RETURN(value, Between(*at, to[name], t, name));
  }
  return between;
}

}  // namespace

Result<QueryJson::array_t> ParseFollowPath(const std::string& text) {
  QueryJson::array_t queries;
  std::istringstream lines(text);
  std::string line;
  for (size_t number = 1; std::getline(lines, line); ++number) {
    const size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    const Result<Keyframe> frame = ParseKeyframe(line);
    if (!frame.ok()) return Wrong(number, frame.status().message());
    const QueryJson from = queries.empty() ? frame->query : queries.back();
    const size_t steps = queries.empty() ? 1 : frame->steps;
    if (queries.size() + steps > kMostSteps) {
      return Wrong(number, "more than 1000000 steps");
    }
    for (size_t i = 1; i < steps; ++i) {
      Result<QueryJson> query =
          Between(from, frame->query, static_cast<double>(i) / static_cast<double>(steps), "query");
      if (!query.ok()) return Wrong(number, query.status().message());
      const Status status = ParseQueryText(query->dump()).status();
      if (!status.ok()) return Wrong(number, "on the way to it: " + status.message());
      queries.push_back(*std::move(query));
    }
    queries.push_back(frame->query);
  }
  if (queries.empty()) return InvalidArgument("expected a JSON object a line, found none");
  return queries;
}

Result<std::string> StepFile(const std::string& pattern, size_t step) {
  const Status wrong = InvalidArgument(
      "expected a mesh file's name with one %d or %03d in it, such "
      "as step-%03d.ply, found '" +
      pattern + "'");
  if (!WrittenMeshFormatOf(pattern).ok()) return wrong;
  const size_t percent = pattern.find('%');
  if (percent == std::string::npos || pattern.find('%', percent + 1) != std::string::npos) {
    return wrong;
  }
  size_t end = percent + 1;
  while (end < pattern.size() && std::isdigit(static_cast<unsigned char>(pattern[end])) != 0) ++end;
  const std::string width = pattern.substr(percent + 1, end - percent - 1);
  const bool zeros = width.empty() || (width.size() == 2 && width[0] == '0');
  if (end == pattern.size() || pattern[end] != 'd' || !zeros) return wrong;
  std::string digits = std::to_string(step);
  const size_t least = width.empty() ? 0 : static_cast<size_t>(width[1] - '0');
  if (digits.size() < least) digits.insert(0, least - digits.size(), '0');
  return pattern.substr(0, percent) + digits + pattern.substr(end + 1);
}

}  // namespace mtdb
