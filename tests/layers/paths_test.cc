// SPDX-License-Identifier: Apache-2.0
// What docs/design.md, section 10, says of where something new goes is all: what there is of each
// kind is named in no other file. tests/query has a region and a node shape of their own,
// tests/toy_format a mesh format, tests/tools/cli a verb, tests/store/packed carriers.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cctype>
#include <sstream>
#include <string>
#include <vector>

#include "tests/layers/source_text.h"

namespace mtdb::test {
namespace {

// One that is there of a kind, as code names it, and the folders in which each has files of its
// own.
struct Kind {
  const char* question;  // as the paragraph begins
  const char* code;
  std::vector<const char*> folders;
};

const std::vector<Kind>& Kinds() {
  static const std::vector<Kind> kKinds{
      {"a region kind?", "\\b[Tt]ube", {"query/fields/"}},
      {"an attribute kind?", "\\bkInt16\\b", {}},
      {"a carrier?", "\"s3\"|s3:", {"store/carriers/"}},
      {"a verb?", "\\bkRenameVerb\\b|\"rename\"", {"tools/cli/verbs/"}},
      {"a file format?",
       "\\b(Read|Recognise)Stl\\b|CreateStlWriter",
       {"codecs/mesh_file/readers/", "codecs/mesh_file/writers/"}},
  };
  return kKinds;
}

std::string Lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

// The paragraph that answers the question.
std::string Path(const std::string& design, const std::string& question) {
  const size_t begin = design.find("**... " + question + "**");
  if (begin == std::string::npos) return "";
  return Lower(design.substr(begin, design.find("\n**...", begin + 1) - begin));
}

// By all words of its name without the suffix, as "PLY's header" has those of ply_header.cc.
bool IsNamed(const std::string& paragraph, const std::string& file) {
  const std::string name = file.substr(file.rfind('/') + 1);
  std::istringstream words(name.substr(0, name.find('.')));
  for (std::string word; std::getline(words, word, '_');) {
    if (paragraph.find(word) == std::string::npos) return false;
  }
  return true;
}

bool IsProduct(const std::string& file) {
  for (const char* const folder : {"store/", "codecs/", "query/", "builder/", "tools/"}) {
    if (file.starts_with(folder)) return IsCode(file);
  }
  return false;
}

// Files that name what is there of the kind, and that the path does not tell; `*named` counts all.
Violations Untold(const Kind& kind, const Texts& texts, const std::string& paragraph,
                  size_t* named) {
  const std::regex code(kind.code);
  Violations untold;
  for (const auto& [file, text] : texts) {
    if (!IsProduct(file) || !std::regex_search(Separate(text).code, code)) continue;
    ++*named;
    const bool own = std::ranges::any_of(
        kind.folders, [&path = file](const char* folder) { return path.starts_with(folder); });
    if (!own && !IsNamed(paragraph, file)) untold.push_back(file);
  }
  return untold;
}

TEST_CASE("docs/design.md names all files that a new thing of a kind touches",
          "[layers][documents]") {
  const Texts& texts = ProjectTexts();
  const std::string& design = texts.at("docs/design.md");
  for (const Kind& kind : Kinds()) {
    INFO(kind.question);
    const std::string paragraph = Path(design, kind.question);
    REQUIRE(!paragraph.empty());
    size_t named = 0;
    for (const std::string& file : Untold(kind, texts, paragraph, &named)) FAIL_CHECK(file);
    CHECK(named >= 2);
    // A file more, of a folder that has none of it.
    Texts planted = texts;
    planted["builder/intake/planted.cc"] = "tube s3: \"rename\" kInt16 ReadStl(";
    planted["builder/intake/remarks.cc"] = "// tube s3: rename kInt16 ReadStl(";
    CHECK(Untold(kind, planted, paragraph, &named) == Violations{"builder/intake/planted.cc"});
  }
}

}  // namespace
}  // namespace mtdb::test
