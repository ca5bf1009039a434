// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <utility>
#include <vector>

#include "store/base/out_of_memory.h"
#include "store/packed/packed_layout.h"
#include "store/packed_file.h"

namespace mtdb {

using namespace internal;
namespace {

Result<PackReport> Pack(std::span<const std::shared_ptr<ClusterSource>> sources,
                        const AppendBytes& append) {
  if (sources.empty()) return InvalidArgument("a packed file needs an object");
  std::vector<PackedLayout> layouts;
  layouts.reserve(sources.size());
  for (const auto& source : sources) layouts.emplace_back(*source, layouts.size());
  MTDB_ASSIGN_OR_RETURN(const PackedBeginning beginning, PlaceObjects(&layouts));
  MTDB_RETURN_IF_ERROR(append(beginning.bytes));
  for (const PackedLayout& layout : layouts) MTDB_RETURN_IF_ERROR(layout.Write(append));
  return PackReport{beginning.header.file_bytes, beginning.header.first_bytes,
                    beginning.content_hash};
}

}  // namespace

struct PackedImage::Impl {
  std::shared_ptr<ClusterSource> source;
  std::vector<PackedLayout> layouts;  // one
  PackedBeginning beginning;
};

PackedImage::PackedImage(std::unique_ptr<const Impl> impl) : impl_(std::move(impl)) {}
PackedImage::~PackedImage() = default;

Result<std::shared_ptr<const PackedImage>> PackedImage::Open(
    std::shared_ptr<ClusterSource> source) {
  return CatchOutOfMemory([&]() -> Result<std::shared_ptr<const PackedImage>> {
    auto impl = std::make_unique<Impl>();
    impl->source = std::move(source);
    impl->layouts.emplace_back(*impl->source, 0);
    MTDB_ASSIGN_OR_RETURN(impl->beginning, PlaceObjects(&impl->layouts));
    return std::shared_ptr<const PackedImage>(new PackedImage(std::move(impl)));
  });
}

const ObjectRecord& PackedImage::record() const { return impl_->source->record(); }
uint64_t PackedImage::size() const { return impl_->beginning.header.file_bytes; }
const std::string& PackedImage::content_hash() const { return impl_->beginning.content_hash; }

Result<Bytes> PackedImage::Read(ByteRange range) const {
  return CatchOutOfMemory([&]() -> Result<Bytes> {
    if (range.offset > size() || range.bytes > size() - range.offset) {
      return InvalidArgument("the range is not in the file");
    }
    const Bytes& beginning = impl_->beginning.bytes;
    Bytes bytes;
    bytes.reserve(range.bytes);
    if (range.offset < beginning.size()) {
      const uint64_t end = std::min<uint64_t>(beginning.size(), range.offset + range.bytes);
      bytes.assign(beginning.begin() + static_cast<ptrdiff_t>(range.offset),
                   beginning.begin() + static_cast<ptrdiff_t>(end));
    }
    MTDB_RETURN_IF_ERROR(impl_->layouts[0].Read(range, &bytes));
    return bytes;
  });
}

Result<PackReport> PackObjects(std::span<const std::shared_ptr<ClusterSource>> sources,
                               const AppendBytes& append) {
  return CatchOutOfMemory([&] { return Pack(sources, append); });
}

}  // namespace mtdb
