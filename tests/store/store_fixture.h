// SPDX-License-Identifier: Apache-2.0
// Shared by the store's tests: a directory that goes away, and objects of random payloads whose
// content is known from their seed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "store/database.h"
#include "store/verify_store.h"

namespace mtdb::test {

class TempDir {
 public:
  TempDir();
  ~TempDir();
  std::string File(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

// What is written for an object, and so expected back.
struct SyntheticObject {
  struct Unit {
    UnitEntry entry;
    std::vector<UnitId> children;
    Bytes payload;
  };
  std::vector<Unit> units;
  std::vector<Bytes> files;  // of its texture: of the pages, then that of the tiles, if it has any
  ObjectRecord record;
};

struct SyntheticOptions {
  uint64_t seed = 1;
  uint32_t clusters = 40;               // of the finest round; a quarter of it in each further one
  uint32_t max_payload = 4000;          // bytes
  std::vector<size_t> page_bytes = {};  // of the images of its texture; without any, it has none
  size_t tile_bytes = 0;                // of the tiles of its texture
};

SyntheticObject MakeObject(const SyntheticOptions& options);

// Create, Add..., AddTextureFile..., Publish.
Result<ObjectRecord> WriteObject(Database& database, const std::string& name,
                                 const SyntheticObject& object, bool replace = false);

// Reads all and compares: ok, an error of the reader, or kInvalidArgument when a payload differs.
Status CompareObject(ClusterSource& source, const SyntheticObject& object);
// The same of the files of its texture.
Status CompareFiles(ClusterSource& source, const SyntheticObject& object);

// Verifies and returns the failures, one a line.
std::string VerifyFailures(const std::string& path, const std::string& object = "");

Bytes ReadFile(const std::string& path);
void WriteFile(const std::string& path, ByteSpan bytes);

std::shared_ptr<Database> OpenWritable(const std::string& path);
std::shared_ptr<Database> OpenReadOnly(const std::string& path);

// Runs `body` in a child process, which leaves with what it returns, and gives the wait status.
int RunChild(const std::function<int()>& body);

}  // namespace mtdb::test
