// SPDX-License-Identifier: Apache-2.0
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

Result<std::vector<ByteRange>> PackedObjects::TextureFiles(const std::string& name) const {
  return CatchOutOfMemory([&]() -> Result<std::vector<ByteRange>> {
    MTDB_ASSIGN_OR_RETURN(const PackedObject* const object, file_->Find(name));
    std::vector<ByteRange> files;
    if (!object->record.texture) return files;
    const TextureRecord& texture = *object->record.texture;
    files.resize(texture.files());
    uint64_t offset = object->textures;
    for (uint32_t i = 0; i < texture.files(); ++i) {
      const uint32_t file = TextureFileAt(texture.files(), i);
      files[file] = {offset, texture.file(file).bytes};
      offset += files[file].bytes;
    }
    return files;
  });
}

}  // namespace mtdb
