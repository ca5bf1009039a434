// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/verbs/ingest_journal.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "builder/build.h"
#include "store/base/hash.h"
#include "store/base/json.h"

namespace mtdb {

namespace {

constexpr const char* kSuffix = ".journal";
constexpr size_t kMaxCommandBytes = 16 << 10;

// "<file name of the store>.<hash of its path and of the object's name>.journal"
std::string JournalPrefix(const std::string& store) {
  return std::filesystem::path(store).filename().string() + ".";
}

}  // namespace

std::string RealStorePath(const std::string& path) {
  std::error_code error;
  std::filesystem::path target = std::filesystem::absolute(path, error);
  // A link may point to a store that is still to be made; weakly_canonical does not follow it.
  for (int links = 0; links < 40 && std::filesystem::is_symlink(target, error); ++links) {
    target = target.parent_path() / std::filesystem::read_symlink(target, error);
  }
  const std::filesystem::path real = std::filesystem::weakly_canonical(target, error);
  return error || real.empty() ? path : real.string();
}

std::string FolderOf(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

std::string JournalPath(const std::string& folder, const std::string& store,
                        const std::string& name) {
  // The path too: stores of one name in several folders may share a folder of temporary files.
  const uint64_t hash = Hash64(AsBytes(name), Hash64(AsBytes(store)));
  char text[17];
  std::snprintf(text, sizeof(text), "%016llx", static_cast<unsigned long long>(hash));
  return folder + "/" + JournalPrefix(store) + text + kSuffix;
}

std::string JournalNote(const std::string& store, const std::string& object,
                        const std::string& command) {
  std::error_code error;
  const Json note{{"command", command.size() <= kMaxCommandBytes ? command : ""},
                  {"folder", std::filesystem::current_path(error).string()},
                  {"object", object},
                  {"store", store}};
  return note.Text();
}

std::vector<IngestJournal> FindJournals(const std::string& folder, const std::string& store,
                                        std::span<const ObjectRecord> published) {
  std::vector<IngestJournal> journals;
  std::error_code error;
  const std::string prefix = JournalPrefix(store);
  std::filesystem::directory_iterator at(folder, error);
  for (; !error && at != std::filesystem::directory_iterator(); at.increment(error)) {
    const std::string name = at->path().filename().string();
    if (!name.starts_with(prefix) || !name.ends_with(kSuffix)) continue;
    const Result<JournalInfo> info = ReadJournalInfo(at->path().string(), published);
    if (!info.ok()) continue;
    const Json note = Json::ParseObject(info->note);
    const auto text = [&](const char* key) {
      const std::string* const found = note[key].string();
      return found != nullptr ? *found : std::string();
    };
    // Of a store of the same name elsewhere.
    if (!text("store").empty() && text("store") != store) continue;
    if ((info->finished || info->bytes == 0) && !info->in_use) {
      RemoveFinishedJournal(at->path().string(), published);
      continue;
    }
    journals.push_back({at->path().string(), text("object"), text("folder"), text("command"),
                        info->bytes, info->in_use});
  }
  std::ranges::sort(journals, {}, &IngestJournal::path);
  return journals;
}

}  // namespace mtdb
