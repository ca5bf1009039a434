// SPDX-License-Identifier: Apache-2.0
// decode_digest FILE...: decodes what decode_dump wrote, and prints a digest of all that comes out,
// which must be the same on every machine (tools/decode_check). Needs codecs and store/base only.
#include <cstdio>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/root_codec.h"
#include "store/base/attribute_layout.h"
#include "store/base/hash.h"
#include "tests/codecs/decode_check/payload_file.h"

namespace mtdb {

namespace {

class Digest {
 public:
  template <typename T>
  void Add(const std::vector<T>& values) {
    static_assert(std::has_unique_object_representations_v<T>);
    sum_ = Hash64(std::as_bytes(std::span(values)), sum_ + values.size());
  }
  void Add(const std::vector<ExplicitArc>& arcs) {
    std::vector<uint32_t> numbers;
    for (const ExplicitArc& a : arcs) {
      numbers.insert(numbers.end(), {a.slot, a.child_slot, a.rotation});
    }
    Add(numbers);
  }
  void Add(const Cluster& c) {
    Add(c.in.positions);
    Add(c.in.rows);
    Add(c.error_codes);
    Add(c.ring_begin);
    Add(c.ring_vertices);
    Add(c.star_begin);
    Add(c.hole_begin);
    Add(c.hole_slots);
    Add(c.removers);
    Add(c.children);
    Add(c.explicit_arcs);
  }
  uint64_t sum() const { return sum_; }

 private:
  uint64_t sum_ = 0;
};

Status DigestFile(const char* path) {
  Bytes bytes;
  std::FILE* const file = std::fopen(path, "rb");
  if (file == nullptr) return IoError(std::string(path) + ": cannot open");
  std::byte block[1 << 14];
  while (const size_t n = std::fread(block, 1, sizeof(block), file)) {
    bytes.insert(bytes.end(), block, block + n);
  }
  std::fclose(file);
  ByteReader in(bytes);
  Digest digest;
  uint64_t units = 0;
  for (uint64_t objects = in.GetVarint(); objects > 0; --objects) {
    const AttributeLayout layout = *GetAttributeLayout(&in);
    for (;;) {
      const auto kind = in.Get<uint8_t>();
      if (kind == kNothing) break;
      const uint64_t number = in.GetVarint();  // nodes, or root vertices
      const ByteSpan payload = GetBlob(in);
      if (in.failed()) return Corrupt(std::string(path) + ": cut short");
      if (kind == kClusterPayload) {
        MTDB_ASSIGN_OR_RETURN(
            const Cluster cluster,
            DecodeCluster(payload, GetInPatch(in), layout, static_cast<uint32_t>(number), path));
        digest.Add(cluster);
      } else {
        MTDB_ASSIGN_OR_RETURN(const Cluster piece, DecodeRootPiece(payload, layout, number, path));
        digest.Add(piece);
      }
      ++units;
    }
  }
  std::printf("%016llx %llu\n", static_cast<unsigned long long>(digest.sum()),
              static_cast<unsigned long long>(units));
  return Status::Ok();
}

}  // namespace

}  // namespace mtdb

int main(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    if (const mtdb::Status status = mtdb::DigestFile(argv[i]); !status.ok()) {
      std::fprintf(stderr, "%s\n", status.message().c_str());
      return 1;
    }
  }
  return 0;
}
