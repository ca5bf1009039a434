// SPDX-License-Identifier: Apache-2.0
#include <optional>
#include <string>

#include "store/base/out_of_memory.h"
#include "store/packed/packed_reader.h"
#include "store/packed_file.h"

namespace mtdb {

using namespace internal;

Result<std::shared_ptr<PackedObjects>> PackedObjects::Open(std::shared_ptr<RangeReader> ranges) {
  return CatchOutOfMemory([&]() -> Result<std::shared_ptr<PackedObjects>> {
    MTDB_ASSIGN_OR_RETURN(std::shared_ptr<PackedFile> file, PackedFile::Open(std::move(ranges)));
    return std::shared_ptr<PackedObjects>(new PackedObjects(std::move(file)));
  });
}

std::vector<ObjectRecord> PackedObjects::List() const {
  std::vector<ObjectRecord> records;
  for (const PackedObject& object : file_->objects()) records.push_back(object.record);
  return records;
}

Result<std::shared_ptr<ClusterSource>> PackedObjects::OpenObject(const std::string& name) const {
  return CatchOutOfMemory([&]() -> Result<std::shared_ptr<ClusterSource>> {
    MTDB_ASSIGN_OR_RETURN(const PackedObject* const object, file_->Find(name));
    return PackedSource::Open(file_, *object, false);
  });
}

// The tiles come first; they are what the pages leave.
Result<ByteRange> PackedObjects::TextureFileRange(const std::string& name, uint32_t file) const {
  MTDB_ASSIGN_OR_RETURN(const PackedObject* const object, file_->Find(name));
  const std::optional<TextureRecord>& texture = object->record.texture;
  if (!texture || file > texture->pages.size()) {
    return InvalidArgument("object " + name + ": its texture has no file " + std::to_string(file));
  }
  ByteRange range{object->textures, object->end - object->textures};
  for (const TextureRecord::Page& page : texture->pages) range.bytes -= page.bytes;
  if (file == texture->pages.size()) return range;
  range.offset += range.bytes;
  for (uint32_t p = 0; p < file; ++p) range.offset += texture->pages[p].bytes;
  range.bytes = texture->pages[file].bytes;
  return range;
}

}  // namespace mtdb
