// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/tile_folder.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <iterator>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "store/files/posix_file.h"
#include "tools/request/read_file.h"

namespace mtdb {

namespace {

namespace fs = std::filesystem;

constexpr char kProperties[] = "segment_properties";

Status FileError(const std::string& path, int error) {
  return {FileErrorCode(error), path + ": " + std::generic_category().message(error)};
}

// In any order.
bool HaveSameMembers(const Json& a, const Json& b) {
  return a.is_object() && b.is_object() && a.size() == b.size() &&
         std::all_of(a.members().begin(), a.members().end(), [&](const Json::Member& member) {
           return b.contains(member.name) && b[member.name] == member.value;
         });
}

bool IsNumber(const std::string& name) {
  return name.find_first_not_of("0123456789") == std::string::npos;
}
bool IsNumberOf16(const std::string& name) {
  return name.find_first_not_of("0123456789abcdef") == std::string::npos;
}

// Of files in folders with numbers, and beside these.
constexpr const char* kSuffixes[] = {".glb", ".json", ".terrain", ".png", ".drc"};
constexpr const char* kTopNames[] = {"tileset.json", "layer.json", "tiles.json", "info",
                                     "manifest"};

// What a tree has: files of tiles in folders with numbers, those that name them, and such as were
// being written.
bool IsOfTree(std::string name, bool at_top) {
  if (name.ends_with(".tmp")) name.resize(name.size() - 4);
  if (!at_top) {
    return std::any_of(std::begin(kSuffixes), std::end(kSuffixes),
                       [&](const char* suffix) { return name.ends_with(suffix); });
  }
  const std::string stem = name.substr(0, name.find('.'));
  return std::find(std::begin(kTopNames), std::end(kTopNames), name) != std::end(kTopNames) ||
         (IsNumber(stem) && (name == stem || name == stem + ".index")) ||
         (name.ends_with(".shard") && IsNumberOf16(stem));
}

Status RemoveFile(const std::string& path) {
  std::error_code error;
  fs::remove(path, error);
  return error ? FileError(path, error.value()) : Status::Ok();
}

Status ClearFolder(const std::string& path, bool at_top);

// Trees that did not become files.
Status ClearParts(const std::string& path) {
  std::error_code error;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    const bool is_tree =
        fs::is_directory(entry->symlink_status(error)) && IsNumber(entry->path().filename());
    if (is_tree) MTDB_RETURN_IF_ERROR(TileFolder::Remove(entry->path()));
  }
  return error ? FileError(path, error.value()) : Status::Ok();
}

// Whatever else is there stays, and its folders with it.
Status ClearFolder(const std::string& path, bool at_top) {
  std::error_code error;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename();
    const fs::file_status status = entry->symlink_status(error);
    if (at_top && fs::is_directory(status) && name == kTileParts) {
      MTDB_RETURN_IF_ERROR(ClearParts(entry->path()));
    } else if (at_top && fs::is_directory(status) && name == kProperties) {
      MTDB_RETURN_IF_ERROR(RemoveFile(entry->path() / "info"));
    } else if (fs::is_directory(status) && IsNumber(name)) {
      MTDB_RETURN_IF_ERROR(ClearFolder(entry->path(), false));
      std::error_code not_empty;
      fs::remove(entry->path(), not_empty);
    } else if (fs::is_regular_file(status) && IsOfTree(name, at_top)) {
      fs::remove(entry->path(), error);
    }
    if (error) return FileError(entry->path(), error.value());
  }
  return error ? FileError(path, error.value()) : Status::Ok();
}

}  // namespace

TileFolder::~TileFolder() {
  if (folder_ >= 0) ::close(folder_);
}

Result<std::unique_ptr<TileFolder>> TileFolder::Open(const std::string& path, const Json& identity,
                                                     bool force) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (fs::exists(status) && !fs::is_directory(status)) {
    return Status(StatusCode::kAlreadyExists,
                  path + ": expected a folder for tiles, found a file; nothing was written");
  }
  if (!fs::exists(status) && ::mkdir(path.c_str(), 0777) != 0) return FileError(path, errno);
  std::unique_ptr<TileFolder> folder(new TileFolder(path));
  folder->identity_ = identity;
  MTDB_RETURN_IF_ERROR(folder->Lock());
  MTDB_RETURN_IF_ERROR(folder->ReadRecord(force));
  // Whose folder it is is known before the first tile.
  if (folder->progress_.is_null()) MTDB_RETURN_IF_ERROR(folder->Record(Json(Json::Object{})));
  return folder;
}

Status TileFolder::Lock() {
  folder_ = ::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder_ < 0) return FileError(path_, errno);
  if (::flock(folder_, LOCK_EX | LOCK_NB) == 0) return Status::Ok();
  if (errno != EWOULDBLOCK) return FileError(path_, errno);
  return {StatusCode::kBusy, path_ + ": another process writes tiles there"};
}

Status TileFolder::ReadRecord(bool force) {
  std::error_code error;
  const auto record = ReadTileRecord(path_);
  if (!record.ok()) {
    // A run that was killed at its beginning may have left this.
    fs::remove(path_ + "/" + kTileRecord + ".tmp", error);
    if (fs::is_empty(path_, error)) return Status::Ok();
    return {StatusCode::kAlreadyExists,
            path_ + "/" + kTileRecord +
                ": not there, or no record of tiles by mtdb, but the folder is not empty; nothing "
                "was written: name another folder, or one that is not there"};
  }
  if (HaveSameMembers((*record)["of"], identity_)) {
    progress_ = (*record)["progress"];
  } else if (!force) {
    return {StatusCode::kAlreadyExists,
            path_ +
                ": the folder has tiles of another object, version or accuracy; --replace "
                "replaces them"};
  }
  if (progress_.is_object() && progress_.contains("levels")) return Status::Ok();
  // First it is said whose folder it is: a run that is killed while it clears is gone on with.
  MTDB_RETURN_IF_ERROR(Record(Json(Json::Object{})));
  return ClearFolder(path_, true);
}

Status TileFolder::Write(const std::string& name, ByteSpan bytes) const {
  const std::string path = path_ + "/" + name, temporary = path + ".tmp";
  const auto open = [&] {
    return ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  };
  int file = open();
  if (file < 0 && errno == ENOENT) {
    std::error_code error;
    fs::create_directories(fs::path(path).parent_path(), error);
    file = open();
  }
  if (file < 0) return FileError(path, errno);
  const bool written = WriteFully(file, 0, bytes.data(), bytes.size());
  const int error = errno;
  if (::close(file) != 0 || !written) {
    ::unlink(temporary.c_str());
    return FileError(path, written ? errno : error);
  }
  return std::rename(temporary.c_str(), path.c_str()) == 0 ? Status::Ok() : FileError(path, errno);
}

Status TileFolder::Record(const Json& progress) {
  progress_ = progress;
  if (::syncfs(folder_) != 0) return FileError(path_, errno);
  const Json record = {{"schema", "mtdb/tile_record/1"}, {"of", identity_}, {"progress", progress}};
  MTDB_RETURN_IF_ERROR(Write(kTileRecord, AsBytes(record.Text() + "\n")));
  return Status::Ok();
}

Status TileFolder::Remove(const std::string& path) {
  // First nothing is complete: what is killed while it removes is no tree to go on with.
  if (const Result<Json> record = ReadTileRecord(path); record.ok()) {
    TileFolder folder(path);
    MTDB_RETURN_IF_ERROR(folder.Lock());
    folder.identity_ = (*record)["of"];
    MTDB_RETURN_IF_ERROR(folder.Record(Json(Json::Object{})));
  }
  MTDB_RETURN_IF_ERROR(ClearFolder(path, true));
  MTDB_RETURN_IF_ERROR(RemoveFile(path + "/" + kTileRecord));
  std::error_code not_empty;
  fs::remove(path, not_empty);
  return Status::Ok();
}

std::vector<std::string> ListTileFiles(const std::string& path) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = fs::relative(entry->path(), path, error).generic_string();
    if (entry->is_regular_file(error) && !name.ends_with(".tmp")) names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  return names;
}

bool IsTileRecord(const Json& record) { return record["schema"] == Json("mtdb/tile_record/1"); }

Result<Json> ReadTileRecord(const std::string& path) {
  const Result<std::string> text = ReadFile(path + "/" + kTileRecord);
  if (!text.ok()) return NotFound(path + ": no tiles by mtdb are there");
  Json record = Json::ParseObject(*text);
  if (IsTileRecord(record)) return record;
  return NotFound(path + ": no tiles by mtdb are there");
}

}  // namespace mtdb
