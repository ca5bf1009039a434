// SPDX-License-Identifier: Apache-2.0
// docs/cpp.md shows every public type of C++, those that `cmake --install` gives.
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <string>

namespace mtdb::test {
namespace {

std::string ReadText(const std::filesystem::path& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST_CASE("docs/cpp.md shows each public type", "[layers]") {
  const std::filesystem::path root = MTDB_SOURCE_DIR;
  const std::string page = ReadText(root / "docs/cpp.md");
  std::istringstream installed(ReadText(root / "cmake/installed_headers.txt"));
  // At the beginning of a line, and no declaration of what is elsewhere.
  const std::regex type(
      R"((^|\n)(class|struct|enum class) (\[\[nodiscard\]\] )?([A-Z]\w+)[^;{\n]*\{)");
  size_t types = 0;
  for (std::string component, header; installed >> component >> header;) {
    if (component == "c") continue;  // functions
    const std::string text = ReadText(root / header);
    for (std::sregex_iterator at(text.begin(), text.end(), type), end; at != end; ++at) {
      const std::string name = (*at)[4];
      INFO(header << ": " << name);
      CHECK(std::regex_search(page, std::regex("\\b" + name + "\\b")));
      ++types;
    }
  }
  CHECK(types > 50);
}

}  // namespace
}  // namespace mtdb::test
