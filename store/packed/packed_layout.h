// SPDX-License-Identifier: Apache-2.0
// The order and the places of an object's pages, payloads and textures in a packed file. Layout in
// store/FORMAT.md, "The packed file".
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "store/cluster_source.h"
#include "store/packed/packed_format.h"
#include "store/packed_file.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// One object's part of the file. Some 16 bytes of memory a unit. After Place() safe for many
// threads.
class PackedLayout {
 public:
  // `source` outlives the layout; all rows of its index are there. `ordinal`: of the object in the
  // file, from 0.
  PackedLayout(ClusterSource& source, uint64_t ordinal);

  // Order and sizes, which do not depend on where the object lies. Errors: kInvalidArgument.
  Status Arrange();
  // Where it begins in the file, and where the bytes of a first picture end at best.
  void Place(uint64_t start, uint64_t picture_end);

  // All bytes, from the beginning. Errors: those of the source and of `append`.
  Status Write(const AppendBytes& append) const;
  // Adds those bytes of the object that are in `range` (of the file) to `bytes`. Errors: those of
  // the source.
  Status Read(ByteRange range, Bytes* bytes) const;

  const PackedObject& object() const { return object_; }

 private:
  // What lies in the file: a page, the payload of a unit, or a part of a file of the texture.
  struct Item {
    enum class Kind : uint8_t { kPage, kPayload, kTexture };
    Kind kind = Kind::kPage;
    uint32_t id = 0;
  };
  struct TexturePart {
    uint32_t file = 0;  // of the texture
    uint32_t bytes = 0;
    uint64_t begin = 0;   // in its file
    uint64_t offset = 0;  // in the packed file
  };
  void OrderItems();
  void AddTextureParts();
  void Describe(uint32_t page_number);
  Bytes EncodePage(uint32_t page) const;
  uint64_t BytesOf(const Item& item) const;
  uint64_t OffsetOf(const Item& item) const;
  // The items from `begin` on, and before `end`, in their order.
  Status WriteItems(size_t begin, size_t end, const AppendBytes& append) const;
  Status WritePayloads(const std::vector<UnitId>& units, const AppendBytes& append) const;

  ClusterSource& source_;
  const ClusterIndex& index_;
  PackedObject object_;
  std::vector<Item> items_;
  std::vector<TexturePart> texture_parts_;  // the last items
  std::vector<UnitId> gaps_;                // units whose payloads do not follow those before
  std::vector<uint64_t> offsets_;
};

struct PackedBeginning {
  PackedHeader header;
  Bytes bytes;               // header and directory
  std::string content_hash;  // 32 hexadecimal digits
};
// Arranges and places them. Errors: kInvalidArgument.
Result<PackedBeginning> PlaceObjects(std::vector<PackedLayout>* layouts);

}  // namespace mtdb::internal
