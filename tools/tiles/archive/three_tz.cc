// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/archive/three_tz.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>
#include <zlib.h>

#include "codecs/mesh_file/atomic_file.h"
#include "tools/request/read_file.h"
#include "tools/tiles/archive/md5.h"
#include "tools/tiles/file_piece.h"
#include "tools/tiles/tile_folder.h"

namespace mtdb {

namespace {

constexpr char kIndexName[] = "@3dtilesIndex1@";
// Signatures and sizes of a zip file's records (APPNOTE 6.3).
constexpr uint32_t kLocal = 0x04034b50, kCentral = 0x02014b50, kEnd = 0x06054b50;
constexpr uint32_t kEnd64 = 0x06064b50, kLocator64 = 0x07064b50;
constexpr uint64_t kLocalBytes = 30, kCentralBytes = 46, kEndBytes = 22, kEnd64Bytes = 56;
constexpr uint64_t kLocator64Bytes = 20;
constexpr uint16_t kVersion = 45, kNamesAreUtf8 = 1 << 11, kStored = 0,
                   kDate = (0 << 9) | (1 << 5) | 1;
constexpr uint16_t kExtra64 = 1;
constexpr uint32_t kMost32 = std::numeric_limits<uint32_t>::max();
constexpr uint16_t kMost16 = std::numeric_limits<uint16_t>::max();

struct Member {
  std::string name;
  uint32_t crc = 0, bytes = 0;
  uint64_t offset = 0;  // of its local header
};

struct IndexEntry {
  uint64_t high = 0, low = 0, offset = 0;  // the hash as two little-endian numbers
  bool operator<(const IndexEntry& other) const {
    return std::pair(high, low) < std::pair(other.high, other.low);
  }
};

IndexEntry EntryOf(const std::string& name, uint64_t offset) {
  const std::array<uint8_t, 16> hash = Md5(name);
  IndexEntry entry;
  entry.offset = offset;
  std::memcpy(&entry.high, hash.data(), 8);
  std::memcpy(&entry.low, hash.data() + 8, 8);
  return entry;
}

uint32_t Crc(ByteSpan bytes) {
  return static_cast<uint32_t>(
      ::crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

// What local and central headers have in common.
void PutCommon(const Member& member, ByteWriter* to) {
  to->Put(kVersion);
  to->Put(kNamesAreUtf8);
  to->Put(kStored);
  to->Put(uint16_t{0});  // the time
  to->Put(kDate);
  to->Put(member.crc);
  to->Put(member.bytes);
  to->Put(member.bytes);
  to->Put(static_cast<uint16_t>(member.name.size()));
}

class ZipWriter {
 public:
  explicit ZipWriter(AtomicFile* file) : file_(*file) {}

  Status Add(const std::string& name, ByteSpan bytes) {
    Member member{name, 0, static_cast<uint32_t>(bytes.size()), file_.bytes_written()};
    member.crc = Crc(bytes);
    ByteWriter header;
    header.Put(kLocal);
    PutCommon(member, &header);
    header.Put(uint16_t{0});  // no extra field
    header.PutBytes(AsBytes(name));
    MTDB_RETURN_IF_ERROR(file_.Append(header.bytes()));
    members_.push_back(std::move(member));
    return file_.Append(bytes);
  }

  Status AddIndex() {
    std::vector<IndexEntry> entries;
    for (const Member& member : members_) entries.push_back(EntryOf(member.name, member.offset));
    std::sort(entries.begin(), entries.end());
    ByteWriter index;
    for (const IndexEntry& entry : entries) {
      for (const uint64_t number : {entry.high, entry.low, entry.offset}) index.Put(number);
    }
    return Add(kIndexName, index.bytes());
  }

  Status End() {
    const uint64_t begin = file_.bytes_written();
    for (const Member& member : members_) MTDB_RETURN_IF_ERROR(file_.Append(Central(member)));
    const uint64_t end = file_.bytes_written(), count = members_.size();
    if (begin >= kMost32 || count >= kMost16) {
      MTDB_RETURN_IF_ERROR(file_.Append(ByteSpan(End64(begin, end))));
    }
    ByteWriter to;
    to.Put(kEnd);
    for (int i = 0; i < 2; ++i) to.Put(uint16_t{0});  // of several disks
    for (int i = 0; i < 2; ++i) to.Put(static_cast<uint16_t>(std::min<uint64_t>(count, kMost16)));
    to.Put(static_cast<uint32_t>(std::min<uint64_t>(end - begin, kMost32)));
    to.Put(static_cast<uint32_t>(std::min<uint64_t>(begin, kMost32)));
    to.Put(uint16_t{0});  // no comment
    MTDB_RETURN_IF_ERROR(file_.Append(to.bytes()));
    return file_.Commit();
  }

 private:
  static Bytes Central(const Member& member) {
    const bool is_far = member.offset >= kMost32;
    ByteWriter to;
    to.Put(kCentral);
    to.Put(kVersion);
    PutCommon(member, &to);
    to.Put(static_cast<uint16_t>(is_far ? 12 : 0));   // of the extra field
    for (int i = 0; i < 3; ++i) to.Put(uint16_t{0});  // comment, disk, attributes
    to.Put(uint32_t{0});
    to.Put(is_far ? kMost32 : static_cast<uint32_t>(member.offset));
    to.PutBytes(AsBytes(member.name));
    if (is_far) {
      to.Put(kExtra64);
      to.Put(uint16_t{8});
      to.Put(member.offset);
    }
    return to.Take();
  }

  Bytes End64(uint64_t begin, uint64_t end) const {
    const uint64_t count = members_.size();
    constexpr uint64_t kVersions = uint64_t{kVersion} << 16 | kVersion;
    ByteWriter to;
    to.bytes().reserve(kEnd64Bytes + kLocator64Bytes);
    to.Put(kEnd64);
    to.Put(kEnd64Bytes - 12);
    to.Put(static_cast<uint32_t>(kVersions));
    to.Put(uint64_t{0});  // of several disks
    to.Put(count);
    to.Put(count);
    to.Put(end - begin);
    to.Put(begin);
    to.Put(kLocator64);
    to.Put(uint32_t{0});
    to.Put(end);
    to.Put(uint32_t{1});
    return to.Take();
  }

  AtomicFile& file_;
  std::vector<Member> members_;
};

class ThreeTzFiles final : public TileFiles {
 public:
  ThreeTzFiles(std::string path, std::vector<IndexEntry> index)
      : path_(std::move(path)), index_(std::move(index)) {}

  Result<std::string> Read(const std::string& name) const override {
    const IndexEntry wanted = EntryOf(name, 0);
    for (auto at = std::lower_bound(index_.begin(), index_.end(), wanted);
         at != index_.end() && !(wanted < *at); ++at) {
      MTDB_ASSIGN_OR_RETURN(const Bytes header, ReadPiece(path_, at->offset, kLocalBytes));
      ByteReader from(header);
      const bool is_local = from.Get<uint32_t>() == kLocal;
      from.GetBytes(4);
      const auto method = from.Get<uint16_t>();
      from.GetBytes(4);
      const auto crc = from.Get<uint32_t>();
      const auto packed = from.Get<uint32_t>(), bytes = from.Get<uint32_t>();
      const auto name_bytes = from.Get<uint16_t>(), extra = from.Get<uint16_t>();
      if (!is_local || method != kStored || packed != bytes) {
        return Corrupt("is not stored as it is where the index says");
      }
      MTDB_ASSIGN_OR_RETURN(const Bytes found,
                            ReadPiece(path_, at->offset + kLocalBytes, name_bytes));
      if (AsString(found) != name) continue;
      MTDB_ASSIGN_OR_RETURN(const Bytes content,
                            ReadPiece(path_, at->offset + kLocalBytes + name_bytes + extra, bytes));
      if (Crc(content) != crc) return Corrupt("is not what its checksum says");
      return std::string(AsString(content));
    }
    return NotFound("is not in the archive");
  }

 private:
  const std::string path_;
  const std::vector<IndexEntry> index_;
};

// Where the file's last record begins, and the index's offset of it.
Result<Bytes> ReadIndex(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const uint64_t size, FileBytes(path));
  if (size < kEndBytes) return Corrupt(path + ": is no .3tz");
  // The central header of the index is right before the end's records.
  const uint64_t tail = std::min(size, kCentralBytes + sizeof(kIndexName) - 1 + 12 + kEnd64Bytes +
                                           kLocator64Bytes + kEndBytes);
  MTDB_ASSIGN_OR_RETURN(const Bytes text, ReadPiece(path, size - tail, tail));
  const size_t name = AsString(text).rfind(kIndexName);
  if (name == std::string_view::npos || name < kCentralBytes)
    return Corrupt(path + ": has no index of tiles");
  ByteReader from(ByteSpan(text).subspan(name - kCentralBytes));
  if (from.Get<uint32_t>() != kCentral) return Corrupt(path + ": has no index of tiles");
  from.GetBytes(20);
  const auto bytes = from.Get<uint32_t>();
  from.GetBytes(14);
  uint64_t offset = from.Get<uint32_t>();
  from.GetBytes(sizeof(kIndexName) - 1);
  if (offset == kMost32) {
    from.GetBytes(4);
    offset = from.Get<uint64_t>();
  }
  return ReadPiece(path, offset + kLocalBytes + sizeof(kIndexName) - 1, bytes);
}

}  // namespace

Status PackThreeTz(const std::string& folder, const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  ZipWriter zip(file.get());
  for (const std::string& name : ListTileFiles(folder)) {
    MTDB_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(folder + "/" + name));
    MTDB_RETURN_IF_ERROR(zip.Add(name, AsBytes(bytes)));
  }
  MTDB_RETURN_IF_ERROR(zip.AddIndex());
  return zip.End();
}

Result<std::unique_ptr<TileFiles>> OpenThreeTz(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const Bytes text, ReadIndex(path));
  ByteReader from(text);
  std::vector<IndexEntry> index(text.size() / sizeof(IndexEntry));
  for (IndexEntry& entry : index) {
    entry.high = from.Get<uint64_t>();
    entry.low = from.Get<uint64_t>();
    entry.offset = from.Get<uint64_t>();
  }
  if (!std::is_sorted(index.begin(), index.end()))
    return Corrupt(path + ": its index is not sorted");
  return std::unique_ptr<TileFiles>(std::make_unique<ThreeTzFiles>(path, std::move(index)));
}

}  // namespace mtdb
