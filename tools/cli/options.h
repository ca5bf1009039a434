// SPDX-License-Identifier: Apache-2.0
// How options are added to a verb: those that several share.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "store/open_options.h"
#include "tools/cli/query_report.h"
#include "tools/cli/verb_options.h"
#include "tools/request/arguments.h"

namespace mtdb {

// An option whose text `parse` turns into a value; a text that it refuses is a usage error.
template <typename Value, typename Parse>
VerbOption AddParsed(VerbOptions* verb, const std::string& name, const std::string& form,
                     Value* value, Parse parse, const std::string& description) {
  const auto take = [=](const std::string& text) -> Status {
    auto result = parse(text);
    if (!result.ok()) return result.status();
    *value = *std::move(result);
    return Status::Ok();
  };
  return verb->AddText(name, take, description).Form(form);
}

// An option that may be given several times.
template <typename List, typename Parse>
VerbOption AddParsedList(VerbOptions* verb, const std::string& name, const std::string& form,
                         List* values, Parse parse, const std::string& description) {
  const auto take = [=](const std::string& text) -> Status {
    auto result = parse(text);
    if (!result.ok()) return result.status();
    values->push_back(*std::move(result));
    return Status::Ok();
  };
  return verb->AddTexts(name, take, description).Form(form);
}

// The option names what is written, which no URL is.
VerbOption IsWritten(VerbOption option);
// A store that is read, which may be a packed file, and one that is changed.
void AddStore(VerbOptions* verb, std::string* store);
void AddWrittenStore(VerbOptions* verb, std::string* store);
// A server, and how long it may be silent.
void AddUrl(VerbOptions* verb, std::string* url);
void AddTimeout(VerbOptions* verb, double* seconds);
// The format of a mesh on standard input.
void AddInputFormat(VerbOptions* verb, std::string* format);
// The mesh file that is written; `may_be_raster`: a terrain's.
void AddOutput(VerbOptions* verb, std::string* output, bool may_be_standard = false,
               bool may_be_raster = false);
// --name: the object that is asked, or the only one that the verb is about.
void AddName(VerbOptions* verb, std::string* name);
void AddOnly(VerbOptions* verb, std::string* name);
void AddJson(VerbOptions* verb, bool* json);
void AddVerbose(VerbOptions* verb, bool* verbose);

// --cache; `standard` says what it is without the option.
template <typename Bytes>
void AddCache(VerbOptions* verb, Bytes* bytes, const std::string& standard) {
  AddParsed(verb, "--cache", "SIZE", bytes, ParseSize,
            "let decoded clusters of an open object take at most so much memory, e.g. 1.5G")
      .Default(standard);
}
constexpr const char* kQuarterOfMemory = "a quarter of the machine's";
// What the cache keeps.
void AddImplicit(VerbOptions* verb, bool* implicit);
// What is read of URLs may be kept on disk.
void AddCacheDirectory(VerbOptions* verb, OpenOptions* options);

// Regions alone: which points are asked about; several: any of them, or all with --intersect.
void AddRegionsAlone(VerbOptions* verb, QueryOptions* options, const char* heading);

// Which region, how accurate, which camera: what extract, render and fetch share. `draws`: the
// camera alone is of use.
void AddQueryOptions(VerbOptions* verb, QueryArguments* arguments, bool draws);
// What a mesh file has of the vertices: of extract and fetch.
void AddMeshOptions(VerbOptions* verb, QueryArguments* arguments);

}  // namespace mtdb
