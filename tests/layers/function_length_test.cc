// SPDX-License-Identifier: Apache-2.0
// A function fits on a screen: at most 60 lines, its signature included, but for those that a list
// here names with their reasons.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace mtdb::test {
namespace {

constexpr size_t kMaxLines = 60;
constexpr std::array kFolders{"store", "codecs", "query", "builder", "tools", "bench"};

// File and a part of the signature -> the reason.
const std::map<std::pair<std::string, std::string>, std::string> kLonger{
    {{"store/pages/page.cc", " Page::Decode("},
     "reads and checks the fields of a page one after the other, as the bytes come"},
    {{"codecs/coding/attribute_coder.cc", " AttributeCoder::CodeNormal("},
     "encodes and decodes, statement by statement as codecs/FORMAT.md has it"},
    {{"codecs/coding/hole_frame.inc", " HoleFrame::Set("},
     "arithmetic without branches, as codecs/FORMAT.md has it"},
    {{"tools/cli/verbs/verb_ingest.cc", " Ingest("}, "what the verb does, in order"},
};

struct Function {
  std::string signature;  // its first line
  size_t begin = 0;       // from 1
  size_t lines = 0;
};

// The functions of a file that clang-format has laid out: a brace alone closes what the last line
// of the same indentation has begun. Finds loops and branches too, which are shorter than what they
// are in.
std::vector<Function> FunctionsOf(std::istream& in) {
  std::vector<Function> functions;
  std::map<size_t, std::pair<std::string, size_t>> begun;  // by indentation: 0, or 2 in a class
  size_t number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    const size_t indentation = line.find_first_not_of(' ');
    if (indentation != 0 && indentation != 2) continue;
    if (line.substr(indentation) == "}") {
      const auto& [signature, begin] = begun[indentation];
      if (begin > 0) functions.push_back({signature, begin, number - begin + 1});
      continue;
    }
    const char first = line[indentation];
    if (first == '}' || first == '/' || first == '#') continue;
    if (line.compare(indentation, 8, "template") == 0) continue;
    begun[indentation] = {line, number};
  }
  return functions;
}

TEST_CASE("functions fit on a screen", "[layers]") {
  size_t found = 0;
  std::set<std::string> named;
  const std::filesystem::path root = MTDB_SOURCE_DIR;
  for (const char* const folder : kFolders) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cc" && extension != ".c" && extension != ".inc") {
        continue;
      }
      const std::string file = entry.path().lexically_relative(root).generic_string();
      std::ifstream in(entry.path());
      for (const Function& function : FunctionsOf(in)) {
        ++found;
        const auto reason = std::ranges::find_if(kLonger, [&](const auto& known) {
          return known.first.first == file &&
                 function.signature.find(known.first.second) != std::string::npos;
        });
        if (reason != kLonger.end()) {
          named.insert(reason->first.second);
          continue;
        }
        if (function.lines <= kMaxLines) continue;
        FAIL_CHECK(file << ":" << function.begin << ": " << function.lines << " lines, at most "
                        << kMaxLines << ": " << function.signature);
      }
    }
  }
  CHECK(found > 3000);
  CHECK(named.size() == kLonger.size());  // all of the list are there
}

TEST_CASE("the counter of lines sees functions and methods", "[layers]") {
  std::istringstream text(
      "int One() {\n  return 1;\n}\n\nclass A {\n public:\n  int Two(int a,\n          int b) {\n"
      "    return 2;\n  }\n};\n\ntemplate <typename T>\nT Three() {\n  if (x) {\n    y();\n  }\n\n"
      "  return 3;\n}\n");
  const std::vector<Function> functions = FunctionsOf(text);
  REQUIRE(functions.size() == 4);
  CHECK(functions[0].signature == "int One() {");
  CHECK(functions[0].lines == 3);
  CHECK(functions[1].signature == "  int Two(int a,");
  CHECK(functions[1].lines == 4);
  CHECK(functions[2].signature == "  if (x) {");
  CHECK(functions[3].signature == "T Three() {");
  CHECK(functions[3].begin == 14);
  CHECK(functions[3].lines == 7);
}

}  // namespace
}  // namespace mtdb::test
