// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/sync_folder.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <unistd.h>

namespace mtdb::internal {

Status SyncFolder(const std::string& path) {
  const size_t slash = path.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  const int descriptor =
      TEMP_FAILURE_RETRY(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (descriptor < 0) return Status::Ok();  // a folder that may be used, but not listed
  const int result = ::fsync(descriptor);
  const int error = errno;
  ::close(descriptor);
  if (result == 0 || error == EINVAL) return Status::Ok();  // EINVAL: a file system without it
  return IoError(folder + ": cannot be written to the disk: " + std::strerror(error));
}

}  // namespace mtdb::internal
