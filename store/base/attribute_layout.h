// SPDX-License-Identifier: Apache-2.0
// The bytes that describe an AttributeLayout, the same in every format that has one. Specified in
// store/FORMAT.md, "Attribute layout".
#pragma once

#include <string>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

inline constexpr size_t kMaxAttributeNameBytes = 255;

// What is wrong with the names of a layout: "attribute 2: its name 'x' is that of a coordinate"; ""
// when all may be used. A name is UTF-8 of 1 to kMaxAttributeNameBytes bytes without control
// characters, does not begin or end with a space, is not x, y or z, and is there once. Every
// ingest, every reader of a store or a stream, and every writer of a mesh file asks.
std::string AttributeNamesFault(const AttributeLayout& layout);
// A name that may be used beside those of `layout`: `name`, with what no name may have replaced by
// "_", and a number behind it where it is taken.
std::string UsableAttributeName(const std::string& name, const AttributeLayout& layout);

// `layout` must be valid (IsValidLayout), have names without fault, and have at most
// kMaxAttributes.
void PutAttributeLayout(const AttributeLayout& layout, ByteWriter* writer);
// Reads untrusted bytes; the layout that it returns is valid. Takes memory of some 50 times the
// bytes that it reads. Errors: kCorrupt, whose message says what is wrong; the caller adds where.
Result<AttributeLayout> GetAttributeLayout(ByteReader* reader);

}  // namespace mtdb
