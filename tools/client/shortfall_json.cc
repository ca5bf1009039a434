// SPDX-License-Identifier: Apache-2.0
#include "tools/client/shortfall_json.h"

#include <cstdio>

namespace mtdb {
namespace {

Json Point(Vec3d p) { return Json::array({p.x, p.y, p.z}); }

}  // namespace

Json ShortfallJson(const Shortfall& s) {
  if (!s.any()) return nullptr;
  return {{"triangles", s.triangles},
          {"excess", s.excess},
          {"bounds", {{"min", Point(s.bounds.min)}, {"max", Point(s.bounds.max)}}}};
}

bool ParseShortfall(const JsonTree& json, Shortfall* shortfall) {
  *shortfall = {};
  if (json.is_null()) return true;
  Shortfall s;
  const auto number = [](const JsonTree& object, const auto& key) {
    return object.at(key).template get<double>();
  };
  try {
    s.triangles = json.at("triangles").get<uint64_t>();
    s.excess = number(json, "excess");
    for (int i = 0; i < 3; ++i) {
      s.bounds.min[i] = number(json.at("bounds").at("min"), static_cast<size_t>(i));
      s.bounds.max[i] = number(json.at("bounds").at("max"), static_cast<size_t>(i));
    }
  } catch (const JsonTree::exception&) {
    return false;
  }
  *shortfall = s;
  return true;
}

std::string ShortfallText(const Shortfall& s, const std::string& limit) {
  if (!s.any()) return "";
  char text[512];
  std::snprintf(
      text, sizeof(text),
      "  NOT MET: %llu triangles are up to %.6g above the error that was asked for, within "
      "%.9g %.9g %.9g to %.9g %.9g %.9g; %s\n",
      static_cast<unsigned long long>(s.triangles), s.excess, s.bounds.min.x, s.bounds.min.y,
      s.bounds.min.z, s.bounds.max.x, s.bounds.max.y, s.bounds.max.z,
      limit == "accuracy"
          ? "positions were rounded by more when the object was ingested, or are in the "
            "output; ingest it with more --bits, or --lossless"
          : "a budget ended the refinement");
  return text;
}

}  // namespace mtdb
