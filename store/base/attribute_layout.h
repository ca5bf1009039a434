// SPDX-License-Identifier: Apache-2.0
// The bytes that describe an AttributeLayout, the same in every format that has one. Specified in
// store/FORMAT.md, "Attribute layout".
#pragma once

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// `layout` must be valid (IsValidLayout) and have at most kMaxAttributes.
void PutAttributeLayout(const AttributeLayout& layout, ByteWriter* writer);
// Reads untrusted bytes; the layout that it returns is valid. Takes memory of some 50 times the
// bytes that it reads. Errors: kCorrupt, whose message says what is wrong; the caller adds where.
Result<AttributeLayout> GetAttributeLayout(ByteReader* reader);

}  // namespace mtdb
