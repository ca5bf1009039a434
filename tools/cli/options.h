// SPDX-License-Identifier: Apache-2.0
// How options are added to a verb: those that several share.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <utility>
#include <vector>

#include "store/open_options.h"
#include "tools/cli/query_report.h"
#include "tools/request/arguments.h"

namespace mtdb {

// An option whose text `parse` turns into a value; a text that it refuses is a usage error.
template <typename Value, typename Parse>
CLI::Option* AddParsed(CLI::App* verb, const std::string& name, const std::string& form,
                       Value* value, Parse parse, const std::string& description) {
  return verb
      ->add_option_function<std::string>(
          name,
          [=](const std::string& text) {
            auto result = parse(text);
            if (!result.ok()) throw CLI::ValidationError(name, result.status().message());
            *value = *std::move(result);
          },
          description)
      ->type_name(form);
}

// An option that may be given several times.
template <typename List, typename Parse>
CLI::Option* AddParsedList(CLI::App* verb, const std::string& name, const std::string& form,
                           List* values, Parse parse, const std::string& description) {
  return verb
      ->add_option_function<std::vector<std::string>>(
          name,
          [=](const std::vector<std::string>& texts) {
            for (const std::string& text : texts) {
              auto result = parse(text);
              if (!result.ok()) throw CLI::ValidationError(name, result.status().message());
              values->push_back(*std::move(result));
            }
          },
          description)
      ->type_name(form)
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

// The option names what is written, which no URL is.
CLI::Option* IsWritten(CLI::Option* option);
// A store that is read, which may be a packed file, and one that is changed.
void AddStore(CLI::App* verb, std::string* store);
void AddWrittenStore(CLI::App* verb, std::string* store);
// A server, and how long it may be silent.
void AddUrl(CLI::App* verb, std::string* url);
void AddTimeout(CLI::App* verb, double* seconds);
// The format of a mesh on standard input.
void AddInputFormat(CLI::App* verb, std::string* format);
// The mesh file that is written; `may_be_raster`: a terrain's.
void AddOutput(CLI::App* verb, std::string* output, bool may_be_standard = false,
               bool may_be_raster = false);
// --name: the object that is asked, or the only one that the verb is about.
void AddName(CLI::App* verb, std::string* name);
void AddOnly(CLI::App* verb, std::string* name);
void AddJson(CLI::App* verb, bool* json);
void AddVerbose(CLI::App* verb, bool* verbose);

// --cache; `standard` says what it is without the option.
template <typename Bytes>
void AddCache(CLI::App* verb, Bytes* bytes, const std::string& standard) {
  AddParsed(verb, "--cache", "SIZE", bytes, ParseSize,
            "let decoded clusters of an open object take at most so much memory, e.g. 1.5G")
      ->default_str(standard);
}
constexpr const char* kQuarterOfMemory = "a quarter of the machine's";
// What the cache keeps.
void AddImplicit(CLI::App* verb, bool* implicit);
// What is read of URLs may be kept on disk.
void AddCacheDirectory(CLI::App* verb, OpenOptions* options);

// Which region, how accurate, which camera: what extract, render and fetch share. `draws`: the
// camera alone is of use.
void AddQueryOptions(CLI::App* verb, QueryArguments* arguments, bool draws);
// What a mesh file has of the vertices: of extract and fetch.
void AddMeshOptions(CLI::App* verb, QueryArguments* arguments);

}  // namespace mtdb
