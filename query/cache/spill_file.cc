// SPDX-License-Identifier: Apache-2.0
#include "query/cache/spill_file.h"

#include "query/cache/unit_image.h"
#include "store/base/out_of_memory.h"

#ifdef __wasm__  // A page has no files.

namespace mtdb::internal {

SpillFile::~SpillFile() = default;
std::optional<SpillPlace> SpillFile::Take(size_t) { return std::nullopt; }
std::optional<SpillPlace> SpillFile::Write(const LoadedUnit&) noexcept { return std::nullopt; }
std::optional<SpillPlace> SpillFile::Write(ByteSpan) noexcept { return std::nullopt; }
bool SpillFile::Rewrite(const SpillPlace&, ByteSpan) noexcept { return false; }
LoadedUnitPtr SpillFile::Read(const SpillPlace&) const { return nullptr; }
bool SpillFile::Read(const SpillPlace&, std::span<std::byte>) const { return false; }
bool SpillFile::open() const { return false; }
bool SpillFile::empty() const { return true; }

}  // namespace mtdb::internal

#else

#include <filesystem>
#include <system_error>

#include "store/files/posix_file.h"

namespace mtdb::internal {

SpillFile::~SpillFile() {
  if (file_ >= 0) ::close(file_);
}

bool SpillFile::open() const {
  const MutexLock lock(mutex_);
  return !failed_;
}

bool SpillFile::empty() const {
  const MutexLock lock(mutex_);
  return used_ == 0;
}

std::optional<SpillPlace> SpillFile::Take(size_t bytes) {
  const MutexLock lock(mutex_);
  if (failed_) return std::nullopt;
  if (file_ < 0) {
    std::error_code error;
    std::string folder =
        folder_.empty() ? std::filesystem::temp_directory_path(error).string() : folder_;
    file_ = OpenNamelessFile(folder.empty() ? "/tmp" : folder, "mtdb-clusters-");
  }
  if (file_ < 0 || bytes > limit_ - used_) {
    failed_ = true;
    return std::nullopt;
  }
  const SpillPlace place{used_, bytes};
  used_ += bytes;
  return place;
}

std::optional<SpillPlace> SpillFile::Write(const LoadedUnit& unit) noexcept {
  std::optional<SpillPlace> place;
  if (TryAllocate([&] { place = Write(MakeUnitImage(unit)); })) return place;
  const MutexLock lock(mutex_);
  failed_ = true;
  return std::nullopt;
}

std::optional<SpillPlace> SpillFile::Write(ByteSpan bytes) noexcept {
  std::optional<SpillPlace> place;
  if (!TryAllocate([&] { place = Take(bytes.size()); })) {
    const MutexLock lock(mutex_);
    failed_ = true;
  }
  if (place && !WriteAt(place->offset, bytes)) place.reset();
  return place;
}

bool SpillFile::Rewrite(const SpillPlace& place, ByteSpan bytes) noexcept {
  return open() && WriteAt(place.offset, bytes);
}

bool SpillFile::WriteAt(uint64_t offset, ByteSpan bytes) noexcept {
  if (WriteFully(file_, offset, bytes.data(), bytes.size())) return true;
  const MutexLock lock(mutex_);
  failed_ = true;
  return false;
}

LoadedUnitPtr SpillFile::Read(const SpillPlace& place) const {
  Bytes image(place.bytes);
  return Read(place, image) ? UnitFromImage(image) : nullptr;
}

bool SpillFile::Read(const SpillPlace& place, std::span<std::byte> bytes) const {
  return ReadFully(file_, place.offset, bytes.data(), bytes.size()) ==
         static_cast<ssize_t>(place.bytes);
}

}  // namespace mtdb::internal

#endif
