// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/neuroglancer/shard_file.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "codecs/mesh_file/atomic_file.h"
#include "tools/request/read_file.h"
#include "tools/tiles/file_piece.h"

namespace mtdb {

namespace {

constexpr uint64_t kObjectsOfMinishard = 256, kBytesOfShard = uint64_t{2} << 30;
constexpr uint32_t kMostBits = 16;
constexpr uint64_t kBytesOfEntry = 16, kBytesOfObject = 24;
constexpr char kType[] = "neuroglancer_uint64_sharded_v1";

uint32_t BitsFor(uint64_t count) {
  uint32_t bits = 0;
  while (bits < kMostBits && (uint64_t{1} << bits) < count) ++bits;
  return bits;
}

// The objects of a minishard: ids and places, as differences.
Bytes MinishardIndex(const std::map<uint64_t, ShardPlace>& objects) {
  ByteWriter ids, offsets, sizes;
  uint64_t last = 0, end = 0;
  for (const auto& [id, place] : objects) {
    ids.Put(id - last);
    offsets.Put(place.offset - end);
    sizes.Put(place.bytes);
    last = id;
    end = place.offset + place.bytes;
  }
  ids.PutBytes(offsets.bytes());
  ids.PutBytes(sizes.bytes());
  return ids.Take();
}

Status WriteShard(const std::string& path, const ShardLayout& layout,
                  const std::vector<const ShardEntry*>& entries) {
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  const uint64_t begin = kBytesOfEntry << layout.minishard_bits;  // offsets count from here
  MTDB_RETURN_IF_ERROR(file->Append(std::string(begin, '\0')));
  std::map<uint64_t, std::map<uint64_t, ShardPlace>> minishards;
  for (const ShardEntry* const entry : entries) {
    for (const std::string& name : entry->files) {
      MTDB_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(name));
      MTDB_RETURN_IF_ERROR(file->Append(bytes));
    }
    minishards[layout.MinishardOf(entry->id)][entry->id] = {file->bytes_written() - begin,
                                                            entry->manifest.size()};
    MTDB_RETURN_IF_ERROR(file->Append(ByteSpan(entry->manifest)));
  }
  ByteWriter index;
  for (uint64_t minishard = 0; minishard < uint64_t{1} << layout.minishard_bits; ++minishard) {
    const auto objects = minishards.find(minishard);
    const uint64_t at = file->bytes_written() - begin;
    if (objects != minishards.end()) {
      MTDB_RETURN_IF_ERROR(file->Append(ByteSpan(MinishardIndex(objects->second))));
    }
    index.Put(at);
    index.Put(file->bytes_written() - begin);
  }
  MTDB_RETURN_IF_ERROR(file->Overwrite(0, index.bytes()));
  return file->Commit();
}

}  // namespace

std::string ShardLayout::FileOf(uint64_t id) const {
  std::string name(std::max((shard_bits + 3) / 4, 1u), '0');
  uint64_t shard = ShardOf(id);
  for (size_t i = name.size(); i-- > 0; shard /= 16) name[i] = "0123456789abcdef"[shard % 16];
  return name + ".shard";
}

Json ShardLayout::ToJson() const {
  return {{"@type", kType},           {"preshift_bits", 0},
          {"hash", "identity"},       {"minishard_bits", minishard_bits},
          {"shard_bits", shard_bits}, {"minishard_index_encoding", "raw"},
          {"data_encoding", "raw"}};
}

ShardLayout ChooseShards(uint64_t objects, uint64_t bytes) {
  ShardLayout layout;
  layout.minishard_bits = BitsFor(objects / kObjectsOfMinishard + 1);
  layout.shard_bits = std::min(BitsFor(bytes / kBytesOfShard + 1), BitsFor(objects));
  return layout;
}

std::optional<ShardLayout> ShardLayoutOf(const Json& json) {
  const uint64_t* const minishard = json["minishard_bits"].whole_number();
  const uint64_t* const shard = json["shard_bits"].whole_number();
  if (minishard == nullptr || shard == nullptr || *minishard > kMostBits || *shard > kMostBits) {
    return std::nullopt;
  }
  const ShardLayout layout{static_cast<uint32_t>(*minishard), static_cast<uint32_t>(*shard)};
  return layout.ToJson() == json ? std::optional(layout) : std::nullopt;
}

Status WriteShards(const std::string& folder, const ShardLayout& layout,
                   const std::vector<ShardEntry>& entries) {
  std::map<std::string, std::vector<const ShardEntry*>> shards;
  for (const ShardEntry& entry : entries) shards[layout.FileOf(entry.id)].push_back(&entry);
  for (const auto& [name, of_shard] : shards) {
    MTDB_RETURN_IF_ERROR(WriteShard(folder + "/" + name, layout, of_shard));
  }
  return Status::Ok();
}

Result<ShardPlace> FindInShard(const std::string& shard, const ShardLayout& layout, uint64_t id) {
  const uint64_t begin = kBytesOfEntry << layout.minishard_bits;
  MTDB_ASSIGN_OR_RETURN(const Bytes entry,
                        ReadPiece(shard, layout.MinishardOf(id) * kBytesOfEntry, kBytesOfEntry));
  ByteReader of_shard(entry);
  const auto from = of_shard.Get<uint64_t>(), to = of_shard.Get<uint64_t>();
  if (to < from || (to - from) % kBytesOfObject != 0) return Corrupt("an index has no size");
  MTDB_ASSIGN_OR_RETURN(const Bytes text, ReadPiece(shard, begin + from, to - from));
  const size_t count = text.size() / kBytesOfObject;
  const ByteSpan all(text);
  ByteReader ids(all), offsets(all.subspan(8 * count)), sizes(all.subspan(16 * count));
  uint64_t at = 0, end = begin;
  for (size_t i = 0; i < count; ++i) {
    at += ids.Get<uint64_t>();
    const uint64_t offset = end + offsets.Get<uint64_t>(), bytes = sizes.Get<uint64_t>();
    if (at == id) return ShardPlace{offset, bytes};
    end = offset + bytes;
  }
  return NotFound("has no object " + std::to_string(id));
}

}  // namespace mtdb
