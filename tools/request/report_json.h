// SPDX-License-Identifier: Apache-2.0
// What the verbs print with --json.
#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "query/compare.h"
#include "query/cut.h"
#include "query/height_change.h"
#include "query/probe.h"
#include "store/base/json.h"
#include "store/object_record.h"
#include "store/verify_store.h"

namespace mtdb {

// One object of `info`. `file_bytes` is the whole store's.
Json RecordJson(const ObjectRecord& record, uint64_t file_bytes);
// Of what is stored, without the images of a texture. 0 without vertices.
double BitsPerVertex(const ObjectRecord& record);
// Where a raster's samples lie.
Json RasterJson(const RasterFrame& frame, const std::string& crs);
// All objects, as `list` has them.
Json CatalogJson(const std::vector<ObjectRecord>& records);
Json ChecksJson(const CheckReport& report);
// What a probe of an object found. A ray's hit has a "parameter", too.
Json ProbeJson(const ObjectRecord& record, const ProbeAnswer& answer, bool ray);
// What a comparison of two objects found. Infinite distances are null.
Json ComparisonJson(const ObjectRecord& a, const ObjectRecord& b, const Comparison& comparison);
Json HeightChangeJson(const ObjectRecord& a, const ObjectRecord& b, const HeightChange& change);
// "within", "exceeds", "undecided".
const char* VerdictName(CompareVerdict verdict);
// "accuracy", "triangles", ...
const char* LimitName(QueryLimit limit);
// What it means, for people: "the accuracy that was asked for was reached".
const char* LimitText(QueryLimit limit);
// To standard output. Bytes that are not UTF-8, which names of files may have, become U+FFFD.
void PrintJson(const Json& json, std::FILE* to = stdout);
// Likewise, what a verb answers, as docs/json.md has it: after "schema", "mtdb/<answer>/1". Names
// of files and URLs, and messages, are printed without passwords and signatures.
void PrintAnswer(const char* answer, const Json& json, std::FILE* to = stdout);

}  // namespace mtdb
