// SPDX-License-Identifier: Apache-2.0
// VerbOptions: the arguments and options of a verb. Verbs see these classes and not CLI11, whose
// header costs each file that includes it three seconds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "store/base/status.h"

namespace CLI {  // NOLINT(readability-identifier-naming): as CLI11 has it
class App;
class Option;
}  // namespace CLI

namespace mtdb {

// An option that was added, to which more is said. It may be copied, and lives as long as its verb.
class VerbOption {
 public:
  explicit VerbOption(CLI::Option* option) : option_(option) {}

  VerbOption Required() const;
  VerbOption Form(const std::string& form) const;      // of its value, as help shows it: "SIZE"
  VerbOption Default(const std::string& text) const;   // as help tells it
  VerbOption Group(const std::string& heading) const;  // under which help lists it
  VerbOption Values(int least, int most) const;        // how many it takes
  VerbOption Repeatable() const;                       // one value each time
  VerbOption Excludes(VerbOption other) const;
  VerbOption Excludes(const std::string& name) const;
  VerbOption Needs(VerbOption other) const;
  VerbOption Between(int64_t least, int64_t most) const;
  VerbOption OneOf(const std::vector<std::string>& values) const;
  // `check` says what is wrong with a value; nothing: it is right.
  VerbOption Check(std::function<std::string(const std::string&)> check) const;

  bool is_given() const;  // once the command line was read

 private:
  CLI::Option* option_;
};

// What is wrong with a command line is a usage error.
class VerbOptions {
 public:
  explicit VerbOptions(CLI::App* verb) : verb_(verb) {}

  // An option, or an argument where the name has no dashes, that fills `value`, which stays where
  // it is. For texts, lists of them, and the numbers that verbs have.
  template <typename Value>
  VerbOption Add(const std::string& name, Value& value, const std::string& description);
  VerbOption AddFlag(const std::string& name, bool& value, const std::string& description);
  VerbOption AddFlag(const std::string& name, std::function<void()> given,
                     const std::string& description);
  // An option whose text `take` reads; its error begins with the name.
  VerbOption AddText(const std::string& name, std::function<Status(const std::string&)> take,
                     const std::string& description);
  // Likewise one that may be given several times.
  VerbOption AddTexts(const std::string& name, std::function<Status(const std::string&)> take,
                      const std::string& description);
  // Called when all that the command line has was read.
  void CheckAll(std::function<Status()> check);

 private:
  CLI::App* verb_;
};

}  // namespace mtdb
