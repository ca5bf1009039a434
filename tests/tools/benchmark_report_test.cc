// SPDX-License-Identifier: Apache-2.0
// tools/benchmark --report: from raw figures to the page, and nothing by hand.
#include <regex>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

using OrderedJson = nlohmann::ordered_json;  // tables have the order of the raw file

const std::string kSource = MTDB_SOURCE_DIR;

OrderedJson RawFigures() {
  return OrderedJson::parse(ReadText(kSource + "/docs/benchmarks/results.json"));
}

OrderedJson& Step(OrderedJson& raw, const std::string& name) {
  for (OrderedJson& step : raw.at("steps")) {
    if (step.at("step") == name) return step;
  }
  FAIL("the raw file has no step " << name);
  return raw;
}

// The page and the README that come of raw figures; what is printed; the exit status.
struct Report {
  int exit_code = -1;
  std::string printed, page, readme;

  explicit Report(const OrderedJson& raw) {
    const Folder folder;
    WriteText(folder.File("raw.json"), raw.dump());
    const std::string command = "'" + kSource + "/tools/benchmark' --report --results '" +
                                folder.File("raw.json") + "' --output '" + folder.File("out") +
                                "' > '" + folder.File("printed") + "' 2>&1";
    const int status = std::system(command.c_str());
    exit_code = WEXITSTATUS(status);
    printed = ReadText(folder.File("printed"));
    page = ReadText(folder.File("out/docs/BENCHMARKS.md"));
    readme = ReadText(folder.File("out/README.md"));
  }
};

std::string Section(const std::string& page, const std::string& heading) {
  const size_t at = page.find("\n## " + heading);
  if (at == std::string::npos) return "";
  return page.substr(at, page.find("\n## ", at + 1) - at);
}

TEST_CASE("docs/BENCHMARKS.md and the README's figures are what the raw file gives", "[report]") {
  const Report report(RawFigures());
  INFO(report.printed);
  REQUIRE(report.exit_code == 0);
  CHECK((report.page == ReadText(kSource + "/docs/BENCHMARKS.md")));
  CHECK((report.readme == ReadText(kSource + "/README.md")));
}

TEST_CASE("a figure that the raw file lacks is an error that names it", "[report]") {
  OrderedJson raw = RawFigures();
  Step(raw, "regions").at("rows").at(3).erase("cold_seconds");
  const Report report(raw);
  CHECK(report.exit_code == 1);
  CHECK_THAT(report.printed, Catch::Contains("step regions, row 3") &&
                                 Catch::Contains("no figure \"cold_seconds\""));
  CHECK(report.page.empty());
}

TEST_CASE("a step that failed, or was not run, is said instead of its figures", "[report]") {
  OrderedJson raw = RawFigures();
  CHECK_THAT(Section(Report(raw).page, "Layouts"), Catch::Contains("| tile triangles |"));
  OrderedJson& layouts = Step(raw, "layouts");
  layouts["ok"] = false;
  layouts["error"] = "locality_bench: signal 9";
  OrderedJson& bounds = Step(raw, "bounds");
  bounds["step"] = "another";
  const Report report(raw);
  INFO(report.printed);
  REQUIRE(report.exit_code == 0);
  const std::string failed = Section(report.page, "Layouts");
  CHECK_THAT(failed, Catch::Contains("**Failed**: locality_bench: signal 9"));
  CHECK(failed.find('|') == std::string::npos);
  const std::string missing = Section(report.page, "The bound");
  CHECK_THAT(missing, Catch::Contains("Not measured: the step `bounds` was not run."));
  CHECK(missing.find('|') == std::string::npos);
}

TEST_CASE("the page's template has no figure of its own", "[report]") {
  const std::string text = ReadText(kSource + "/bench/report/page.md.in");
  REQUIRE(!text.empty());
  const std::string words = std::regex_replace(text, std::regex("\\{\\{[^}]*\\}\\}"), "");
  CHECK(words.find_first_of("0123456789") == std::string::npos);
}

}  // namespace
}  // namespace mtdb::test
