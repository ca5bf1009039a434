// SPDX-License-Identifier: Apache-2.0
// A verb that mtdb does not have: what docs/design.md, section 10, says of verbs is enough. Its
// help, the manual, the completion, and what it answers to mistakes follow.
#include <cstdio>
#include <unistd.h>

#include "store/database.h"
#include "tests/tools/cli_testing.h"
#include "tools/cli/command_line.h"
#include "tools/cli/options.h"
#include "tools/request/report_json.h"

namespace mtdb::test {
namespace {

struct CountArguments {
  std::string store;
  OpenOptions open;
  uint64_t least = 0;
  bool json = false;
};

Status CountObjects(const CountArguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(arguments.store, arguments.open));
  MTDB_ASSIGN_OR_RETURN(const std::vector<ObjectRecord> records, database->List());
  const auto count = std::ranges::count_if(
      records, [&](const ObjectRecord& r) { return r.triangles >= arguments.least; });
  if (arguments.json) {
    PrintAnswer("count", {{"objects", static_cast<uint64_t>(count)}});
  } else {
    std::printf("%td objects\n", count);
  }
  return Status::Ok();
}

RunVerb AddCount(VerbOptions* verb) {
  const auto a = std::make_shared<CountArguments>();
  AddStore(verb, &a->store);
  AddParsed(verb, "--least", "N", &a->least, ParseCount, "those of at least N triangles");
  AddJson(verb, &a->json);
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation&) { return CountObjects(*a); };
}

const Verb kCountVerb{"count", "count the objects of a store", "Example: mtdb count scans.mtdb",
                      AddCount};
constexpr const Verb* kVerbs[] = {&kCountVerb, &kListVerb};

// The row of the table runs in this process; what it prints goes to files meanwhile.
Outcome RunToy(const Arguments& arguments) {
  const Folder folder;
  Outcome outcome;
  std::fflush(stdout);
  std::fflush(stderr);
  const std::string files[] = {folder.File("out"), folder.File("err")};
  std::FILE* const streams[] = {stdout, stderr};
  int kept[2];
  for (int i = 0; i < 2; ++i) {
    kept[i] = ::dup(i + 1);
    std::FILE* const file = std::fopen(files[i].c_str(), "w");
    ::dup2(::fileno(file), i + 1);
    std::fclose(file);
  }
  outcome.exit_code = CommandLine(kVerbs, "1").Run(arguments);
  for (int i = 0; i < 2; ++i) {
    std::fflush(streams[i]);
    ::dup2(kept[i], i + 1);
    ::close(kept[i]);
  }
  outcome.out = ReadText(files[0]);
  outcome.err = ReadText(files[1]);
  return outcome;
}

TEST_CASE("a verb of one row does its work", "[cli]") {
  const Example& example = SmallExample();
  CHECK(RunToy({"count", example.store}).out == "1 objects\n");
  CHECK(RunToy({"count", example.store, "--least", "100M"}).out == "0 objects\n");
  const Outcome json = RunToy({"count", example.store, "--json"});
  CHECK(ParseJson(json.out).at("schema") == "mtdb/count/1");
  CHECK(ParseJson(json.out).at("objects") == 1);
}

TEST_CASE("a verb of one row is explained, and refuses what is wrong", "[cli]") {
  const Outcome all = RunToy({"help"});
  CHECK(all.exit_code == 0);
  CHECK_THAT(all.out, Catch::Contains("count the objects of a store"));
  const Outcome help = RunToy({"help", "count"});
  CHECK_THAT(help.out, Catch::Contains("--least N") && Catch::Contains("--quiet") &&
                           Catch::Contains("Example: mtdb count"));
  const auto refused = [](const Arguments& arguments, int exit_code, const char* words) {
    const Outcome outcome = RunToy(arguments);
    CHECK(outcome.exit_code == exit_code);
    CHECK_THAT(outcome.err, Catch::Contains(words));
    CHECK(IsOneLine(outcome.err));
  };
  refused({"count"}, 2, "STORE");
  refused({"cuont", "a"}, 2, "count");
  refused({"count", "a", "--lest", "3"}, 2, "--least");
  refused({"count", "a", "--least", "x"}, 2, "--least");
  refused({"count", "none.mtdb"}, 1, "none.mtdb");
  const Folder folder;
  CHECK(RunToy({"--write-manual", folder.File("")}).exit_code == 0);
  CHECK_THAT(ReadText(folder.File("mtdb-count.1")), Catch::Contains("least"));
}

}  // namespace
}  // namespace mtdb::test
