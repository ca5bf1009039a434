// SPDX-License-Identifier: Apache-2.0
#include "store/base/out_of_memory.h"
#include "store/packed/packed_reader.h"
#include "store/packed_file.h"
#include "store/records/page_parts.h"

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

Result<ByteRange> PackedObjects::TextureFileRange(const std::string& name, uint32_t file) const {
  MTDB_ASSIGN_OR_RETURN(const PackedObject* const object, file_->Find(name));
  MTDB_RETURN_IF_ERROR(CheckFileRange(object->record, file, 0, 0, "object " + name));
  return ByteRange{object->texture_file(file), object->record.texture->file(file).bytes};
}

}  // namespace mtdb
