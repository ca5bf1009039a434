// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "store/base/hash.h"
#include "store/base/out_of_memory.h"
#include "store/internal/packed_format.h"
#include "store/packed_file.h"

namespace mtdb {

using namespace internal;
namespace {

constexpr uint32_t kLeastRowsPerPage = 64;
constexpr uint32_t kMostPages = 512;
constexpr size_t kUnitsAtOnce = 64;

// What lies in the file: a page, or the payload of a unit.
struct Item {
  bool is_page = false;
  uint32_t id = 0;
};

// One object's part of the file.
class Layout {
 public:
  Layout(ClusterSource& source, uint64_t ordinal) : source_(source), index_(source.index()) {
    object_.record = source.record();
    object_.record.id = ObjectId{ordinal + 1};
    object_.rows_per_page = kLeastRowsPerPage;
    while (object_.units() / object_.rows_per_page >= kMostPages) object_.rows_per_page *= 2;
    object_.pages.resize((object_.units() + object_.rows_per_page - 1) / object_.rows_per_page);
  }

  // Order and sizes, which do not depend on where the object lies.
  Status Arrange() {
    if (object_.units() != index_.unit_count() || object_.units() == 0) {
      return InvalidArgument("object " + object_.record.name + ": its index has no units");
    }
    for (UnitId u = 0; u < index_.unit_count(); ++u) {
      if (!index_.Has(u)) {
        return InvalidArgument("object " + object_.record.name + ": its index is not whole");
      }
    }
    OrderItems();
    uint64_t bytes = 0;
    offsets_.resize(index_.unit_count());
    for (uint32_t p = 0; p < object_.pages.size(); ++p) {
      Describe(p);
      object_.pages[p].bytes = static_cast<uint32_t>(EncodePage(p).size());
      bytes += object_.pages[p].bytes;
    }
    for (UnitId u = 0; u < index_.unit_count(); ++u) bytes += index_.location(u).length;
    object_.record.stored_bytes = bytes;
    return Status::Ok();
  }

  void Place(uint64_t start, uint64_t picture_end) {
    object_.start = start;
    uint64_t at = start;
    uint32_t pieces_left = index_.root_piece_count();
    for (const Item& item : items_) {
      if (item.is_page) {
        object_.pages[item.id].offset = at;
      } else {
        offsets_[item.id] = at;
      }
      at += BytesOf(item);
      const bool is_piece = !item.is_page && item.id >= index_.cluster_count();
      if (pieces_left > 0 || at <= picture_end) object_.first_bytes = at - start;
      if (is_piece) --pieces_left;
    }
    object_.end = at;
    for (uint32_t p = 0; p < object_.pages.size(); ++p) {
      object_.pages[p].checksum = Hash64(EncodePage(p), PageSeed(object_, p));
    }
  }

  Status Write(const AppendBytes& append) {
    for (size_t i = 0; i < items_.size();) {
      if (items_[i].is_page) {
        MTDB_RETURN_IF_ERROR(append(EncodePage(items_[i].id)));
        ++i;
        continue;
      }
      std::vector<UnitId> units;
      for (; i < items_.size() && !items_[i].is_page && units.size() < kUnitsAtOnce; ++i) {
        if (!units.empty() && items_[i].id != units.back() + 1) break;  // the next round
        units.push_back(items_[i].id);
      }
      MTDB_RETURN_IF_ERROR(WritePayloads(units, append));
    }
    return Status::Ok();
  }

  PackedObject& object() { return object_; }

 private:
  void OrderItems() {
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
        for (const UnitId c : index_.children(u)) {
          need(c);
          for (const UnitId g : index_.children(c)) need(g);
        }
        for (const uint32_t page : needed) {
          items_.push_back({true, page});
          placed[page] = true;
        }
        if (!needed.empty() || u == begin) gaps_.push_back(u);
        needed.clear();
        items_.push_back({false, u});
      }
      end = begin;
    }
    std::ranges::sort(gaps_);
  }

  void Describe(uint32_t page_number) {
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

  Bytes EncodePage(uint32_t page) const {
    return EncodePackedPage(
        index_, object_, page, [&](UnitId u) { return std::ranges::binary_search(gaps_, u); },
        [&](UnitId u) { return offsets_[u]; });
  }

  uint64_t BytesOf(const Item& item) const {
    return item.is_page ? object_.pages[item.id].bytes : index_.location(item.id).length;
  }

  // Answers may come in any order.
  Status WritePayloads(const std::vector<UnitId>& units, const AppendBytes& append) {
    std::vector<Bytes> payloads(units.size());
    MTDB_RETURN_IF_ERROR(ReadUnits(source_, units, [&](UnitId unit, Bytes payload) {
      payloads[unit - units.front()] = std::move(payload);
      return Status::Ok();
    }));
    for (const Bytes& payload : payloads) MTDB_RETURN_IF_ERROR(append(payload));
    return Status::Ok();
  }

  ClusterSource& source_;
  const ClusterIndex& index_;
  PackedObject object_;
  std::vector<Item> items_;
  std::vector<UnitId> gaps_;  // units whose payloads do not follow those before
  std::vector<uint64_t> offsets_;
};

std::string HexOf(uint64_t value) {
  std::string hex(16, '0');
  for (size_t i = 16; i-- > 0; value >>= 4) hex[i] = "0123456789abcdef"[value & 15];
  return hex;
}

Result<PackReport> Pack(std::span<const std::shared_ptr<ClusterSource>> sources,
                        const AppendBytes& append) {
  if (sources.empty()) return InvalidArgument("a packed file needs an object");
  std::vector<Layout> layouts;
  layouts.reserve(sources.size());
  std::vector<PackedObject> objects;
  for (const auto& source : sources) {
    Layout& layout = layouts.emplace_back(*source, layouts.size());
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
  for (size_t i = 0; i < layouts.size(); ++i) {
    layouts[i].Place(start, (i == 0 ? 0 : start) + kPackedFirstRead);
    start = layouts[i].object().end;
    objects[i] = layouts[i].object();
  }
  const Bytes directory = EncodePackedDirectory(objects);
  MTDB_CHECK(directory.size() == header.directory_bytes, "its size does not depend on places");
  header.file_bytes = start;
  header.first_bytes = objects[0].start + objects[0].first_bytes;
  SetContentHash(directory, &header);
  MTDB_RETURN_IF_ERROR(append(EncodePackedHeader(header)));
  MTDB_RETURN_IF_ERROR(append(directory));
  for (Layout& layout : layouts) MTDB_RETURN_IF_ERROR(layout.Write(append));
  return PackReport{header.file_bytes, header.first_bytes,
                    HexOf(header.hash_high) + HexOf(header.hash_low)};
}

}  // namespace

Result<PackReport> PackObjects(std::span<const std::shared_ptr<ClusterSource>> sources,
                               const AppendBytes& append) {
  return CatchOutOfMemory([&] { return Pack(sources, append); });
}

}  // namespace mtdb
