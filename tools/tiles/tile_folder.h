// SPDX-License-Identifier: Apache-2.0
// TileFolder: the folder of a tree of tiles. Files appear whole; a record says what they are of.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/json.h"
#include "store/base/status.h"

namespace mtdb {

// The record's name in the folder.
inline constexpr char kTileRecord[] = "mtdb-tiles.json";
// A folder in it, where several trees lie by their numbers until they become files of the folder.
inline constexpr char kTileParts[] = "parts";

// Locked while this object lives. Write() is for any thread, all else for one.
class TileFolder {
 public:
  // `identity` is what the tiles follow from: the format, the object with its digest, options. A
  // folder that is not there is made; one with tiles of the same identity is gone on with; one with
  // others loses its tiles where `force` is set, else kAlreadyExists, as is whatever is not empty
  // and has no such record. kBusy: another process writes there.
  static Result<std::unique_ptr<TileFolder>> Open(const std::string& path, const Json& identity,
                                                  bool force);
  // Takes a tree away, with its record and, where nothing else is in it, the folder.
  static Status Remove(const std::string& path);
  ~TileFolder();
  TileFolder(const TileFolder&) = delete;
  TileFolder& operator=(const TileFolder&) = delete;

  const std::string& path() const { return path_; }
  // What was recorded last; null in a new folder.
  const Json& progress() const { return progress_; }
  // kNoSpace, kIoError.
  Status Write(const std::string& name, ByteSpan bytes) const;
  // Records how far the tiles are, once what was written is on the disk.
  Status Record(const Json& progress);

 private:
  explicit TileFolder(std::string path) : path_(std::move(path)) {}
  Status Lock();
  Status ReadRecord(bool force);

  std::string path_;
  int folder_ = -1;
  Json identity_, progress_;
};

// The names of all files of a tree, from the folder on, sorted; not of those that were being
// written.
std::vector<std::string> ListTileFiles(const std::string& path);

// Whether it is a record of tiles.
bool IsTileRecord(const Json& record);
// The record of the tree in `path`: its identity and progress. kNotFound where there is none.
Result<Json> ReadTileRecord(const std::string& path);

}  // namespace mtdb
