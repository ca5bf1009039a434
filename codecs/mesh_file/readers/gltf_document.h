// SPDX-License-Identifier: Apache-2.0
// GltfDocument: the JSON of a glTF file, and the bytes that it points to.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "codecs/mesh_file/input/file_io.h"
#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb::internal {

using GltfJson = nlohmann::json;

// The member of an object; null when there is none, or `json` is null or no object.
const GltfJson* GltfMember(const GltfJson* json, const char* key);
// The element of the array that is the member `list` of `json`; null when there is none.
const GltfJson* GltfElement(const GltfJson* json, const char* list, uint64_t index);
size_t GltfSize(const GltfJson* json, const char* list);
// A member that is a whole number of at most 2^53; `otherwise` when it is not there. False when it
// is something else.
bool GltfNumber(const GltfJson* json, const char* key, uint64_t otherwise, uint64_t* value);

// A part of a buffer: in a file, in memory, or zeros that are nowhere.
struct GltfBytes {
  std::shared_ptr<const InputFile> file;  // null: in memory
  std::shared_ptr<const Bytes> memory;    // null, too: zeros
  uint64_t begin = 0;
  uint64_t size = 0;
  uint64_t stride = 0;  // 0: packed
};

// Values that stand in for some of an accessor's.
struct GltfSparse {
  std::vector<uint64_t> places;  // ascending
  Bytes values;                  // packed
};

// Values of an accessor: `count` of up to 4 components (16 for matrices are refused).
struct GltfAccessor {
  GltfBytes bytes;  // from the first value on
  uint64_t count = 0;
  int components = 1;
  ScalarType type = ScalarType::kFloat32;
  bool normalized = false;
  std::shared_ptr<const GltfSparse> sparse;  // null: none
};

// Not for several threads at a time.
class GltfDocument {
 public:
  // `file`: .glb or the JSON of .gltf. Buffers in other files lie in the folder of `file`. Errors:
  // kBadInput, kUnsupported (what mtdb does not read, such as required extensions), kIoError.
  static Result<std::unique_ptr<GltfDocument>> Open(const InputFile& file);

  const GltfJson* json() const { return &json_; }
  const std::string& path() const { return path_; }
  Result<GltfAccessor> Accessor(uint64_t index) const;
  // Without its bytes, which may be elsewhere.
  Result<GltfAccessor> AccessorShape(uint64_t index) const;
  // Whether mtdb reads the extension, or can leave it out: it says nothing of where triangles are.
  static bool KnowsExtension(const std::string& name);
  // "%20" as in the names of files in URIs.
  static std::string Unescaped(const std::string& uri);
  // What a data URI has, decoded.
  Result<GltfBytes> DataUri(const std::string& text) const;
  // Decompressed, where EXT_meshopt_compression or KHR_meshopt_compression says so.
  Result<GltfBytes> BufferView(uint64_t index) const;
  // All of a part, which is at most as large as the file.
  Result<Bytes> Load(const GltfBytes& bytes) const;
  Status Error(const std::string& what) const { return BadInput(path_ + ": glTF: " + what); }

 private:
  GltfDocument() = default;
  Status ReadJson(const InputFile& file);
  Status FindBinaryChunk(const InputFile& file, uint64_t chunk);
  Status CheckExtensions() const;
  Result<GltfBytes> Buffer(uint64_t index) const;
  Result<GltfBytes> Part(uint64_t buffer, uint64_t offset, uint64_t size) const;
  Result<GltfBytes> Decompressed(const GltfJson* extension) const;
  Status ReadSparse(const GltfJson* json, const std::string& name, GltfAccessor* accessor) const;

  uint64_t file_bytes_ = 0;
  // At most so many decompressed views are kept: what a primitive has, beside each other.
  static constexpr size_t kKeptViews = 8;

  std::string path_;
  GltfJson json_;
  GltfBytes binary_;  // the chunk of a .glb; no file: none
  // What many accessors share is decoded once, not by each of them.
  mutable std::map<uint64_t, GltfBytes> data_uris_;                   // by buffer
  mutable std::vector<std::pair<uint64_t, GltfBytes>> decompressed_;  // by view; the newest last
};

// Reads an accessor's values, front to back.
class GltfValues {
 public:
  explicit GltfValues(GltfAccessor accessor) : accessor_(std::move(accessor)) {}
  // The next value; integers that are normalized become parts of one.
  Status Next(std::array<double, 4>* value);
  const GltfAccessor& accessor() const { return accessor_; }

 private:
  Status Fill();
  GltfAccessor accessor_;
  uint64_t next_ = 0;    // value
  uint64_t first_ = 0;   // value that the buffer begins with
  uint64_t held_ = 0;    // values in the buffer
  size_t stood_in_ = 0;  // of the sparse values, so many are behind
  Bytes buffer_;
};

}  // namespace mtdb::internal
