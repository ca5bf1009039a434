// SPDX-License-Identifier: Apache-2.0
// OpenOptions: how a database is opened.
#pragma once

#include <cstdint>
#include <string>

namespace mtdb {

struct OpenOptions {
  bool writable = false;  // false: the file must exist, and is not changed
  bool create = true;     // when writable: makes the file if it does not exist
  // Of a URL: what comes of the file is kept in this folder, which is made; empty: nowhere. It need
  // not come again, whoever reads the same content, from whichever URL. Databases and processes may
  // share a folder. Damaged entries come again. The first 64 KiB always come: they tell what the
  // file is.
  std::string cache_directory = {};
  // At most so much lies there, as the disk counts it, and 16 MiB more for each database that has
  // the folder open; what was not used for longest goes first.
  uint64_t cache_directory_bytes = uint64_t{4} << 30;
};

}  // namespace mtdb
