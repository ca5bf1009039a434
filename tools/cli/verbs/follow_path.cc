// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/verbs/follow_path.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>
#include <sstream>
#include <string_view>

#include "codecs/mesh_file/mesh_file.h"
#include "query/query_from_json.h"

namespace mtdb {

namespace {

constexpr double kMostPixels = 1e6;
// Numbers that must stay whole between two keyframes.
const std::set<std::string> kWhole{"max_triangles", "max_bytes", "viewport"};

Status Wrong(size_t line, const std::string& what) {
  return InvalidArgument("line " + std::to_string(line) + ": " + what);
}

struct Keyframe {
  Json query;
  size_t steps = 1;  // that lead to it
};

Result<Keyframe> ParseKeyframe(const std::string& text) {
  Keyframe frame;
  Json& json = frame.query;
  json = Json::ParseObject(text);
  if (!json.is_object()) return InvalidArgument("expected a JSON object");
  if (const Json steps = json.Take("steps"); !steps.is_null()) {
    const uint64_t* const number = steps.whole_number();
    if (number == nullptr || *number == 0 || *number > kMostSteps) {
      return InvalidArgument("steps: expected a whole number from 1 to 1000000");
    }
    frame.steps = *number;
  }
  const Json camera = json.Take("camera");
  const Json box = json.Take("box");
  const Json error = json.Take("error");
  const Json pixels = json.Take("pixels");
  const auto set = [&](const char* key, Json value) -> Status {
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
          !(pixels.is_number() && pixels.number() > 0 && pixels.number() < kMostPixels)) {
        return InvalidArgument("pixels: expected a number above 0");
      }
      MTDB_RETURN_IF_ERROR(
          set("threshold",
              {{"screen", {{"camera", camera}, {"pixels", pixels.is_null() ? Json(1) : pixels}}}}));
    }
  } else if (!pixels.is_null()) {
    return InvalidArgument("pixels: needs a camera");
  }
  MTDB_RETURN_IF_ERROR(QueryFromJson(json, 0).status());
  return frame;
}

// What lies between two values of the same build; `key` is the nearest one above it.
Result<Json> Between(const Json& from, const Json& to, double t, const std::string& key) {
  if (from == to) return to;
  if (from.is_number() && to.is_number()) {
    const double value = from.number() + t * (to.number() - from.number());
    if (kWhole.contains(key)) return Json(static_cast<uint64_t>(std::llround(value)));
    return Json(value);
  }
  const bool alike = (from.is_array() && to.is_array()) || (from.is_object() && to.is_object());
  if (!alike || from.size() != to.size()) {
    return InvalidArgument(key +
                           ": steps lead from one line to the next only where both differ "
                           "in nothing but numbers");
  }
  Json between = to;
  if (to.is_array()) {
    for (size_t i = 0; i < to.size(); ++i) {
      MTDB_ASSIGN_OR_RETURN(between.elements()[i], Between(from[i], to[i], t, key));
    }
    return between;
  }
  for (auto& [name, value] : between.members()) {
    if (!from.contains(name)) return Between(Json(), 0, t, name);
    MTDB_ASSIGN_OR_RETURN(value, Between(from[name], to[name], t, name));
  }
  return between;
}

}  // namespace

Result<Json::Array> ParseFollowPath(const std::string& text) {
  Json::Array queries;
  std::istringstream lines(text);
  std::string line;
  for (size_t number = 1; std::getline(lines, line); ++number) {
    const size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    const Result<Keyframe> frame = ParseKeyframe(line);
    if (!frame.ok()) return Wrong(number, frame.status().message());
    const Json from = queries.empty() ? frame->query : queries.back();
    const size_t steps = queries.empty() ? 1 : frame->steps;
    if (queries.size() + steps > kMostSteps) {
      return Wrong(number, "more than 1000000 steps");
    }
    for (size_t i = 1; i < steps; ++i) {
      Result<Json> query =
          Between(from, frame->query, static_cast<double>(i) / static_cast<double>(steps), "query");
      if (!query.ok()) return Wrong(number, query.status().message());
      const Status status = QueryFromJson(*query, 0).status();
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
