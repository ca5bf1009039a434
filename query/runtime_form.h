// SPDX-License-Identifier: Apache-2.0
// RuntimeForm: an option of surfaces.
#pragma once

#include <cstdint>

namespace mtdb {

// How a surface keeps clusters in memory between queries.
enum class RuntimeForm : uint8_t {
  kExplicit,  // decoded: holes, stars, arcs are listed
  kImplicit,  // as in the store: a query decodes what it needs, again
};

}  // namespace mtdb
