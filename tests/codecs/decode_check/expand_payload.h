// SPDX-License-Identifier: Apache-2.0
// Payloads for machines that have no zstd.
#pragma once

#include "codecs/cluster/internal/streams.h"
#include "store/base/bytes.h"

namespace mtdb {

// The same payload without zstd's frames.
inline Bytes ExpandPayload(ByteSpan payload) {
  const auto streams = internal::StreamReader::Open(payload, "payload").value();
  internal::StreamWriter expanded;
  for (const internal::StreamReader::Size& s : streams.sizes()) {
    const ByteSpan bytes = streams.bytes(s.tag);
    expanded.AddCoded(s.tag, Bytes(bytes.begin(), bytes.end()));
  }
  return expanded.Finish();
}

}  // namespace mtdb
