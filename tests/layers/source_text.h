// SPDX-License-Identifier: Apache-2.0
// The project's files as texts, for tests that read them.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace mtdb::test {

using Texts = std::map<std::string, std::string>;  // path from the root -> text
using Violations = std::vector<std::string>;

inline std::string ReadText(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

// All files of the project's folders and of the root, but for what is built or fetched, and data.
inline const Texts& ProjectTexts() {
  static const Texts kTexts = [] {
    const std::filesystem::path root = MTDB_SOURCE_DIR;
    Texts texts;
    const auto add = [&](const std::filesystem::path& file) {
      texts[file.lexically_relative(root).generic_string()] = ReadText(file);
    };
    for (const auto& entry : std::filesystem::directory_iterator(root)) {
      if (entry.is_regular_file()) add(entry.path());
    }
    for (const char* const folder :
         {"store", "codecs", "query", "builder", "tools", "tests", "bench", "docs", "cmake"}) {
      std::filesystem::recursive_directory_iterator at(root / folder);
      for (; at != std::filesystem::recursive_directory_iterator(); ++at) {
        const std::string name = at->path().filename().string();
        const bool skipped = name == "node_modules" || name == "corpus" || name == "golden" ||
                             name == "__pycache__" || name == "built";
        if (skipped && at->is_directory()) at.disable_recursion_pending();
        if (at->is_regular_file()) add(at->path());
      }
    }
    return texts;
  }();
  return kTexts;
}

inline bool IsCode(const std::string& path) {
  return path.ends_with(".h") || path.ends_with(".cc") || path.ends_with(".c") ||
         path.ends_with(".inc");
}

// C and C++ in two: what is in comments, and what is not. Of the other part line ends stay.
struct CodeAndComments {
  std::string code, comments;
};
inline CodeAndComments Separate(const std::string& text) {
  CodeAndComments parts;
  enum { kCode, kLine, kBlock, kString } state = kCode;
  for (size_t i = 0; i < text.size(); ++i) {
    const std::string two = text.substr(i, 2);
    if (state == kCode && (two == "//" || two == "/*")) {
      state = two == "//" ? kLine : kBlock;
      parts.comments += ' ';
      ++i;
      continue;
    }
    if (state == kBlock && two == "*/") {
      state = kCode;
      ++i;
      continue;
    }
    if (state == kLine && text[i] == '\n') state = kCode;
    if (state == kCode && text.compare(i, 3, "'\"'") == 0) i += 2;  // no string begins
    if (state == kCode && text[i] == '"')
      state = kString;
    else if (state == kString && text[i] == '"')
      state = kCode;
    if (state == kString && text[i] == '\\') {
      parts.code += text.substr(i, 2);
      ++i;
      continue;
    }
    const bool in_comment = state == kLine || state == kBlock;
    (in_comment ? parts.comments : parts.code) += text[i];
    if (text[i] == '\n') (in_comment ? parts.code : parts.comments) += '\n';
  }
  return parts;
}

// All matches of an expression; of each, its groups from 0 on.
inline std::vector<std::vector<std::string>> Matches(const std::string& text,
                                                     const std::string& expression) {
  const std::regex compiled(expression);
  std::vector<std::vector<std::string>> all;
  for (std::sregex_iterator at(text.begin(), text.end(), compiled), end; at != end; ++at) {
    auto& groups = all.emplace_back();
    for (const auto& group : *at) groups.push_back(group.str());
  }
  return all;
}

inline std::vector<std::string> LinesOf(const std::string& text) {
  std::vector<std::string> lines(1);
  for (const char c : text) {
    if (c == '\n')
      lines.emplace_back();
    else
      lines.back() += c;
  }
  return lines;
}

inline std::string Trimmed(const std::string& text) {
  const size_t begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \t\r\n") - begin + 1);
}

}  // namespace mtdb::test
