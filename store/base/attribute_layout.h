// The bytes that describe an AttributeLayout, the same in every format that has one. Specified in
// store/FORMAT.md, "Attribute layout".
#pragma once

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// `layout` must be valid (IsValidLayout) and have at most kMaxAttributes.
void PutAttributeLayout(const AttributeLayout& layout, ByteWriter* writer);
// From untrusted bytes. What it returns is valid. Memory: some 50 times the bytes that it reads.
// Errors: kCorrupt, with what is wrong; the caller adds where.
Result<AttributeLayout> GetAttributeLayout(ByteReader* reader);

}  // namespace mtdb
