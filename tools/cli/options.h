// SPDX-License-Identifier: Apache-2.0
// How options are added to a verb.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tools/cli/verbs.h"

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
void AddName(CLI::App* verb, std::string* name, const char* description);
void AddJson(CLI::App* verb, bool* json);
void AddVerbose(CLI::App* verb, bool* verbose);
// What an ingest keeps for who draws the object.
void AddUpAndUnits(CLI::App* verb, std::optional<Vec3d>* up, std::string* units);
// What is read of URLs may be kept on disk.
void AddCacheDirectory(CLI::App* verb, OpenOptions* options);
// Which region, how accurate, which camera: what extract, render and fetch share. `draws`: the
// camera alone is of use.
void AddQueryOptions(CLI::App* verb, QueryArguments* arguments, bool draws);
// How render draws. After AddQueryOptions.
void AddPictureOptions(CLI::App* verb, QueryArguments* arguments);

// What the cache keeps.
void AddImplicit(CLI::App* verb, bool* implicit);

// All options of these verbs.
void AddServe(CLI::App* verb, ServerOptions* options);
void AddProbe(CLI::App* verb, ProbeArguments* arguments);
void AddView(CLI::App* verb, ViewArguments* arguments);
void AddProfile(CLI::App* verb, ProfileArguments* arguments);

}  // namespace mtdb
