// SPDX-License-Identifier: Apache-2.0
// What the rows of a store's index and of a packed file's pages have in common. Layout in
// store/FORMAT.md, "Index" and "The packed file".
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/cluster_index.h"

namespace mtdb::internal {

inline constexpr uint8_t kExplicitArcs = 0x01;  // of a row's flags

// From the flags to the error codes.
void PutRowEntry(uint8_t flags, const UnitEntry& entry, const UnitEntry& previous, ByteWriter* w);
void PutBounds(const Box3i& bounds, const Vec3i& previous_min, ByteWriter* w);
// `below`: every child is smaller.
void PutChildren(std::span<const UnitId> children, uint32_t below, ByteWriter* w);

// Reads fields of rows; the first violation is kept and ends the reading.
class RowReader {
 public:
  // `where` names the bytes in messages and outlives the reader.
  RowReader(ByteSpan body, const std::string& where) : r_(body), where_(where) {}

  bool ok() const { return status_.ok() && !r_.failed(); }
  size_t remaining() const { return r_.remaining(); }
  // Whether all was read, and nothing is left.
  Status Finish();
  void Fail(const std::string& what, uint64_t found);

  uint64_t GetChecksum() { return r_.Get<uint64_t>(); }
  uint64_t GetOffset() { return r_.Get<uint64_t>(); }
  uint8_t GetCode() { return r_.Get<uint8_t>(); }
  uint64_t Get64() { return r_.GetVarint(); }
  uint32_t Get32(const char* what);
  uint32_t GetLength();
  Box3i GetBounds();
  // A pair of codes of errors, the smaller first.
  void GetCodes(uint8_t* smallest, uint8_t* largest);
  // As PutRowEntry; `allowed`: flags beside those of the entry, which `*flags` then has.
  UnitEntry GetEntry(uint8_t allowed, const UnitEntry& previous, uint8_t* flags);
  // Valid until the next call.
  const std::vector<UnitId>& GetChildren(uint32_t below);
  // Likewise; ids above `unit` and below `end`.
  const std::vector<UnitId>& GetParents(UnitId unit, uint32_t end);

 private:
  ByteReader r_;
  const std::string& where_;
  Status status_;
  Vec3i previous_min_;
  std::vector<UnitId> units_;
};

}  // namespace mtdb::internal
