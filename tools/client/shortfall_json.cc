// SPDX-License-Identifier: Apache-2.0
#include "tools/client/shortfall_json.h"

#include <algorithm>
#include <cstdio>

namespace mtdb {

Json ShortfallJson(const Shortfall& s) {
  if (!s.any()) return nullptr;
  return {{"triangles", s.triangles},
          {"excess", s.excess},
          {"bounds", {{"min", Json(s.bounds.min)}, {"max", Json(s.bounds.max)}}}};
}

bool ParseShortfall(const Json& json, Shortfall* shortfall) {
  *shortfall = {};
  if (json.is_null()) return true;
  Shortfall s;
  bool ok = json["triangles"].whole_number() != nullptr;
  const auto take = [&](const Json& number, double* value) {
    ok = ok && number.is_number();
    if (ok) *value = number.number();
  };
  if (ok) s.triangles = *json["triangles"].whole_number();
  take(json["excess"], &s.excess);
  for (int i = 0; i < 3; ++i) {
    take(json["bounds"]["min"][static_cast<size_t>(i)], &s.bounds.min[i]);
    take(json["bounds"]["max"][static_cast<size_t>(i)], &s.bounds.max[i]);
  }
  if (ok) *shortfall = s;
  return ok;
}

bool IsWord(std::string_view text) {
  return !text.empty() && text.size() <= 32 &&
         std::ranges::all_of(text, [](char c) { return c >= 'a' && c <= 'z'; });
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
