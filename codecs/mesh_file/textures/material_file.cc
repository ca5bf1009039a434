// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/material_file.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <system_error>

#include "codecs/mesh_file/input/file_io.h"
#include "codecs/mesh_file/input/text_reader.h"
#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/textures/file_names.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMostMaterials = size_t{1} << 20;
constexpr uint64_t kMostFileBytes = uint64_t{1} << 28;

// An option of a map, and how many words follow it: all that are numbers, up to so many, when
// `numbers`.
struct MapOption {
  std::string_view name;
  size_t words = 1;
  bool numbers = false;
  bool moves = false;  // it changes where the image lies
};
constexpr std::array kOptions{MapOption{"-blendu"},
                              MapOption{"-blendv"},
                              MapOption{"-boost"},
                              MapOption{"-bm"},
                              MapOption{"-cc"},
                              MapOption{"-clamp"},
                              MapOption{"-colorspace"},
                              MapOption{"-imfchan"},
                              MapOption{"-mm", 2, true},
                              MapOption{"-o", 3, true, true},
                              MapOption{"-s", 3, true, true},
                              MapOption{"-t", 3, true, true},
                              MapOption{"-texres"},
                              MapOption{"-type"}};

// Cuts the first word off, and the blanks behind it.
std::string_view TakeWord(std::string_view* rest) {
  const size_t end = std::min(rest->find_first_of(" \t"), rest->size());
  const std::string_view word = rest->substr(0, end);
  rest->remove_prefix(std::min(rest->find_first_not_of(" \t", end), rest->size()));
  return word;
}

bool IsWord(std::string_view word, std::string_view lower) {
  return std::ranges::equal(word, lower, [](char a, char b) {
    return (a >= 'A' && a <= 'Z' ? static_cast<char>(a - 'A' + 'a') : a) == b;
  });
}

}  // namespace

std::string_view TrimmedName(std::string_view rest) {
  constexpr const char* kBlanks = " \t\r";
  rest.remove_prefix(std::min(rest.find_first_not_of(kBlanks), rest.size()));
  rest = rest.substr(0, rest.find_last_not_of(kBlanks) + 1);
  const bool quoted = rest.size() > 2 && rest.front() == '"' && rest.back() == '"';
  return quoted ? rest.substr(1, rest.size() - 2) : rest;
}

std::string_view NameBehindOptions(std::string_view rest, bool* has_options) {
  rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size()));
  while (rest.starts_with('-')) {
    std::string_view behind = rest;
    const std::string_view word = TakeWord(&behind);
    const auto* const option =
        std::ranges::find_if(kOptions, [&](const MapOption& o) { return IsWord(word, o.name); });
    if (option == kOptions.end()) break;  // a name
    *has_options |= option->moves;
    for (size_t i = 0; i < option->words && !behind.empty(); ++i) {
      std::string_view next = behind;
      double number = 0;
      const bool is_number = ParseReal(TakeWord(&next), &number);
      // The last word is a name, whatever it is.
      if (option->numbers && (!is_number || next.empty())) break;
      behind = next;
    }
    rest = behind;
  }
  return TrimmedName(rest);
}

void MaterialFiles::ReadNamed(const std::string& folder, std::string_view names,
                              MeshReadReport* report) {
  const std::string whole = PathOfNamed(folder, TrimmedName(names));
  std::error_code error;
  LineTokens tokens(names);
  std::string_view name, second;
  tokens.Next(&name);
  if (!tokens.Next(&second) || std::filesystem::exists(whole, error)) return Read(whole, report);
  LineTokens all(names);
  while (all.Next(&name)) Read(PathOfNamed(folder, name), report);
}

void MaterialFiles::Read(const std::string& path, MeshReadReport* report) {
  const Result<std::unique_ptr<InputFile>> file = InputFile::Open(path);
  if (!file.ok()) {
    return AddIgnored(report, "a material file that cannot be read: " + file.status().message());
  }
  if ((*file)->size_bytes() > kMostFileBytes) {
    return AddIgnored(report, "a material file of more than 256 MiB: " + path);
  }
  TextReader text(**file);
  Material* current = nullptr;
  bool has_options = false;
  std::string_view line, word;
  while (text.NextLine(&line)) {
    LineTokens tokens(line);
    if (!tokens.Next(&word)) continue;
    const std::string_view rest =
        line.substr(static_cast<size_t>(word.data() + word.size() - line.data()));
    if (IsWord(word, "newmtl")) {
      if (materials_.size() >= kMostMaterials) break;
      const auto [at, is_new] = materials_.try_emplace(std::string(TrimmedName(rest)));
      current = is_new ? &at->second : nullptr;
      if (is_new) current->folder = FolderOf(path);
    } else if (current != nullptr && IsWord(word, "map_kd")) {
      current->image = NameBehindOptions(rest, &has_options);
    }
  }
  if (has_options) AddIgnored(report, "how map_Kd moves and scales images (-o, -s, -t)");
  if (!text.status().ok()) {
    AddIgnored(report, "the rest of a material file: " + text.status().message());
  }
}

const MaterialFiles::Material* MaterialFiles::Find(const std::string& name) const {
  const auto at = materials_.find(name);
  return at == materials_.end() ? nullptr : &at->second;
}

}  // namespace mtdb::internal
