// SPDX-License-Identifier: Apache-2.0
#include "store/packed/packed_layout.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <set>
#include <utility>

#include "store/base/hash.h"
#include "store/carriers/url_carriers.h"
#include "store/records/page_parts.h"
#include "store/texture_pages.h"

namespace mtdb::internal {

namespace {

constexpr uint32_t kLeastRowsPerPage = 64;
constexpr uint32_t kMostPages = 512;
constexpr size_t kUnitsAtOnce = 64;
// Whole values of a store, so that no byte is read twice.
constexpr uint64_t kTextureBytesAtOnce = 4 * uint64_t{kPagePartBytes};

std::string HexOf(uint64_t value) {
  std::string hex(16, '0');
  for (size_t i = 16; i-- > 0; value >>= 4) hex[i] = "0123456789abcdef"[value & 15];
  return hex;
}

}  // namespace

PackedLayout::PackedLayout(ClusterSource& source, uint64_t ordinal)
    : source_(source), index_(source.index()) {
  object_.record = source.record();
  object_.record.id = ObjectId{ordinal + 1};
  object_.rows_per_page = kLeastRowsPerPage;
  while (object_.units() / object_.rows_per_page >= kMostPages) object_.rows_per_page *= 2;
  object_.pages.resize((object_.units() + object_.rows_per_page - 1) / object_.rows_per_page);
}

Status PackedLayout::Arrange() {
  if (object_.units() != index_.unit_count() || object_.units() == 0) {
    return InvalidArgument("object " + object_.record.name + ": its index has no units");
  }
  for (UnitId u = 0; u < index_.unit_count(); ++u) {
    if (!index_.Has(u)) {
      return InvalidArgument("object " + object_.record.name + ": its index is not whole");
    }
  }
  OrderItems();
  AddTextureParts();
  uint64_t bytes = 0;
  offsets_.resize(index_.unit_count());
  for (uint32_t p = 0; p < object_.pages.size(); ++p) {
    Describe(p);
    object_.pages[p].bytes = static_cast<uint32_t>(EncodePage(p).size());
    bytes += object_.pages[p].bytes;
  }
  for (UnitId u = 0; u < index_.unit_count(); ++u) bytes += index_.location(u).length;
  bytes += TextureBytes(object_.record);
  object_.record.stored_bytes = bytes;
  return Status::Ok();
}

void PackedLayout::Place(uint64_t start, uint64_t picture_end) {
  object_.start = start;
  uint64_t at = start;
  uint32_t pieces_left = index_.root_piece_count();
  for (const Item& item : items_) {
    switch (item.kind) {
      case Item::Kind::kPage: object_.pages[item.id].offset = at; break;
      case Item::Kind::kPayload: offsets_[item.id] = at; break;
      case Item::Kind::kTexture: texture_parts_[item.id].offset = at; break;
    }
    at += BytesOf(item);
    if (item.kind == Item::Kind::kTexture) continue;
    object_.textures = at;
    const bool is_piece = item.kind == Item::Kind::kPayload && item.id >= index_.cluster_count();
    if (pieces_left > 0 || at <= picture_end) object_.first_bytes = at - start;
    if (is_piece) --pieces_left;
  }
  object_.end = at;
  for (uint32_t p = 0; p < object_.pages.size(); ++p) {
    object_.pages[p].checksum = Hash64(EncodePage(p), PageSeed(object_, p));
  }
}

Status PackedLayout::Write(const AppendBytes& append) const {
  MTDB_RETURN_IF_ERROR(WriteItems(0, items_.size() - texture_parts_.size(), append));
  if (!object_.record.texture) return Status::Ok();
  // Whole files are checked, which parts of them cannot be.
  const uint32_t files = object_.record.texture->files();
  for (uint32_t i = 0; i < files; ++i) {
    MTDB_RETURN_IF_ERROR(ReadTextureFile(source_, TextureFileAt(files, i), append));
  }
  return Status::Ok();
}

Status PackedLayout::Read(ByteRange range, Bytes* bytes) const {
  const uint64_t end = range.offset + range.bytes;
  const auto first = std::ranges::partition_point(
      items_, [&](const Item& item) { return OffsetOf(item) + BytesOf(item) <= range.offset; });
  const auto begin = static_cast<size_t>(first - items_.begin());
  size_t last = begin;
  while (last < items_.size() && OffsetOf(items_[last]) < end) ++last;
  if (begin == last) return Status::Ok();
  uint64_t at = OffsetOf(items_[begin]);
  return WriteItems(begin, last, [&](ByteSpan item) {
    const uint64_t from = std::clamp(range.offset, at, at + item.size()) - at;
    const uint64_t to = std::clamp(end, at, at + item.size()) - at;
    bytes->insert(bytes->end(), item.begin() + static_cast<ptrdiff_t>(from),
                  item.begin() + static_cast<ptrdiff_t>(to));
    at += item.size();
    return Status::Ok();
  });
}

Status PackedLayout::WriteItems(size_t begin, size_t end, const AppendBytes& append) const {
  for (size_t i = begin; i < end;) {
    if (items_[i].kind == Item::Kind::kPage) {
      MTDB_RETURN_IF_ERROR(append(EncodePage(items_[i].id)));
      ++i;
      continue;
    }
    if (items_[i].kind == Item::Kind::kTexture) {
      const TexturePart& part = texture_parts_[items_[i].id];
      MTDB_ASSIGN_OR_RETURN(const Bytes bytes,
                            source_.ReadTextureFile(part.file, part.begin, part.bytes));
      MTDB_RETURN_IF_ERROR(append(bytes));
      ++i;
      continue;
    }
    std::vector<UnitId> units;
    for (; i < end && items_[i].kind == Item::Kind::kPayload && units.size() < kUnitsAtOnce; ++i) {
      if (!units.empty() && items_[i].id != units.back() + 1) break;  // the next round
      units.push_back(items_[i].id);
    }
    MTDB_RETURN_IF_ERROR(WritePayloads(units, append));
  }
  return Status::Ok();
}

void PackedLayout::OrderItems() {
  std::vector<bool> placed(object_.pages.size());
  std::set<uint32_t, std::greater<>> needed;
  const auto need = [&](UnitId u) {
    if (!placed[object_.page_of(u)]) needed.insert(object_.page_of(u));
  };
  for (UnitId end = index_.unit_count(); end > 0;) {
    UnitId begin = end - 1;
    while (begin > 0 && index_.unit(begin - 1).round == index_.unit(begin).round) --begin;
    for (UnitId u = begin; u < end; ++u) {
      need(u);
      for (const UnitId p : index_.parents(u)) need(p);
      for (const UnitId c : index_.children(u)) need(c);
      for (const uint32_t page : needed) {
        items_.push_back({Item::Kind::kPage, page});
        placed[page] = true;
      }
      if (!needed.empty() || u == begin) gaps_.push_back(u);
      needed.clear();
      items_.push_back({Item::Kind::kPayload, u});
    }
    end = begin;
  }
  std::ranges::sort(gaps_);
}

void PackedLayout::AddTextureParts() {
  if (!object_.record.texture) return;
  const TextureRecord& texture = *object_.record.texture;
  for (uint32_t i = 0; i < texture.files(); ++i) {
    const uint32_t file = TextureFileAt(texture.files(), i);
    const uint64_t size = texture.file(file).bytes;
    for (uint64_t begin = 0; begin < size; begin += kTextureBytesAtOnce) {
      items_.push_back({Item::Kind::kTexture, static_cast<uint32_t>(texture_parts_.size())});
      const uint64_t bytes = std::min(kTextureBytesAtOnce, size - begin);
      texture_parts_.push_back({file, static_cast<uint32_t>(bytes), begin, 0});
    }
  }
}

void PackedLayout::Describe(uint32_t page_number) {
  PackedPage& page = object_.pages[page_number];
  page.error_code_min = std::numeric_limits<uint8_t>::max();
  const UnitId first = object_.first_unit(page_number);
  for (UnitId u = first; u < first + object_.rows(page_number); ++u) {
    const UnitEntry& e = index_.unit(u);
    page.nodes += e.nodes;
    page.bounds.Add(e.bounds);
    if (e.nodes == 0) continue;
    page.error_code_min = std::min(page.error_code_min, e.error_code_min);
    page.error_code_max = std::max(page.error_code_max, e.error_code_max);
  }
  if (page.nodes == 0) page.error_code_min = 0;
}

Bytes PackedLayout::EncodePage(uint32_t page) const {
  return EncodePackedPage(
      index_, object_, page, [&](UnitId u) { return std::ranges::binary_search(gaps_, u); },
      [&](UnitId u) { return offsets_[u]; });
}

uint64_t PackedLayout::BytesOf(const Item& item) const {
  switch (item.kind) {
    case Item::Kind::kPage: return object_.pages[item.id].bytes;
    case Item::Kind::kPayload: return index_.location(item.id).length;
    case Item::Kind::kTexture: break;
  }
  return texture_parts_[item.id].bytes;
}

uint64_t PackedLayout::OffsetOf(const Item& item) const {
  switch (item.kind) {
    case Item::Kind::kPage: return object_.pages[item.id].offset;
    case Item::Kind::kPayload: return offsets_[item.id];
    case Item::Kind::kTexture: break;
  }
  return texture_parts_[item.id].offset;
}

// Answers may come in any order.
Status PackedLayout::WritePayloads(const std::vector<UnitId>& units,
                                   const AppendBytes& append) const {
  std::vector<Bytes> payloads(units.size());
  MTDB_RETURN_IF_ERROR(ReadUnits(source_, units, [&](UnitId unit, Bytes payload) {
    payloads[unit - units.front()] = std::move(payload);
    return Status::Ok();
  }));
  for (const Bytes& payload : payloads) MTDB_RETURN_IF_ERROR(append(payload));
  return Status::Ok();
}

Result<PackedBeginning> PlaceObjects(std::vector<PackedLayout>* layouts) {
  std::vector<PackedObject> objects;
  for (PackedLayout& layout : *layouts) {
    MTDB_RETURN_IF_ERROR(layout.Arrange());
    objects.push_back(layout.object());
  }
  PackedHeader header;
  header.directory_bytes = EncodePackedDirectory(objects).size();
  if (header.directory_bytes > kMaxDirectoryBytes) {
    return InvalidArgument(std::to_string(objects.size()) +
                           " objects are too many for one packed file; pack them into several");
  }
  uint64_t start = kPackedHeaderBytes + header.directory_bytes;
  for (size_t i = 0; i < layouts->size(); ++i) {
    (*layouts)[i].Place(start, (i == 0 ? 0 : start) + kFirstReadBytes);
    start = (*layouts)[i].object().end;
    objects[i] = (*layouts)[i].object();
  }
  const Bytes directory = EncodePackedDirectory(objects);
  MTDB_CHECK(directory.size() == header.directory_bytes, "its size does not depend on places");
  header.file_bytes = start;
  header.first_bytes = objects[0].start + objects[0].first_bytes;
  SetContentHash(directory, &header);
  PackedBeginning beginning;
  beginning.bytes = EncodePackedHeader(header);
  beginning.bytes.insert(beginning.bytes.end(), directory.begin(), directory.end());
  beginning.content_hash = HexOf(header.hash_high) + HexOf(header.hash_low);
  beginning.header = header;
  return beginning;
}

}  // namespace mtdb::internal
