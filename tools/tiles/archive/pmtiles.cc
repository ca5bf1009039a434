// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/archive/pmtiles.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "codecs/mesh_file/atomic_file.h"
#include "store/base/json.h"
#include "tools/request/read_file.h"
#include "tools/tiles/archive/gzip.h"
#include "tools/tiles/file_piece.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/tile_folder.h"

namespace mtdb {

namespace {

constexpr std::string_view kMagic = "PMTiles\3";  // and the version
constexpr uint64_t kHeaderBytes = 127, kBeginOfTiles = 16384;
constexpr uint8_t kGzip = 2, kNone = 1, kPng = 2;
constexpr size_t kSmallBytes = 2048;  // of tiles that are remembered, to be there once
constexpr size_t kFirstLeaf = 4096;  // entries of a leaf directory; more where the root has no room
constexpr uint64_t kMostDirectoryBytes = uint64_t{1} << 28;
constexpr double kDegree = 1e7;

struct DirectoryEntry {
  uint64_t id = 0, offset = 0, bytes = 0, run = 0;  // run 0: a leaf directory
};

// "12/34/56.png"
struct TileName {
  uint64_t id = 0;
  std::string name;
};
std::optional<uint64_t> IdOf(const std::string& name) {
  uint32_t numbers[3]{};
  const char* at = name.data();
  const char* const end = at + name.size();
  for (int i = 0; i < 3; ++i) {
    const auto [next, error] = std::from_chars(at, end, numbers[i]);
    if (error != std::errc() || next == end || *next != (i < 2 ? '/' : '.')) return std::nullopt;
    at = next + 1;
  }
  const bool fits =
      numbers[0] < 32 && numbers[1] >> numbers[0] == 0 && numbers[2] >> numbers[0] == 0;
  if (!fits || std::string_view(at, end) != "png") return std::nullopt;
  return PmtilesId(numbers[0], numbers[1], numbers[2]);
}

Result<Bytes> EncodeDirectory(const DirectoryEntry* entries, size_t count) {
  ByteWriter to;
  to.PutVarint(count);
  uint64_t last = 0, end = 0;
  for (size_t i = 0; i < count; ++i)
    to.PutVarint(entries[i].id - std::exchange(last, entries[i].id));
  for (size_t i = 0; i < count; ++i) to.PutVarint(entries[i].run);
  for (size_t i = 0; i < count; ++i) to.PutVarint(entries[i].bytes);
  for (size_t i = 0; i < count; ++i) {
    const DirectoryEntry& e = entries[i];
    to.PutVarint(i > 0 && e.offset == end ? 0 : e.offset + 1);
    end = e.offset + e.bytes;
  }
  return Gzip(to.bytes());
}

Result<std::vector<DirectoryEntry>> DecodeDirectory(ByteSpan packed) {
  MTDB_ASSIGN_OR_RETURN(const Bytes bytes, Gunzip(packed, kMostDirectoryBytes));
  ByteReader from(bytes);
  const uint64_t count = from.GetVarint();
  if (from.failed() || count == 0 || count > from.remaining() / 4)
    return Corrupt("a directory is damaged");
  std::vector<DirectoryEntry> entries(count);
  uint64_t last = 0;
  for (DirectoryEntry& e : entries) last = e.id = last + from.GetVarint();
  for (DirectoryEntry& e : entries) e.run = from.GetVarint();
  for (DirectoryEntry& e : entries) e.bytes = from.GetVarint();
  uint64_t end = 0;
  for (DirectoryEntry& e : entries) {
    const uint64_t offset = from.GetVarint();
    e.offset = offset == 0 ? end : offset - 1;
    end = e.offset + e.bytes;
  }
  if (from.failed()) return Corrupt("a directory is damaged");
  return entries;
}

class PmtilesWriter {
 public:
  PmtilesWriter(std::string folder, AtomicFile* file) : folder_(std::move(folder)), file_(*file) {}

  Status Run() {
    MTDB_RETURN_IF_ERROR(file_.Append(std::string(kBeginOfTiles, '\0')));
    std::vector<TileName> tiles;
    for (std::string& name : ListTileFiles(folder_)) {
      if (const std::optional<uint64_t> id = IdOf(name)) tiles.push_back({*id, std::move(name)});
    }
    std::sort(tiles.begin(), tiles.end(),
              [](const TileName& a, const TileName& b) { return a.id < b.id; });
    for (const TileName& tile : tiles) MTDB_RETURN_IF_ERROR(Add(tile));
    tile_bytes_ = file_.bytes_written() - kBeginOfTiles;
    addressed_ = tiles.size();
    MTDB_ASSIGN_OR_RETURN(const Bytes root, WriteLeaves());
    MTDB_RETURN_IF_ERROR(WriteMetadata());
    ByteWriter to;
    PutHeader(root.size(), &to);
    to.PutBytes(root);
    MTDB_RETURN_IF_ERROR(file_.Overwrite(0, to.bytes()));
    return file_.Commit();
  }

 private:
  Status Add(const TileName& tile) {
    MTDB_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(folder_ + "/" + tile.name));
    const uint64_t end = file_.bytes_written() - kBeginOfTiles;
    uint64_t offset = end;
    if (bytes.size() <= kSmallBytes) offset = small_.emplace(bytes, end).first->second;
    if (!entries_.empty()) {
      DirectoryEntry& last = entries_.back();
      if (last.offset == offset && last.id + last.run == tile.id) {
        ++last.run;
        return Status::Ok();
      }
    }
    entries_.push_back({tile.id, offset, bytes.size(), 1});
    if (offset != end) return Status::Ok();
    ++contents_;
    return file_.Append(bytes);
  }

  // The root is what the first bytes have room for.
  Result<Bytes> WriteLeaves() {
    leaves_begin_ = file_.bytes_written();
    MTDB_ASSIGN_OR_RETURN(Bytes root, EncodeDirectory(entries_.data(), entries_.size()));
    for (size_t of_leaf = kFirstLeaf; root.size() > kBeginOfTiles - kHeaderBytes; of_leaf *= 2) {
      std::vector<DirectoryEntry> leaves;
      Bytes all;
      for (size_t i = 0; i < entries_.size(); i += of_leaf) {
        MTDB_ASSIGN_OR_RETURN(
            const Bytes leaf,
            EncodeDirectory(entries_.data() + i, std::min(of_leaf, entries_.size() - i)));
        leaves.push_back({entries_[i].id, all.size(), leaf.size(), 0});
        all.insert(all.end(), leaf.begin(), leaf.end());
      }
      MTDB_ASSIGN_OR_RETURN(root, EncodeDirectory(leaves.data(), leaves.size()));
      if (root.size() <= kBeginOfTiles - kHeaderBytes)
        MTDB_RETURN_IF_ERROR(file_.Append(ByteSpan(all)));
    }
    metadata_begin_ = file_.bytes_written();
    return root;
  }

  Status WriteMetadata() {
    MTDB_ASSIGN_OR_RETURN(const std::string tiles, ReadFile(folder_ + "/tiles.json"));
    MTDB_ASSIGN_OR_RETURN(const Json record, ReadTileRecord(folder_));
    metadata_ = Json::ParseObject(tiles);
    metadata_["type"] = "baselayer";
    metadata_[kTileRecord] = record;
    MTDB_ASSIGN_OR_RETURN(const Bytes bytes, Gzip(AsBytes(metadata_.Text())));
    return file_.Append(ByteSpan(bytes));
  }

  void PutHeader(uint64_t root_bytes, ByteWriter* to) const {
    to->PutBytes(AsBytes(kMagic));
    to->Put(kHeaderBytes);
    to->Put(root_bytes);
    to->Put(metadata_begin_);
    to->Put(file_.bytes_written() - metadata_begin_);
    to->Put(leaves_begin_);
    to->Put(metadata_begin_ - leaves_begin_);
    to->Put(kBeginOfTiles);
    to->Put(tile_bytes_);
    to->Put(addressed_);
    to->Put(uint64_t{entries_.size()});
    to->Put(contents_);
    for (const uint8_t byte : {uint8_t{1}, kGzip, kNone, kPng}) to->Put(byte);  // and clustered
    const auto level = [&](const char* key) {
      return static_cast<uint8_t>(CountOf(At(metadata_, key)));
    };
    const auto degrees = [&](size_t i) { return NumberOf(At(At(metadata_, "bounds"), i)); };
    const auto put = [&](double v) { to->Put(static_cast<int32_t>(std::lround(v * kDegree))); };
    to->Put(level("minzoom"));
    to->Put(level("maxzoom"));
    for (size_t i = 0; i < 4; ++i) put(degrees(i));
    to->Put(level("maxzoom"));
    for (size_t i = 0; i < 2; ++i) put((degrees(i) + degrees(i + 2)) / 2);
  }

  const std::string folder_;
  AtomicFile& file_;
  std::vector<DirectoryEntry> entries_;
  std::unordered_map<std::string, uint64_t> small_;  // bytes -> offset
  uint64_t tile_bytes_ = 0, addressed_ = 0, contents_ = 0, leaves_begin_ = 0, metadata_begin_ = 0;
  Json metadata_;
};

class PmtilesFiles final : public TileFiles {
 public:
  explicit PmtilesFiles(std::string path) : path_(std::move(path)) {}

  Status Open() {
    MTDB_ASSIGN_OR_RETURN(const Bytes header, ReadPiece(path_, 0, kHeaderBytes));
    if (!AsString(header).starts_with(kMagic))
      return Corrupt(path_ + ": is no PMTiles of version 3");
    ByteReader from(ByteSpan(header).subspan(kMagic.size()));
    const auto root = from.Get<uint64_t>(), root_bytes = from.Get<uint64_t>();
    const auto metadata = from.Get<uint64_t>(), metadata_bytes = from.Get<uint64_t>();
    leaves_ = from.Get<uint64_t>();
    from.Get<uint64_t>();
    tiles_ = from.Get<uint64_t>();
    MTDB_ASSIGN_OR_RETURN(root_, DirectoryAt(root, root_bytes));
    MTDB_ASSIGN_OR_RETURN(const Bytes packed, ReadPiece(path_, metadata, metadata_bytes));
    MTDB_ASSIGN_OR_RETURN(const Bytes text, Gunzip(packed, kMostDirectoryBytes));
    metadata_ = Json::ParseObject(AsString(text));
    return metadata_.is_object() ? Status::Ok() : Corrupt(path_ + ": its metadata is no JSON");
  }

  Result<std::string> Read(const std::string& name) const override {
    if (name == "tiles.json") return metadata_.Text();
    if (name == kTileRecord && metadata_.contains(kTileRecord))
      return metadata_[kTileRecord].Text();
    const std::optional<uint64_t> id = IdOf(name);
    if (!id) return NotFound("is not in the archive");
    std::vector<DirectoryEntry> leaf;
    const std::vector<DirectoryEntry>* directory = &root_;
    for (int depth = 0; depth < 3; ++depth) {
      auto at = std::upper_bound(directory->begin(), directory->end(), *id,
                                 [](uint64_t i, const DirectoryEntry& e) { return i < e.id; });
      if (at == directory->begin()) break;
      const DirectoryEntry& e = *--at;
      if (e.run > 0) {
        if (*id - e.id >= e.run) break;
        MTDB_ASSIGN_OR_RETURN(const Bytes tile, ReadPiece(path_, tiles_ + e.offset, e.bytes));
        return std::string(AsString(tile));
      }
      MTDB_ASSIGN_OR_RETURN(leaf, DirectoryAt(leaves_ + e.offset, e.bytes));
      directory = &leaf;
    }
    return NotFound("is not in the archive");
  }

 private:
  Result<std::vector<DirectoryEntry>> DirectoryAt(uint64_t offset, uint64_t bytes) const {
    MTDB_ASSIGN_OR_RETURN(const Bytes packed, ReadPiece(path_, offset, bytes));
    return DecodeDirectory(packed);
  }

  const std::string path_;
  std::vector<DirectoryEntry> root_;
  uint64_t leaves_ = 0, tiles_ = 0;
  Json metadata_;
};

}  // namespace

uint64_t PmtilesId(uint32_t level, uint32_t x, uint32_t y) {
  uint64_t id = ((uint64_t{1} << (2 * level)) - 1) / 3;
  for (uint32_t side = level; side-- > 0;) {
    const uint32_t s = 1u << side, right = x >> side & 1, down = y >> side & 1;
    id += uint64_t{s} * s * ((3 * right) ^ down);
    x &= s - 1;
    y &= s - 1;
    if (down == 0) {
      if (right == 1) {
        x = s - 1 - x;
        y = s - 1 - y;
      }
      std::swap(x, y);
    }
  }
  return id;
}

Status PackPmtiles(const std::string& folder, const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  return PmtilesWriter(folder, file.get()).Run();
}

Result<std::unique_ptr<TileFiles>> OpenPmtiles(const std::string& path) {
  auto files = std::make_unique<PmtilesFiles>(path);
  MTDB_RETURN_IF_ERROR(files->Open());
  return std::unique_ptr<TileFiles>(std::move(files));
}

}  // namespace mtdb
