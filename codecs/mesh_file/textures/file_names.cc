// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/textures/file_names.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "store/base/attribute_layout.h"

namespace mtdb::internal {
namespace {

bool LeadsOut(const std::string& name) {
  if (name.starts_with('/') || name.find(':') != std::string::npos) return true;
  for (size_t begin = 0; begin <= name.size();) {
    const size_t end = std::min(name.find('/', begin), name.size());
    if (std::string_view(name).substr(begin, end - begin) == "..") return true;
    begin = end + 1;
  }
  return false;
}

bool IsThere(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

// Where the suffix begins, with its dot; the size when there is none.
size_t SuffixOf(const std::string& name) {
  const size_t dot = name.rfind('.');
  return dot == std::string::npos || dot == 0 ? name.size() : dot;
}

bool IsContinuation(char c) { return (static_cast<unsigned char>(c) & 0xc0) == 0x80; }

}  // namespace

std::string FolderOf(std::string_view path) {
  const size_t slash = path.rfind('/');
  return std::string(slash == std::string_view::npos ? "" : path.substr(0, slash + 1));
}

std::string_view LastPart(std::string_view path) {
  const size_t slash = path.find_last_of("/\\");
  return slash == std::string_view::npos ? path : path.substr(slash + 1);
}

std::string PlainFileName(std::string_view name) {
  constexpr size_t kMost = 120, kMostSuffix = 20;
  std::string plain(LastPart(name));
  for (char& c : plain) {
    if (std::string_view("<>:\"|?*").find(c) != std::string_view::npos) c = '_';
  }
  if (plain.find_first_not_of(". ") == std::string::npos) return "texture";
  if (plain[0] == '-' || plain[0] == '.') plain[0] = '_';
  plain = UsableAttributeName(plain, {});
  if (plain.size() <= kMost) return plain;
  const size_t dot = SuffixOf(plain);
  const std::string suffix = plain.size() - dot <= kMostSuffix ? plain.substr(dot) : "";
  size_t kept = kMost - suffix.size();
  while (kept > 0 && IsContinuation(plain[kept])) --kept;
  return plain.substr(0, kept) + suffix;
}

std::string PathOfNamed(const std::string& folder, std::string_view name) {
  std::string path(name);
  std::ranges::replace(path, '\\', '/');
  const std::string last = folder + std::string(LastPart(path));
  if (LeadsOut(path)) return last;
  path = std::filesystem::path(folder + path).lexically_normal().string();
  return IsThere(path) || !IsThere(last) ? path : last;
}

std::string DistinctNames::Add(const std::string& name) {
  const auto take = [this](std::string wanted) {
    for (char& c : wanted) {
      if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    }
    return taken_.insert(std::move(wanted)).second;
  };
  const size_t dot = SuffixOf(name);
  std::string distinct = name;
  for (int i = 2; !take(distinct); ++i) {
    distinct = name.substr(0, dot) + "_" + std::to_string(i) + name.substr(dot);
  }
  return distinct;
}

}  // namespace mtdb::internal
