// SPDX-License-Identifier: Apache-2.0
// What is said of a mesh's survey: the accuracy that an ingest takes, what it costs, and what it
// loses; and of an object that is stored.
#pragma once

#include <string>
#include <vector>

#include "builder/build.h"
#include "store/base/json.h"
#include "store/object_record.h"

namespace mtdb {

// "positions: 18 bits, steps of 1e-06; as the coordinates are written".
std::string AccuracyLine(const MeshSurvey& survey);
// What a person should know before the mesh's file is put away; mostly nothing.
std::vector<std::string> AccuracyWarnings(const MeshSurvey& survey);
// Prints a survey: of a mesh file before it is ingested.
void PrintSurvey(const std::string& name, const MeshSurvey& survey);
Json SurveyJson(const MeshSurvey& survey);
// Prints what each round and each stage of an ingest did, and took.
void PrintStages(const BuildReport& report, const ObjectRecord& r);
// Prints what a record says of an object.
void PrintInfo(const ObjectRecord& r);
// The part of SurveyJson that an ingest reports.
Json AccuracyJson(const MeshSurvey& survey);

}  // namespace mtdb
