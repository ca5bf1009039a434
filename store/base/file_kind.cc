// SPDX-License-Identifier: Apache-2.0
#include "store/base/file_kind.h"

#include <algorithm>
#include <iterator>

namespace mtdb {
namespace {

using namespace std::string_view_literals;

struct Kind {
  size_t offset;
  std::string_view bytes;
  std::string_view name;
};

// LMDB's magic number in the first meta page; the packed file's own begins it.
constexpr Kind kStore{16, "\xde\xc0\xef\xbe"sv, "an mtdb store"sv};
constexpr Kind kPackedFile{0, "mtdb packed"sv, "a packed file of mtdb"sv};

constexpr Kind kKinds[] = {
    kStore,
    kPackedFile,
    {0, "\x89PNG\r\n\x1a\n"sv, "a PNG picture"sv},
    {0, "\xff\xd8\xff"sv, "a JPEG picture"sv},
    {0, "GIF8"sv, "a GIF picture"sv},
    {8, "WEBP"sv, "a WebP picture"sv},
    {0, "II*\0"sv, "a TIFF picture or raster"sv},
    {0, "MM\0*"sv, "a TIFF picture or raster"sv},
    {0, "II+\0"sv, "a TIFF picture or raster"sv},
    {0, "Kaydara FBX"sv, "an FBX scene"sv},
    {0, "BLENDER"sv, "a Blender scene"sv},
    {0, "LASF"sv, "a LAS point cloud"sv},
    {0, "ASTM-E57"sv, "an E57 point cloud"sv},
    {0, "\x89HDF\r\n\x1a\n"sv, "an HDF5 file"sv},
    {0, "SQLite format 3\0"sv, "an SQLite database"sv},
    {0, "%PDF-"sv, "a PDF document"sv},
    {0, "PK\x03\x04"sv, "a ZIP archive"sv},
    {0, "\x1f\x8b"sv, "a file compressed by gzip"sv},
    {0, "\x28\xb5\x2f\xfd"sv, "a file compressed by zstd"sv},
    {0,
     "\xfd"
     "7zXZ\0"sv,
     "a file compressed by xz"sv},
    {0, "7z\xbc\xaf\x27\x1c"sv, "a 7-Zip archive"sv},
    {0,
     "\x7f"
     "ELF"sv,
     "a program"sv},
    {0, "<"sv, "a text in XML or HTML"sv},
    {0, "{"sv, "a text in JSON"sv},
    {0, "#!"sv, "a script"sv},
};

bool Begins(std::string_view start, const Kind& kind) {
  return start.size() >= kind.offset && start.substr(kind.offset).starts_with(kind.bytes);
}

}  // namespace

std::string_view KindOfFile(std::string_view start) {
  const Kind* const kind = std::find_if(std::begin(kKinds), std::end(kKinds),
                                        [&](const Kind& k) { return Begins(start, k); });
  return kind == std::end(kKinds) ? std::string_view() : kind->name;
}

bool SeemsStore(std::string_view start) { return Begins(start, kStore); }

bool SeemsPackedFile(std::string_view start) { return Begins(start, kPackedFile); }

}  // namespace mtdb
