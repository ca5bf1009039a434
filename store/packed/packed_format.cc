// SPDX-License-Identifier: Apache-2.0
#include "store/packed/packed_format.h"

#include <algorithm>
#include <array>
#include <set>

#include "store/records/index_row.h"
#include "store/records/keys.h"
#include "store/texture_pages.h"

namespace mtdb::internal {
namespace {

constexpr uint32_t kVersion = 2;
constexpr uint8_t kGivenOffset = 0x02;  // of a row's flags
constexpr std::array<char, 16> kMagic{'m', 't', 'd', 'b', ' ', 'p', 'a', 'c', 'k', 'e', 'd'};
constexpr size_t kCheckedBytes = kPackedHeaderBytes - sizeof(uint64_t);
constexpr uint32_t kMaxRowsPerPage = 1 << 20;
constexpr uint32_t kMaxPageBytes = 1 << 28;
// The least bytes of a row, and of a page's entry in the directory.
constexpr uint64_t kMinRowBytes = 26;
constexpr uint64_t kMinPageEntryBytes = 26;

uint64_t ContentHash(ByteSpan directory, int d) { return Hash64(directory, MixAll('P', d)); }

std::string PlaceOf(const PackedObject& object, uint32_t page, const std::string& where) {
  return where + ": index page " + std::to_string(page) + ", offset " +
         std::to_string(object.pages[page].offset) + " of the file";
}

// Reads the entry of one object.
class DirectoryReader {
 public:
  DirectoryReader(ByteReader* r, const std::string& where) : r_(*r), where_(where) {}

  Result<PackedObject> Read(uint64_t start, uint64_t file_bytes) {
    PackedObject object;
    const ByteSpan record = r_.GetBytes(r_.GetVarint());
    MTDB_ASSIGN_OR_RETURN(object.record, DecodeObjectRecord(record, where_ + ": object record"));
    object.start = r_.Get<uint64_t>();
    object.first_bytes = r_.Get<uint64_t>();
    const uint64_t rows = r_.GetVarint();
    if (r_.failed()) return Bad("directory", "cut off");
    if (object.start != start || object.record.stored_bytes > file_bytes - start) {
      return Bad("object " + object.record.name, "does not lie behind the one before");
    }
    object.end = start + object.record.stored_bytes;
    const uint64_t texture_bytes = TextureBytes(object.record);
    if (texture_bytes > object.record.stored_bytes) {
      return Bad("object " + object.record.name, "its texture is larger than the object");
    }
    object.textures = object.end - texture_bytes;
    const uint64_t units = uint64_t{object.record.clusters} + object.record.root_pieces;
    if (rows == 0 || rows > kMaxRowsPerPage || units == 0 || units >= kNone32 ||
        object.first_bytes > object.textures - start) {
      return Bad("object " + object.record.name, "impossible numbers");
    }
    object.rows_per_page = static_cast<uint32_t>(rows);
    const uint64_t pages = (units + rows - 1) / rows;
    if (pages > r_.remaining() / kMinPageEntryBytes) {
      return Bad("object " + object.record.name, "too many units");
    }
    object.pages.resize(pages);
    MTDB_RETURN_IF_ERROR(ReadPages(&object));
    return object;
  }

 private:
  Status Bad(const std::string& what, const std::string& found) const {
    return Corrupt(where_ + ": directory: " + what + ": " + found + "; get the file anew");
  }

  Status ReadPages(PackedObject* object) {
    uint64_t vertex = object->record.root_vertices;
    Vec3i previous_min;
    for (uint32_t p = 0; p < object->pages.size(); ++p) {
      PackedPage& page = object->pages[p];
      page.offset = r_.Get<uint64_t>();
      const uint64_t bytes = r_.GetVarint();
      page.checksum = r_.Get<uint64_t>();
      page.nodes = r_.GetVarint();
      page.error_code_min = r_.Get<uint8_t>();
      page.error_code_max = r_.Get<uint8_t>();
      const bool bounded = ReadBounds(previous_min, &page.bounds);
      previous_min = page.bounds.min;
      if (r_.failed() || !bounded || page.offset < object->start ||
          page.offset > object->textures || bytes > object->textures - page.offset ||
          bytes > kMaxPageBytes || bytes < kMinRowBytes * object->rows(p) ||
          page.error_code_min > page.error_code_max || page.nodes > object->record.nodes) {
        return Bad("object " + object->record.name, "page " + std::to_string(p) + " is impossible");
      }
      page.bytes = static_cast<uint32_t>(bytes);
      page.first_vertex = vertex;
      vertex += page.nodes;
      if (vertex > object->record.vertex_numbers()) break;
    }
    if (vertex != object->record.vertex_numbers()) {
      return Bad("object " + object->record.name, "its pages have other vertices than its record");
    }
    return Status::Ok();
  }

  bool ReadBounds(const Vec3i& previous, Box3i* bounds) {
    bool ok = true;
    const auto fits = [](int64_t v) { return v >= INT32_MIN && v <= INT32_MAX; };
    constexpr int64_t kSpan = int64_t{1} << 33;
    for (int i = 0; i < 3; ++i) {
      const int64_t delta = r_.GetSignedVarint();
      ok = ok && delta > -kSpan && delta < kSpan && fits(previous[i] + delta);
      bounds->min[i] = ok ? static_cast<int32_t>(previous[i] + delta) : 0;
    }
    for (int i = 0; i < 3; ++i) {
      const uint64_t extent = r_.GetVarint();
      ok = ok && extent <= UINT32_MAX && fits(bounds->min[i] + static_cast<int64_t>(extent));
      bounds->max[i] = ok ? static_cast<int32_t>(bounds->min[i] + static_cast<int64_t>(extent)) : 0;
    }
    return ok;
  }

  ByteReader& r_;
  const std::string& where_;
};

bool Contains(const Box3i& outer, const Box3i& inner) {
  for (int i = 0; i < 3; ++i) {
    if (inner.min[i] < outer.min[i] || inner.max[i] > outer.max[i]) return false;
  }
  return true;
}

PackedRow DecodeRow(const PackedObject& object, UnitId unit, const UnitEntry& previous,
                    uint64_t* end, RowReader* r) {
  PackedRow row;
  uint8_t flags = 0;
  row.entry = r->GetEntry(kGivenOffset, previous, &flags);
  const uint32_t clusters = object.record.clusters;
  if ((row.entry.nodes > 0) != (unit < clusters)) r->Fail("nodes", row.entry.nodes);
  row.bytes = r->GetLength();
  row.checksum = r->GetChecksum();
  row.offset = (flags & kGivenOffset) != 0 ? r->GetOffset() : *end;
  if (row.offset < object.start || row.offset > object.textures ||
      row.bytes > object.textures - row.offset) {
    r->Fail("offset of the payload", row.offset);
  }
  *end = row.offset + row.bytes;
  row.children = r->GetChildren(std::min(unit, clusters));
  row.parents = r->GetParents(unit, object.units());
  row.error_code_below = r->GetCode();
  if (row.children.empty() && row.error_code_below != 0) {
    r->Fail("error code of the children", row.error_code_below);
  }
  if (unit >= clusters && !row.parents.empty()) r->Fail("number of parents", row.parents.size());
  return row;
}

}  // namespace

bool IsPackedMagic(ByteSpan bytes) {
  return bytes.size() >= kMagic.size() &&
         std::equal(kMagic.begin(), kMagic.end(), bytes.begin(),
                    [](char a, std::byte b) { return std::byte(a) == b; });
}

Bytes EncodePackedHeader(const PackedHeader& header) {
  ByteWriter w;
  w.PutBytes(AsBytes(std::string_view(kMagic.data(), kMagic.size())));
  w.Put(kVersion);
  w.Put(uint32_t{0});
  w.Put(header.file_bytes);
  w.Put(header.directory_bytes);
  w.Put(header.first_bytes);
  w.Put(header.hash_low);
  w.Put(header.hash_high);
  w.Put(Hash64(w.bytes(), MixAll('H')));
  return w.Take();
}

Result<PackedHeader> DecodePackedHeader(ByteSpan bytes, uint64_t file_bytes,
                                        const std::string& where) {
  if (!IsPackedMagic(bytes)) {
    return Corrupt(where + ": expected a packed file (mtdb pack), found something else");
  }
  if (bytes.size() < kPackedHeaderBytes) {
    return Corrupt(where + ": the file ends within its header; get it anew");
  }
  ByteReader r(bytes.subspan(kMagic.size()));
  const auto version = r.Get<uint32_t>();
  const auto flags = r.Get<uint32_t>();
  PackedHeader header;
  header.file_bytes = r.Get<uint64_t>();
  header.directory_bytes = r.Get<uint64_t>();
  header.first_bytes = r.Get<uint64_t>();
  header.hash_low = r.Get<uint64_t>();
  header.hash_high = r.Get<uint64_t>();
  const auto checksum = r.Get<uint64_t>();
  if (checksum != Hash64(bytes.first(kCheckedBytes), MixAll('H'))) {
    return Corrupt(where + ": header: its checksum is wrong; get the file anew");
  }
  if (version != kVersion || flags != 0) {
    return Unsupported(where + ": a packed file of version " + std::to_string(version) +
                       ", flags " + std::to_string(flags) + "; this mtdb reads version " +
                       std::to_string(kVersion) + " without flags");
  }
  if (header.file_bytes != file_bytes) {
    return Corrupt(where + ": expected " + std::to_string(header.file_bytes) + " bytes, found " +
                   std::to_string(file_bytes) + "; it was cut off or appended to: get it anew");
  }
  if (header.directory_bytes == 0 || header.directory_bytes > file_bytes - kPackedHeaderBytes ||
      header.directory_bytes > kMaxDirectoryBytes ||
      header.first_bytes < kPackedHeaderBytes + header.directory_bytes ||
      header.first_bytes > file_bytes) {
    return Corrupt(where + ": header: impossible numbers");
  }
  return header;
}

void SetContentHash(ByteSpan directory, PackedHeader* header) {
  header->hash_low = ContentHash(directory, 1);
  header->hash_high = ContentHash(directory, 2);
}

Bytes EncodePackedDirectory(const std::vector<PackedObject>& objects) {
  ByteWriter w;
  w.PutVarint(objects.size());
  for (const PackedObject& object : objects) {
    const Bytes record = EncodeObjectRecord(object.record);
    w.PutVarint(record.size());
    w.PutBytes(record);
    w.Put(object.start);
    w.Put(object.first_bytes);
    w.PutVarint(object.rows_per_page);
    Vec3i previous_min;
    for (const PackedPage& page : object.pages) {
      w.Put(page.offset);
      w.PutVarint(page.bytes);
      w.Put(page.checksum);
      w.PutVarint(page.nodes);
      w.Put(page.error_code_min);
      w.Put(page.error_code_max);
      PutBounds(page.bounds, previous_min, &w);
      previous_min = page.bounds.min;
    }
  }
  return w.Take();
}

Result<std::vector<PackedObject>> DecodePackedDirectory(ByteSpan bytes, const PackedHeader& header,
                                                        const std::string& where) {
  if (ContentHash(bytes, 1) != header.hash_low || ContentHash(bytes, 2) != header.hash_high) {
    return Corrupt(where + ": directory: its checksum is wrong; get the file anew");
  }
  ByteReader r(bytes);
  const uint64_t count = r.GetVarint();
  std::vector<PackedObject> objects;
  std::set<std::string> names;
  uint64_t start = kPackedHeaderBytes + header.directory_bytes;
  for (uint64_t i = 0; i < count && !r.failed(); ++i) {
    MTDB_ASSIGN_OR_RETURN(PackedObject object,
                          DirectoryReader(&r, where).Read(start, header.file_bytes));
    start = object.end;
    if (object.record.id != ObjectId{i + 1} || !names.insert(object.record.name).second) {
      return Corrupt(where + ": directory: object " + object.record.name + " is there twice");
    }
    objects.push_back(std::move(object));
  }
  if (count == 0 || r.failed() || r.remaining() != 0 || start != header.file_bytes ||
      header.first_bytes != objects[0].start + objects[0].first_bytes) {
    return Corrupt(where + ": directory: it does not tell of the whole file");
  }
  return objects;
}

uint64_t PageSeed(const PackedObject& object, uint32_t page) {
  return MixAll('G', object.record.id.value, page);
}

Bytes EncodePackedPage(const ClusterIndex& index, const PackedObject& object, uint32_t page,
                       const std::function<bool(UnitId)>& gap_before,
                       const std::function<uint64_t(UnitId)>& offset_of) {
  ByteWriter w;
  UnitEntry previous;
  previous.bounds.min = {};
  const UnitId first = object.first_unit(page);
  for (UnitId u = first; u < first + object.rows(page); ++u) {
    const UnitEntry& e = index.unit(u);
    const PayloadLocation& location = index.location(u);
    const bool given = u == first || gap_before(u);
    PutRowEntry(given ? kGivenOffset : 0, e, previous, &w);
    w.PutVarint(location.length);
    w.Put(location.checksum);
    if (given) w.Put(offset_of(u));
    PutChildren(index.children(u), std::min(u, index.cluster_count()), &w);
    const auto parents = index.parents(u);
    w.PutVarint(parents.size());
    uint32_t next = u + 1;
    for (const UnitId p : parents) {
      w.PutVarint(p - next);
      next = p + 1;
    }
    w.Put(index.error_code_below(u));
    previous = e;
  }
  return w.Take();
}

uint64_t PackedObject::texture_file(uint32_t file) const {
  uint64_t offset = textures;
  for (uint32_t i = 0, files = record.texture->files(); TextureFileAt(files, i) != file; ++i) {
    offset += record.texture->file(TextureFileAt(files, i)).bytes;
  }
  return offset;
}

Result<std::vector<PackedRow>> DecodePackedPage(ByteSpan bytes, const PackedObject& object,
                                                uint32_t page, const std::string& where) {
  const std::string place = PlaceOf(object, page, where);
  const PackedPage& entry = object.pages[page];
  if (Hash64(bytes, PageSeed(object, page)) != entry.checksum) {
    return Corrupt(place + ": its checksum is wrong; get the file anew");
  }
  RowReader r(bytes, place);
  std::vector<PackedRow> rows;
  rows.reserve(object.rows(page));
  UnitEntry previous;
  uint64_t end = 0;
  uint64_t nodes = 0;
  const UnitId first = object.first_unit(page);
  for (uint32_t i = 0; i < object.rows(page) && r.ok(); ++i) {
    PackedRow row = DecodeRow(object, first + i, previous, &end, &r);
    const UnitEntry& e = row.entry;
    if (!Contains(entry.bounds, e.bounds)) r.Fail("bounds of unit", first + i);
    if (e.nodes > 0 &&
        (e.error_code_min < entry.error_code_min || e.error_code_max > entry.error_code_max)) {
      r.Fail("error codes of unit", first + i);
    }
    nodes += e.nodes;
    previous = e;
    rows.push_back(std::move(row));
  }
  if (r.ok() && nodes != entry.nodes) r.Fail("nodes", nodes);
  MTDB_RETURN_IF_ERROR(r.Finish());
  return rows;
}

}  // namespace mtdb::internal
