// SPDX-License-Identifier: Apache-2.0
// Shards: many objects of a neuroglancer mesh in a few files ("neuroglancer_uint64_sharded_v1").
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/json.h"
#include "store/base/status.h"

namespace mtdb {

// The lowest bits of an id say which minishard it is in, the next ones which shard.
struct ShardLayout {
  uint32_t minishard_bits = 0;
  uint32_t shard_bits = 0;

  uint64_t ShardOf(uint64_t id) const {
    return id >> minishard_bits & ((uint64_t{1} << shard_bits) - 1);
  }
  uint64_t MinishardOf(uint64_t id) const { return id & ((uint64_t{1} << minishard_bits) - 1); }
  // "1f.shard"
  std::string FileOf(uint64_t id) const;
  // As `info` has it.
  Json ToJson() const;
};
// For so many objects with so many bytes: shards of some GiB, minishards of some hundred objects.
ShardLayout ChooseShards(uint64_t objects, uint64_t bytes);
// none: it is none that this program writes.
std::optional<ShardLayout> ShardLayoutOf(const Json& json);

// An object, as it goes into its shard: the fragments, and its manifest right behind them.
struct ShardEntry {
  uint64_t id = 0;
  // Files one after the other, and the bytes that follow.
  std::vector<std::string> files;
  Bytes manifest;
};
// Writes the files of all shards into the folder; `entries` are sorted by id. Errors: those of
// files.
Status WriteShards(const std::string& folder, const ShardLayout& layout,
                   const std::vector<ShardEntry>& entries);

// Where an object's manifest lies in its shard: offset and size. kNotFound, kCorrupt.
struct ShardPlace {
  uint64_t offset = 0, bytes = 0;
};
Result<ShardPlace> FindInShard(const std::string& shard, const ShardLayout& layout, uint64_t id);

}  // namespace mtdb
