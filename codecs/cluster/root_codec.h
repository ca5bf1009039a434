// SPDX-License-Identifier: Apache-2.0
// The compressed form of a root piece. Specified in codecs/FORMAT.md.
#pragma once

#include <optional>
#include <string>

#include "codecs/cluster/cluster.h"
#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Deterministic.
Bytes EncodeRootPiece(const Cluster& piece, const AttributeLayout& attributes);

// `corner_step`: of the object's texture coordinates; none: of an object without. `root_vertices`:
// how many vertices the root has; larger numbers are refused. The payload's length
// bounds memory and time. `where` names the piece in messages. Errors: kCorrupt.
Result<Cluster> DecodeRootPiece(ByteSpan payload, const AttributeLayout& attributes,
                                uint64_t root_vertices, const std::string& where,
                                std::optional<double> corner_step = std::nullopt);

}  // namespace mtdb
